"""Which findings only follow from others, and what the vehicle itself said of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from companion.analysis.finding import Finding, by_severity
from companion.analysis.findings.aiding import misled_by_frozen
from companion.analysis.findings.turned import misled_by_turned
from companion.analysis.persistent_errors import ALL_THE_TIME
from companion.constants import check
from companion.model import Flight, Series


def without_consequences(
    flight: Flight, all_findings: Sequence[Finding], others: Sequence[Finding], turned: Sequence[Finding]
) -> tuple[Finding, ...]:
    """The findings, with those of other IMUs, without what only follows from others, and with what the vehicle says."""
    unread_imus = {f.cause.imu for f in turned if f.cause is not None}
    own = [f for f in all_findings if f.cause is None or f.cause.imu not in unread_imus]
    constant = {f.kind for f in own if f.severity == "error" and f.cause is not None and f.cause.onset_sigma_s is None}
    own = [f for f in own if not (f.kind in constant and f.side == "data" and ALL_THE_TIME in f.evidence)]
    own = [with_reports(f, flight) for f in own if not _follows(f, own)]
    return by_severity([*misled_by_turned(misled_by_frozen(own)), *others])


def _follows(finding: Finding, others: Sequence[Finding]) -> bool:
    """Whether a finding is only what another fault looks like from elsewhere.

    A frozen, stuck or turned sensor also looks biased, and misleads the autopilot.
    """
    told_itself = finding.kind in _CAUSES or finding.side == "data"
    return not told_itself and is_led_to(finding.start_s, finding.end_s, others)


def is_led_to(start: float, end: float, others: Sequence[Finding]) -> bool:
    """Whether what lasted so long (s) came of a sensor whose readings are none, and of nothing before that."""
    return any(
        f.kind in _CAUSES and f.severity == "error" and f.start_s < end and f.start_s - 2.0 < start for f in others
    )


_CAUSES = ("stuck_axis", "frozen", "units_wrong", "axes_wrong", "clocks_diverge")


_WORDS = ("ekf", "gps", "compass", "mag", "yaw", "lane", "glitch", "aiding", "primary", "variance", "failsafe", "reset")
_RATIOS = {
    "velocity_ratio": "velocity",
    "position_ratio": "position",
    "height_ratio": "height",
    "compass_ratio": "compass",
}


def with_reports(finding: Finding, flight: Flight) -> Finding:
    """The finding with what the vehicle said at that time, and how its estimator saw itself.

    That of the autopilot, and of a compass: ArduPilot says "ground mag anomaly" where one is turned or magnetised, once
    it has taken off, whenever that began.
    """
    of_compass = finding.kind.startswith("compass")
    if finding.side != "autopilot" and not of_compass:
        return finding
    begin, end = finding.start_s, min(finding.end_s, finding.start_s + check.AFTER_S)
    said = [(t.t, t.text) for t in flight.texts if _speaks(t.text)]
    said += [(e.t, e.text) for e in flight.events if e.kind in {"error", "event"} and _speaks(e.text)]
    during = [
        (t, text)
        for t, text in said
        if begin - check.BEFORE_S <= t <= end + check.AFTER_S or (of_compass and "mag anomaly" in text)
    ]
    nearest = sorted(during, key=lambda spoken: max(begin - spoken[0], spoken[0] - end, 0.0))
    words = dict.fromkeys(f"{''.join(c for c in text if c.isprintable())!r} at {t:.1f} s" for t, text in nearest)
    evidence = [finding.evidence]
    if words:
        evidence.append(f"the vehicle said {', '.join(list(words)[: check.MAX_QUOTED])}")
    estimator = flight.series.get("estimator")
    reach = check.BEFORE_S
    if estimator is not None and (ratio := _worst_ratio(estimator, begin - reach, end + reach)):
        evidence.append(ratio)
    return replace(finding, evidence="; ".join(evidence), headline=finding.headline or finding.evidence)


def _speaks(text: str) -> bool:
    return any(word in text.lower() for word in _WORDS)


def _worst_ratio(estimator: Series, begin: float, end: float) -> str:
    """The estimator's worst test ratio of a time, if it rejected something: 1 and more is what it does not believe."""
    during = (estimator.t >= begin) & (estimator.t <= end)
    ratios = {
        name: float(np.nanmax(estimator[column][during]))
        for column, name in _RATIOS.items()
        if column in estimator.columns and np.isfinite(estimator[column][during]).any()
    }
    if not ratios:
        return ""
    worst = max(ratios, key=lambda name: ratios[name])
    return f"{estimator.source}'s {worst} ratio reached {ratios[worst]:.1f} (1: rejected)" if ratios[worst] >= 1 else ""
