"""What the vehicle says of a finding: its own words, and its estimator's ratios."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from companion.analysis.finding import Finding
from companion.model import Flight, Series

_BEFORE_S, _AFTER_S = 2.0, 15.0  # a glitch is spoken of once the estimator has noticed
_WORDS = ("ekf", "gps", "compass", "mag", "yaw", "lane", "glitch", "aiding", "primary", "variance", "failsafe", "reset")
_MOST = 2  # quotations
_RATIOS = {
    "velocity_ratio": "velocity",
    "position_ratio": "position",
    "height_ratio": "height",
    "compass_ratio": "compass",
}


def with_witnesses(finding: Finding, flight: Flight) -> Finding:
    """The finding about the autopilot with what the vehicle said at that time, and how its estimator saw itself."""
    if finding.side != "autopilot":
        return finding
    begin, end = finding.start_s, min(finding.end_s, finding.start_s + _AFTER_S)
    said = [(t.t, t.text) for t in flight.texts if _speaks(t.text)]
    said += [(e.t, e.text) for e in flight.events if e.kind in {"error", "event"} and _speaks(e.text)]
    during = [(t, text) for t, text in said if begin - _BEFORE_S <= t <= end + _AFTER_S]
    nearest = sorted(during, key=lambda spoken: max(begin - spoken[0], spoken[0] - end, 0.0))
    words = dict.fromkeys(f"{''.join(c for c in text if c.isprintable())!r} at {t:.1f} s" for t, text in nearest)
    evidence = [finding.evidence]
    if words:
        evidence.append(f"the vehicle said {', '.join(list(words)[:_MOST])}")
    estimator = flight.series.get("estimator")
    if estimator is not None and (ratio := _worst_ratio(estimator, begin - _BEFORE_S, end + _BEFORE_S)):
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
