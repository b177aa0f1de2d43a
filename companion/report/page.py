"""The page of a flight: its sections, in the order in which they are read."""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from companion.app.examination import Examination, Unexamined
from companion.app.recording import Source
from companion.app.settings import Settings
from companion.documents import analysis_document, encode
from companion.present import palette, paragraph
from companion.report import drift, errors_over_time, lanes, preflight, provenance, sensors, vibration
from companion.report.charts import Charts
from companion.report.findings import bare_findings, findings
from companion.report.html_page import Section, sheet
from companion.report.subject import Subject, subject_of
from companion.report.summary import bare_head, head
from companion.report.track_and_altitude import ground, track

_OPEN = ("findings", "errors")
"""Sections that are read at once; the others unfold."""
_SECTIONS: tuple[tuple[str, str, Callable[[Subject], str]], ...] = (
    ("findings", "Findings", findings),
    ("errors", "Errors over the flight", errors_over_time.errors),
    ("drift", "Drift of the IMU alone from the autopilot", drift.drift),
    ("budget", "Expected drift, and what causes it", drift.budget),
    ("calibration", "Calibration", sensors.calibration),
    ("imus", "Every IMU side by side", sensors.redundant_imus),
    ("noise", "IMU noise", vibration.noise),
    ("spectra", "IMU spectra", vibration.spectra),
    ("vibration", "Vibration", vibration.shaking),
)
"""Anchor, title and body of each section about the examination."""


def report_html(
    examined: Examination,
    source: Source,
    settings: Settings | None = None,
    *,
    command: str = "",
    with_playback: bool = True,
) -> str:
    """The report of an examined flight as one HTML file in UTF-8.

    source: the log that the flight was read from; settings: those that it was examined with; command: the command
    line, to be shown. Without the playback it is about 1 MB smaller.
    """
    charts, flight, assessment = Charts(), examined.flight, examined.assessment
    subject = subject_of(examined, source, settings or Settings(), charts)
    drawn = flight, subject.replay, subject.colour, charts, assessment.best
    first = head(subject, ground(*drawn))
    sections = [Section(anchor, title, body(subject), anchor not in _OPEN) for anchor, title, body in _SECTIONS]
    sections += [*lanes.sections(subject), *preflight.sections(subject)]
    sections.append(Section("track", "Altitude", track(*drawn), folded=True))
    data = {"companion": encode(analysis_document(source, examined))}
    if with_playback:
        sections.append(Section("playback", "3D playback", _playback(subject)))
        if subject.replay is not None:
            from companion.view import display_trajectory, replay_page  # noqa: PLC0415  (brings viser, slow to import)

            player = replay_page(display_trajectory(subject.replay, subject.comparison.track), flight)
            data["player"] = msgspec.json.encode(player).decode()
    sections += provenance.sections(
        source,
        flight,
        subject.settings,
        examined.gaps,
        notes=(*flight.notes, *assessment.drift.notes),
        command=command,
        chosen=provenance.choices(assessment, examined.correction),
    )
    return sheet(_name(source), first, sections, charts, data)


def _playback(subject: Subject) -> str:
    """The 3D replay: a document of its own in a frame, so that its scripts and the page's keep apart."""
    if subject.replay is None:
        return paragraph(f"Not made: {subject.why_no_replay}")
    words = (
        "The solid drone is the IMU alone, the see-through blue one the autopilot. Drag to turn, scroll to come "
        "nearer, press play below."
    )
    return paragraph(words, "screen") + (
        '<div id="playback-place"><button id="playback-start" type="button">Load the 3D playback</button></div>'
        '<p class="paper">The 3D playback is in the file that this was printed from: open it in a browser.</p>'
    )


def bare_html(unexamined: Unexamined, source: Source, settings: Settings | None = None, *, command: str = "") -> str:
    """The report of a flight that cannot be examined, as far as it goes."""
    charts, flight = Charts(), unexamined.flight
    first = bare_head(flight, source, unexamined.verdict, ground(flight, None, palette.IMU, charts))
    sections = [Section("track", "Altitude", track(flight, None, palette.IMU, charts))]
    if unexamined.says_something:
        sections.insert(0, Section("findings", "Findings", bare_findings(unexamined.verdict)))
    sections += provenance.sections(
        source, flight, settings or Settings(), unexamined.gaps, notes=flight.notes, command=command
    )
    return sheet(_name(source), first, sections, charts, {})


def _name(source: Source) -> str:
    return f"{source.path.name}: IMU and autopilot"
