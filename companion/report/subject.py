"""What a report is about: one examined flight with everything that its sections draw on."""

from __future__ import annotations

from dataclasses import dataclass

from companion.app.examination import Examination
from companion.app.recording import Source
from companion.app.settings import Settings
from companion.comparison import Comparison, Expectation, Replay, replay
from companion.model import CompanionError, Flight
from companion.present import palette
from companion.report.html_page import Charts
from companion.verdict import Assessment, Finding
from companion.view import analysed, display_trajectory, first_horizon


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """One flight, examined."""

    examined: Examination
    source: Source
    settings: Settings
    charts: Charts
    replay: Replay | None  # what is drawn over time; None where it cannot be made
    why_no_replay: str
    expected: Expectation | None  # of the replay's errors; None without a replay, or where nothing can be expected

    @property
    def flight(self) -> Flight:
        """As it was read."""
        return self.examined.flight

    @property
    def assessment(self) -> Assessment:
        """The assessment of the IMU that was used."""
        return self.examined.assessment

    @property
    def comparison(self) -> Comparison:
        """That IMU, corrected if that was requested, beside the autopilot."""
        return self.assessment.comparison

    @property
    def imu(self) -> str:
        """The message of that IMU."""
        return self.comparison.track.source

    @property
    def colours(self) -> dict[str, palette.Rgb]:
        """The colour of each IMU message, the same as in the view."""
        return palette.of_imus(self.flight.imus)

    @property
    def colour(self) -> palette.Rgb:
        """That of the IMU that was used."""
        return self.colours[self.imu]

    @property
    def longest_step(self) -> float:
        """s, between two of its samples: a longer one is a gap."""
        return self.comparison.how.limits.longest_step(self.comparison.track.t)

    def is_throughout(self, finding: Finding) -> bool:
        """Whether it lasts as long as the flight."""
        first, last = self.ends
        return finding.end_s - finding.start_s > 0.9 * (last - first)

    @property
    def ends(self) -> tuple[float, float]:
        """First and last sample of the IMU, s, boot clock."""
        t = self.comparison.track.t
        return float(t[0]), float(t[-1])


def subject_of(examined: Examination, source: Source, settings: Settings, charts: Charts) -> Subject:
    """Everything that the sections share."""
    assessment, flight = examined.assessment, examined.flight
    comparison = assessment.comparison
    track = comparison.track
    shown, why, expected = None, "", None
    try:
        replayed = replay(
            flight.with_imu(track),
            imu=track.source,
            how=comparison.how,
            reanchor_s=settings.view.reanchor_s or None,
            reference=comparison.reference,
        )
    except CompanionError as error:
        why = str(error)
    else:
        # With the anchor that `companion view` adds where it opens, so that both have the same numbers.
        display, horizon_s = display_trajectory(replayed, track), first_horizon(settings.drift.horizons_s)
        result = analysed(flight, display, assessment, horizon_s, settings.view.reanchor_s or None)
        shown, expected = result.replay or replayed, result.expected
    return Subject(examined, source, settings, charts, shown, why, expected)
