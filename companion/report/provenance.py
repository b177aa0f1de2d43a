"""The contents of the log, and all that is needed to make the same report again."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import msgspec
import numpy as np

from companion.analysis import Assessment
from companion.app.examination import Examination, Unexamined
from companion.app.recording import Source
from companion.app.settings import Settings
from companion.model import Flight
from companion.present import details, method_words, paragraph, severity_word, table, text
from companion.report.html_page import Section

_LIBRARIES = ("mavlink-companion", "numpy", "pymavlink", "viser")
MOST_TEXTS = 500


def sections(source: Source, settings: Settings, examined: Examination | Unexamined, command: str) -> list[Section]:
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
            cut = f", the first {MOST_TEXTS}" if len(rows) > MOST_TEXTS else ""
            body += details(f"{title} ({len(rows)}{cut})", table(names, rows[:MOST_TEXTS], words=2))
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
