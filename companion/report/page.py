"""The page of a flight: its sections, in the order in which they are read."""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from companion.app.examination import Examination, Unexamined
from companion.app.recording import Source
from companion.app.settings import Settings
from companion.documents import encode, unexamined_document
from companion.present import palette
from companion.report import drift, errors_over_time, noise, provenance, sensors, vibration
from companion.report.apart import Apart, made_apart
from companion.report.charts import Charts
from companion.report.findings import findings
from companion.report.html_page import sheet
from companion.report.playback import playback
from companion.report.subject import subject_of
from companion.report.summary import bare_head, head
from companion.report.track_and_altitude import ground, track


def report_html(
    examined: Examination,
    source: Source,
    settings: Settings | None = None,
    *,
    command: str = "",
    with_playback: bool = True,
    apart: Callable[[], Apart] | None = None,
) -> str:
    """The report of an examined flight as one HTML file in UTF-8.

    source: the log that the flight was read from; settings: those that it was examined with; command: the command
    line, to be shown. Without the playback it is about 1.5 MB smaller. apart: what `made_apart` makes of the same
    flight and settings, where that was begun before.
    Raises InputError when plotly is not installed.
    """
    charts, settings, assessment = Charts(), settings or Settings(), examined.assessment

    def made() -> Apart:
        begin = assessment.comparison, assessment.figures, assessment.autopilot
        return made_apart(examined.flight, *begin, settings, with_playback=with_playback)

    subject = subject_of(examined, source, settings, charts, apart or made)
    first = head(subject, ground(subject.flight, subject.replay, subject.colour, charts, subject.assessment.best))
    sections = [
        findings(subject),
        errors_over_time.errors(subject),
        drift.drift(subject),
        drift.budget(subject),
        sensors.calibration(subject),
        sensors.redundant_imus(subject),
        noise.noise(subject),
        vibration.spectra(subject),
        vibration.shaking(subject),
        track(subject.flight, subject.replay, subject.colour, charts, subject.assessment.best),
    ]
    player: str | None = None
    if with_playback:
        section, player = playback(subject)
        sections.append(section)
    sections += [
        provenance.log_facts(source, subject.flight, subject.numbers.imu, subject.numbers.notes),
        provenance.again(
            source, subject.settings, command, provenance.choices(subject.assessment, subject.examined.correction)
        ),
    ]
    data = {"companion": encode(subject.document)}
    if player is not None:
        data["player"] = msgspec.json.encode(player).decode()
    return sheet(_name(source), first, sections, charts, data)


def bare_html(unexamined: Unexamined, source: Source, settings: Settings | None = None, *, command: str = "") -> str:
    """The report of a flight that cannot be examined, as far as it goes.

    Raises InputError when plotly is not installed.
    """
    charts, flight = Charts(), unexamined.flight
    first = bare_head(flight, source, unexamined.verdict, ground(flight, None, palette.IMU, charts))
    sections = [
        track(flight, None, palette.IMU, charts),
        provenance.log_facts(source, flight, unexamined_document(source, unexamined).flights[0].imu, flight.notes),
        provenance.again(source, settings or Settings(), command),
    ]
    return sheet(_name(source), first, sections, charts, {})


def _name(source: Source) -> str:
    return f"{source.path.name}: IMU and autopilot"
