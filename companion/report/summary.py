"""The head of the page: the verdict in a sentence, and what was flown with what."""

from __future__ import annotations

from datetime import UTC, datetime

from companion.report.markup import percent, short, text
from companion.report.subject import Subject

_MEANS = {
    "consistent": "Consistent",
    "imu_suspect": "IMU suspect",
    "autopilot_suspect": "Autopilot suspect",
    "insufficient_data": "Insufficient data",
}
_LOW_RATE_HZ = 40.0


def head(subject: Subject) -> str:
    """HTML of the title, the verdict and its figures."""
    numbers, verdict = subject.numbers, subject.numbers.verdict
    vehicle = numbers.vehicle
    kind = " ".join(part for part in (vehicle.autopilot, vehicle.firmware, vehicle.type) if part)
    track = subject.comparison.track
    cards = "".join(
        f'<div class="card"><b>{text(value)}</b><span>{text(label)}</span></div>' for label, value in _cards(subject)
    )
    against = ", ".join((numbers.reference.attitude or "no attitude", numbers.reference.position or "no position"))
    return (
        f"<header><h1>{text(subject.source.path.name)}</h1>"
        f'<p class="quiet">Vehicle {vehicle.sysid}:{vehicle.compid}, boot {numbers.boot} · {text(kind)} · '
        f"{text(_date(subject))}{numbers.duration_s:.1f} s · {text(numbers.used_imu)} at {track.rate_hz:.1f} Hz "
        f"against {text(against)}</p>"
        f'<div class="verdict {text(verdict.status)}" id="verdict"><h2>{text(_MEANS[verdict.status])}</h2>'
        f'<p>{text(verdict.summary)}</p></div><div class="cards">{cards}</div>{_warning(track.rate_hz)}</header>'
    )


def _date(subject: Subject) -> str:
    """When the flight began, as far as the log tells; "" where it does not."""
    epoch = subject.flight.epoch
    if epoch is None:
        return ""
    try:
        began = datetime.fromtimestamp(epoch.unix_s + subject.flight.start, UTC)
    except (OverflowError, ValueError, OSError):  # a damaged clock
        return ""
    return f"{began:%Y-%m-%d %H:%M:%S} UTC ({epoch.source}) · "


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


def _warning(rate_hz: float) -> str:
    if rate_hz >= _LOW_RATE_HZ:
        return ""
    return (
        f'<p class="warning">{rate_hz:.0f} Hz is too low to integrate: motion between the samples is lost, and most of '
        "the drift below is that. Record the IMU at 50–200 Hz, or use the on-board log.</p>"
    )
