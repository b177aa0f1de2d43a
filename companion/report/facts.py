"""What the log had in it, and all that is needed to make the same report again."""

from __future__ import annotations

import hashlib
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import msgspec

from companion.report.markup import details, paragraph, table, text
from companion.report.subject import Section, Subject

_SEVERITIES = ("emergency", "alert", "critical", "error", "warning", "notice", "info", "debug")  # MAV_SEVERITY
_LIBRARIES = ("companion", "numpy", "pymavlink", "plotly", "viser")
MOST_TEXTS = 500


def log_facts(subject: Subject) -> Section:
    """Rates, gaps, damage, notes, and what the vehicle said."""
    log, numbers, flight = subject.document.log, subject.numbers, subject.flight
    unknown = ", ".join(f"{i} ({n})" for i, n in sorted(subject.source.unknown_frames.items()))
    facts = [
        ("file", log.path),
        ("format", subject.source.format),
        ("size", f"{log.size_bytes:,} bytes"),
        ("frames", f"{log.frames:,}"),
        ("frames with a wrong checksum", f"{log.bad_crc_frames:,}"),
        ("bytes that belong to no frame", f"{log.skipped_bytes:,}"),
        ("message ids that the dialect does not know", unknown or "none"),
        ("boot clock", f"{flight.start:.2f} to {flight.start + flight.duration:.2f} s"),
    ]
    imus = table(
        ["IMU message", "samples", "rate, Hz", "holes", "longest gap, s", "duplicates"],
        [
            [i.message, i.samples, f"{i.rate_hz:.1f}", i.gaps, _seconds(i.longest_gap_s), i.duplicates]
            for i in numbers.imu
        ],
        name="rates-table",
    )
    messages = table(
        ["message", "count", "rate, Hz", "longest gap, s", "duplicates"],
        [
            [name, s.count, "" if s.rate_hz is None else _rate(s.rate_hz), _seconds(s.longest_gap_s), s.duplicates]
            for name, s in flight.messages.items()
        ],
    )
    said = table(
        ["said", "severity", "s"],
        [
            [t.text, _SEVERITIES[t.severity] if 0 <= t.severity < 8 else t.severity, f"{t.t:.2f}"]
            for t in flight.texts[:MOST_TEXTS]
        ],
        words=2,
    )
    more = f", the first {MOST_TEXTS}" if len(flight.texts) > MOST_TEXTS else ""
    body = table(["the log", ""], facts, words=2) + "<h3>IMUs</h3>" + imus
    body += "".join(paragraph(f"Note: {note}") for note in numbers.notes)
    body += details(f"Every message of this flight ({len(flight.messages)})", messages)
    if flight.events:
        rows = [[e.kind, e.text, f"{e.t:.2f}"] for e in flight.events[:MOST_TEXTS]]
        title = f"Arming, modes and errors ({len(flight.events)})"
        body += details(title, table(["event", "", "s"], rows, words=2))
    body += details(f"What the vehicle said ({len(flight.texts)}{more})", said) if flight.texts else ""
    if flight.parameters:
        values = [[name, f"{value:g}"] for name, value in sorted(flight.parameters.items())]
        body += details(f"Parameters of the vehicle ({len(values)})", table(["parameter", "value"], values))
    return Section("log", "The log", body)


def again(subject: Subject, command: str) -> Section:
    """Command line, settings, versions, and the fingerprint of the log."""
    numbers = subject.numbers
    middle = f", {numbers.middle} middle sample" if numbers.method == "rk4" else ""
    rows = [
        ("companion", _versions()),
        ("Python", f"{platform.python_version()} on {platform.system()} {platform.machine()}"),
        ("log's SHA-256", _fingerprint(subject.source.path)),
        ("IMU", numbers.used_imu),
        ("integration", f"{numbers.method}{middle}, gravity {numbers.gravity_mps2:.5f} m/s²"),
        ("sensor figures", f"{numbers.figures.name} ({numbers.figures.reason})"),
        ("correction", numbers.correction or "none"),
    ]
    if command:
        rows.insert(0, ("command", command))
    settings = f"<pre>{text(_toml(msgspec.to_builtins(subject.settings)))}</pre>"
    document = (
        "<p>Every number of this page is in the JSON document that it carries "
        "(<code>document.getElementById('companion').textContent</code>), which is what "
        "<code>companion analyze --json</code> prints.</p>"
    )
    return Section(
        "again",
        "To make this again",
        table(["", ""], rows, words=2) + details("Every setting", settings) + document,
    )


def _versions() -> str:
    found = []
    for name in _LIBRARIES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:  # run from a checkout that was not installed
            found.append(f"{name} (not installed)")
    return ", ".join(found)


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
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(_value(v) for v in value)}]"
    return msgspec.json.encode(value).decode()


def _seconds(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def _rate(value: float) -> str:
    return f"{value:.1f}" if value < 1e4 else "burst"
