"""The page of a flight: its head, its sections in the order in which they are read, and how to make it again."""

from __future__ import annotations

import hashlib
import platform
import re
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import msgspec
import numpy as np

from companion.app.examination import Examination, Unexamined
from companion.app.recording import Source
from companion.app.settings import Settings
from companion.documents import analysis_document, encode
from companion.model import Flight, counted
from companion.present import (
    QUANTITIES,
    details,
    flight_lines,
    headline,
    method_words,
    palette,
    paragraph,
    severity_word,
    short,
    table,
    text,
    vehicle_words,
)
from companion.report import drift, sensors
from companion.report.findings import bare_findings, findings, lanes_section, preflight_section
from companion.report.html_page import Charts, Section, sheet
from companion.report.subject import Subject, subject_of
from companion.report.traces import ground, paths_of, track
from companion.verdict import Assessment, Verdict, rate_warning
from companion.view import worst_stretch

_LIBRARIES = ("mavlink-companion", "numpy", "pymavlink", "viser")
_MOST_TEXTS = 500


def _reproduction(
    source: Source, settings: Settings, examined: Examination | Unexamined, command: str
) -> list[Section]:
    """The log, and how to make the report again."""
    notes, chosen = examined.flight.notes, list[tuple[str, str]]()
    if isinstance(examined, Examination):
        notes = (*notes, *examined.assessment.drift.notes)
        chosen = _choices(examined.assessment, examined.correction)
    return [
        Section("log", "The log", _log(source, examined.flight, examined.gaps, notes), folded=True),
        Section("again", "Reproduce this report", _again(source, settings, command, chosen), folded=True),
    ]


def _log(source: Source, flight: Flight, imu_gaps: Mapping[str, int], notes: Sequence[str]) -> str:
    """Rates, gaps of each IMU, damage, notes, and what the vehicle sent."""
    unknown = ", ".join(f"{i} ({n})" for i, n in sorted(source.unknown_frames.items()))
    facts = [
        ("file", source.path),
        ("format", source.format),
        ("size", f"{source.size_bytes:,} bytes"),
        ("frames", f"{source.frames:,}"),
        ("frames with a wrong checksum", f"{source.bad_crc_frames:,}"),
        ("bytes that belong to no frame", f"{source.skipped_bytes:,}"),
        ("message ids that the dialect does not know", unknown or "none"),
        ("boot clock", f"{flight.start:.2f} to {flight.start + flight.duration:.2f} s"),
    ]
    imus = []
    for name, one in flight.imus.items():
        stats = flight.messages.get(name)  # an on-board log has one message for all its IMUs
        gap = float(np.diff(one.t).max()) if len(one) > 1 else None
        row = (name, len(one), f"{one.rate_hz:.1f}", imu_gaps[name], _seconds(gap), stats.duplicates if stats else 0)
        imus.append(row)
    headings = ["IMU message", "samples", "rate, Hz", "gaps", "longest gap, s", "duplicates"]
    rates = table(headings, imus, name="rates-table")
    messages = table(
        ["message", "count", "rate, Hz", "longest gap, s", "duplicates"],
        [
            [name, s.count, "" if s.rate_hz is None else _rate(s.rate_hz), _seconds(s.longest_gap_s), s.duplicates]
            for name, s in flight.messages.items()
        ],
    )
    body = table(["the log", ""], facts, words=2) + (f"<h3>IMUs</h3>{rates}" if imus else "")
    body += "".join(paragraph(f"Note: {note}") for note in notes)
    body += details(f"Every message of this flight ({len(flight.messages)})", messages)
    events = [[e.kind, e.text, f"{e.t:.2f}"] for e in flight.events]
    texts = [[t.text, severity_word(t.severity), f"{t.t:.2f}"] for t in flight.texts]
    for title, names, rows in (
        ("Arming, modes and errors", ["event", "", "s"], events),
        ("Vehicle messages", ["text", "severity", "s"], texts),
    ):
        if rows:
            cut = f", the first {_MOST_TEXTS}" if len(rows) > _MOST_TEXTS else ""
            body += details(f"{title} ({len(rows)}{cut})", table(names, rows[:_MOST_TEXTS], words=2))
    if flight.parameters:
        values = [[name, f"{value:g}"] for name, value in sorted(flight.parameters.items())]
        body += details(f"Parameters of the vehicle ({len(values)})", table(["parameter", "value"], values))
    return body


def _again(source: Source, settings: Settings, command: str, chosen: Sequence[tuple[str, str]]) -> str:
    """Command line, settings, versions, the fingerprint of the log, and what else was `chosen`."""
    rows = [
        ("companion", _versions()),
        ("Python", f"{platform.python_version()} on {platform.system()} {platform.machine()}"),
        ("log's SHA-256", _fingerprint(source.file)),
        *chosen,
    ]
    if command:
        rows.insert(0, ("command", command))
    file = f"<pre>{text(_toml(msgspec.to_builtins(settings)))}</pre>"
    document = (
        "<p>Every number of the tables is in the JSON document that this page carries "
        "(<code>document.getElementById('companion').textContent</code>), which is what "
        "<code>companion analyze --json</code> prints.</p>"
    )
    return table(["", ""], rows, words=2) + details("Every setting", file) + (document if chosen else "")


def _choices(assessment: Assessment, correction: str | None) -> list[tuple[str, str]]:
    """IMU, integration, noise model and correction (the file that was applied), as rows of a table."""
    how = assessment.comparison.how
    return [
        ("IMU", assessment.drift.imu),
        ("integration", f"{method_words(how.method, how.middle)}, gravity {how.gravity:.5f} m/s²"),
        ("IMU noise model", f"{assessment.imu_spec.name} ({assessment.imu_spec.reason})"),
        ("correction", correction or "none"),
    ]


def _versions() -> str:
    libraries = []
    for name in _LIBRARIES:
        try:
            libraries.append(f"{name} {version(name)}")
        except PackageNotFoundError:  # run from a checkout that was not installed
            libraries.append(f"{name} (not installed)")
    return ", ".join(libraries)


def _fingerprint(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        return f"the file cannot be read any more: {error.strerror}"


def _toml(settings: dict[str, dict[str, object]]) -> str:
    """The settings as a file for --config."""
    lines = []
    for section, values in settings.items():
        lines += [f"[{section}]", *(f"{key} = {_value(value)}" for key, value in values.items()), ""]
    return "\n".join(lines)


def _value(value: object) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(_value(v) for v in value)}]"
    return msgspec.json.encode(value).decode()


def _seconds(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def _rate(value: float) -> str:
    return f"{value:.1f}" if value < 1e4 else "burst"


_NO_BREAK = "\N{NO-BREAK SPACE}"  # between a number and its unit
_SHOWN_S = 5.0  # the horizon of which the median is shown


def _head(subject: Subject, ground: str) -> str:
    """HTML of the title, the verdict and its numbers; ground: the chart that stands beside them, "" for none."""
    flight, verdict, rate = subject.flight, subject.assessment.verdict, subject.comparison.track.rate_hz
    tracks = {"attitude": flight.attitude, "position": flight.position}
    against = ", ".join(track.source if track else f"no {name}" for name, track in tracks.items())
    body = _banner(verdict) + "".join(paragraph(", ".join(one)) for one in flight_lines(verdict))
    body += _worst(subject) + _usual(subject)
    if warning := rate_warning(flight, rate):
        body += paragraph(warning, "warning")
    return _header(flight, subject.source, f"{subject.imu} at {rate:.1f} Hz against {against}", body, ground)


def _header(flight: Flight, source: Source, used: str, body: str, ground: str) -> str:
    """The log's name, and under it who flew when; the ground track beside the body where the window is wide enough."""
    who = (f"Vehicle {flight.vehicle}, boot {flight.boot}", vehicle_words(flight.vehicle))
    about = " · ".join(filter(None, (*who, _date(flight), f"{flight.duration:.1f} s", used)))
    first = f'<div class="first"><div>{body}</div>{ground}</div>' if ground else body
    return f'<header><h1>{text(source.path.name)}</h1><p class="quiet">{text(about)}</p>{first}</header>'


def _banner(verdict: Verdict) -> str:
    head = headline(verdict)
    sure = f' <span class="sure">{text(_kept(head.probability))}</span>' if head.probability else ""
    title = f"{palette.SIGNS[verdict.status]} {text(_kept(head.sentence))}"
    return (
        f'<div class="verdict {text(verdict.status)}" id="verdict"><h2>{title}{sure}</h2>'
        f"<p>{text(_kept(head.detail))}</p></div>"
    )


def _kept(words: str) -> str:
    """No line ends between a number and its per cent."""
    return re.sub(r"(?<=\d) (?=%)", _NO_BREAK, words)


def _date(flight: Flight) -> str:
    """When the flight began; "" where that is not known."""
    if flight.epoch is None:
        return ""
    try:
        began = datetime.fromtimestamp(flight.epoch.unix_s + flight.start, UTC)
    except (OverflowError, ValueError, OSError):  # a damaged clock
        return ""
    return f"{began:%Y-%m-%d %H:%M:%S} UTC ({flight.epoch.source})"


def _usual(subject: Subject) -> str:
    """What the IMU alone is off by after a few seconds, beside what is allowed: one table."""
    drift = zip(subject.assessment.drift.rows, subject.assessment.expected, strict=True)
    rows = [(row, should) for row, should in drift if row.windows]
    if not rows:
        return ""
    row, should = min(rows, key=lambda pair: abs(pair[0].horizon_s - _SHOWN_S))
    cells = []
    for quantity in QUANTITIES:
        statistic, sigma = getattr(row, quantity.attribute), getattr(should, quantity.attribute, None)
        if statistic is not None:
            cells.append([quantity.title, short(statistic.median), short(statistic.p95), short(sigma)])
    name = f"after {row.horizon_s:g} s, {counted(row.windows, 'window')}"
    return table([name, "median", "95 %", "allowed, 1σ"], cells, name="usual")


def _worst(subject: Subject) -> str:
    """Where IMU and autopilot are farthest apart, and how far they may be there, in a sentence."""
    if subject.replay is None or (worst := worst_stretch(subject.replay)) is None:
        return ""
    sentence = (
        f"IMU and autopilot are farthest apart at {worst.end_s:.1f} s: {short(worst.apart_m)} m, "
        f"{worst.end_s - worst.start_s:.1f} s after the anchor"
    )
    if (expected := subject.expected) is not None:
        sigma = float(np.interp(worst.end_s, expected.t, expected.lengths[2]))
        if sigma > 0:
            sentence += f", {worst.apart_m / sigma:.1f} times the {short(sigma)} m allowed (1σ)"
    return paragraph(f"{sentence}.".replace(" m,", f"{_NO_BREAK}m,"))


_OPEN = ("findings", "errors")
"""Sections that are read at once; the others unfold."""
_SECTIONS: tuple[tuple[str, str, Callable[[Subject], str]], ...] = (
    ("findings", "Findings", findings),
    ("errors", "Errors over the flight", drift.errors),
    ("drift", "Drift of the IMU alone from the autopilot", drift.drift),
    ("budget", "Allowed drift, and what causes it", drift.budget),
    ("calibration", "Calibration", sensors.calibration),
    ("imus", "Every IMU side by side", sensors.redundant_imus),
    ("noise", "IMU noise", sensors.noise),
    ("spectra", "IMU spectra", sensors.spectra),
    ("vibration", "Vibration", sensors.shaking),
)
"""Anchor, title and body of each section about the examination."""


def report_html(
    examined: Examination | Unexamined,
    source: Source,
    settings: Settings | None = None,
    *,
    command: str = "",
    with_playback: bool = True,
) -> str:
    """The report of a flight as one HTML file in UTF-8; of one that cannot be examined as far as it goes.

    source: the log that the flight was read from; settings: those that it was examined with; command: the command
    line, to be shown. Without the playback it is about 1 MB smaller.
    """
    charts, settings = Charts(), settings or Settings()
    if isinstance(examined, Unexamined):
        first, sections, data = _bare(examined, source, charts)
    else:
        first, sections, data = _whole(subject_of(examined, source, settings, charts), with_playback)
    sections += _reproduction(source, settings, examined, command)
    return sheet(f"{source.path.name}: IMU and autopilot", first, sections, charts, data)


def _whole(subject: Subject, with_playback: bool) -> tuple[str, list[Section], dict[str, str]]:
    """The head, the sections and the data of a flight that could be examined."""
    flight, assessment, charts = subject.flight, subject.assessment, subject.charts
    paths = paths_of(flight, subject.replay, subject.colour, assessment.best)
    first = _head(subject, ground(flight, subject.replay, paths, charts))
    sections = [Section(anchor, title, body(subject), anchor not in _OPEN) for anchor, title, body in _SECTIONS]
    sections += [*lanes_section(subject), *preflight_section(subject)]
    sections.append(Section("track", "Altitude", track(flight, paths, charts), folded=True))
    data = {"companion": encode(analysis_document(subject.source, subject.examined))}
    if with_playback:
        sections.append(Section("playback", "3D playback", _playback(subject)))
        if subject.replay is not None:
            from companion.view import display_trajectory, replay_page  # noqa: PLC0415  (brings viser, slow to import)

            player = replay_page(display_trajectory(subject.replay, subject.comparison.track), flight)
            data["player"] = msgspec.json.encode(player).decode()
    return first, sections, data


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


def _bare(unexamined: Unexamined, source: Source, charts: Charts) -> tuple[str, list[Section], dict[str, str]]:
    """The same of a flight that cannot be examined."""
    flight = unexamined.flight
    paths = paths_of(flight, None, palette.IMU, None)
    first = _header(flight, source, "", _banner(unexamined.verdict), ground(flight, None, paths, charts))
    sections = [Section("track", "Altitude", track(flight, paths, charts))]
    if unexamined.says_something:
        sections.insert(0, Section("findings", "Findings", bare_findings(unexamined.verdict)))
    return first, sections, {}
