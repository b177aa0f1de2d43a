"""What a report is about: one examined flight with everything that its sections draw on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from companion import present
from companion.analysis import Assessment, Comparison, Finding, Replay
from companion.app.examination import Examination
from companion.app.recording import Source
from companion.app.settings import Settings
from companion.documents import FindingObject, analysis_document, schema
from companion.model import Flight
from companion.present import palette
from companion.report.apart import Apart
from companion.report.charts import Charts


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """One flight, examined. Tables are made from `document`: what `companion analyze --json` prints."""

    examined: Examination
    source: Source
    settings: Settings
    document: schema.Analysis
    apart: Apart
    charts: Charts

    @property
    def flight(self) -> Flight:
        """As it was read."""
        return self.examined.flight

    @property
    def replay(self) -> Replay | None:
        """What is drawn over time; None where it cannot be made."""
        return self.apart.replay

    @property
    def assessment(self) -> Assessment:
        """The assessment of the IMU that was used."""
        return self.examined.assessment

    @property
    def comparison(self) -> Comparison:
        """That IMU, corrected if that was asked for, beside the autopilot."""
        return self.assessment.comparison

    @property
    def numbers(self) -> schema.AnalyzeFlight:
        """The flight in the document."""
        return self.document.flights[0]

    @property
    def colours(self) -> dict[str, palette.Rgb]:
        """The colour of each IMU message, the same as in the view."""
        return palette.of_imus(self.flight.imus)

    @property
    def colour(self) -> palette.Rgb:
        """That of the IMU that was used."""
        return self.colours[self.comparison.track.source]

    @property
    def severe(self) -> list[FindingObject]:
        """The findings that are more than a remark."""
        return [finding for finding in self.numbers.verdict.findings if finding.severity != "info"]

    def is_throughout(self, finding: Finding | FindingObject) -> bool:
        """Whether it lasts as long as the flight, so that its time says nothing."""
        first, last = self.ends
        return finding.end_s - finding.start_s > 0.9 * (last - first)

    @property
    def ends(self) -> tuple[float, float]:
        """First and last sample of the IMU, s, boot clock."""
        t = self.comparison.track.t
        return float(t[0]), float(t[-1])


def subject_of(
    examined: Examination, source: Source, settings: Settings, charts: Charts, apart: Callable[[], Apart]
) -> Subject:
    """Everything that the sections share. apart: waited for when all else is done."""
    return Subject(examined, source, settings, analysis_document(source, examined), apart(), charts)


AXES: tuple[tuple[str, palette.Rgb], ...] = tuple(zip(present.AXES, palette.AXES, strict=True))
"""The body's axes and their colours."""
