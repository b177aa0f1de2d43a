"""The head of the page: the verdict in a sentence, and what was flown with what."""

from __future__ import annotations

from datetime import UTC, datetime

from companion.analysis import Verdict, rate_warning
from companion.model import Flight
from companion.recording import Source
from companion.report.markup import percent, short, text
from companion.report.subject import Subject

_MEANS = {
    "consistent": "Consistent",
    "imu_suspect": "IMU suspect",
    "autopilot_suspect": "Autopilot suspect",
    "insufficient_data": "Insufficient data",
}


def head(subject: Subject) -> str:
    """HTML of the title, the verdict and its figures."""
    numbers, verdict, rate = subject.numbers, subject.numbers.verdict, subject.comparison.track.rate_hz
    against = ", ".join((numbers.reference.attitude or "no attitude", numbers.reference.position or "no position"))
    cards = "".join(
        f'<div class="card"><b>{text(value)}</b><span>{text(label)}</span></div>' for label, value in _cards(subject)
    )
    return (
        f"<header>{_title(subject.flight, subject.source, f'{numbers.used_imu} at {rate:.1f} Hz against {against}')}"
        f'{_banner(verdict.status, verdict.summary)}<div class="cards">{cards}</div>'
        f"{_warning(subject.flight, rate)}</header>"
    )


def bare_head(flight: Flight, source: Source, verdict: Verdict) -> str:
    """The same for a flight that cannot be examined."""
    return f"<header>{_title(flight, source, '')}{_banner(verdict.status, verdict.summary)}</header>"


def _title(flight: Flight, source: Source, used: str) -> str:
    """The log's name, and under it who flew when."""
    vehicle = flight.vehicle
    kind = " ".join(part for part in (vehicle.autopilot, vehicle.firmware, vehicle.type) if part)
    parts = [f"Vehicle {vehicle}, boot {flight.boot}", kind, _date(flight), f"{flight.duration:.1f} s", used]
    return f'<h1>{text(source.path.name)}</h1><p class="quiet">{text(" · ".join(filter(None, parts)))}</p>'


def _banner(status: str, summary: str) -> str:
    return (
        f'<div class="verdict {text(status)}" id="verdict"><h2>{text(_MEANS[status])}</h2><p>{text(summary)}</p></div>'
    )


def _date(flight: Flight) -> str:
    """When the flight began, as far as the log tells; "" where it does not."""
    if flight.epoch is None:
        return ""
    try:
        began = datetime.fromtimestamp(flight.epoch.unix_s + flight.start, UTC)
    except (OverflowError, ValueError, OSError):  # a damaged clock
        return ""
    return f"{began:%Y-%m-%d %H:%M:%S} UTC ({flight.epoch.source})"


def _cards(subject: Subject) -> list[tuple[str, str]]:
    """The few numbers that a reader wants first: after 5 s, or the nearest horizon that has windows."""
    rows = [row for row in subject.numbers.drift if row.windows]
    if not rows:
        return []
    row = min(rows, key=lambda r: abs(r.horizon_s - 5.0))
    after = f"after {row.horizon_s:g} s on the IMU alone, median"
    inside = next((c for c in subject.numbers.consistency if c.horizon_s == row.horizon_s), None)
    found = [(f"attitude {after}", f"{short(row.attitude_deg.median)}°")] if row.attitude_deg else []
    if row.velocity_mps:
        found.append((f"velocity {after}", f"{short(row.velocity_mps.median)} m/s"))
    if row.position_m:
        found.append((f"position {after}", f"{short(row.position_m.median)} m"))
    if row.expected:
        allowed = row.expected
        value = f"{short(allowed.attitude_deg)}°" + (f", {short(allowed.position_m)} m" if allowed.position_m else "")
        found.append(("expected then, 1σ", value))
    if inside:
        least = min(share for share in (inside.attitude, inside.velocity, inside.position) if share is not None)
        found.append((f"of {row.windows} windows inside the 95 % bound", percent(least)))
    findings = subject.numbers.verdict.findings
    found.append(("findings, of which are warnings or errors", f"{len(findings)} / {len(subject.severe)}"))
    return found


def _warning(flight: Flight, rate_hz: float) -> str:
    warning = rate_warning(flight, rate_hz)
    return f'<p class="warning">{text(warning)}</p>' if warning else ""
