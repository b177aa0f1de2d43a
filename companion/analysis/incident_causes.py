"""Why control was lost: every cause by the evidence for and against it, each with its probability, none forced.

Naive Bayes over the table `priors.INCIDENT`: what each cause shows of each kind of evidence. The sensors and the
estimator count by the probability that the verdict gives them before the moment. Evidence that the log lacks counts for
nobody, and "none of these" is always among them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from companion.analysis.assessment import Assessment
from companion.analysis.phases import phases
from companion.constants import check, harm, priors
from companion.estimation import AIDING
from companion.model import Flight

if TYPE_CHECKING:
    from companion.analysis.incident import Output, Tracking

_WORDS: Mapping[str, re.Pattern[str]] = {
    "power_announced": re.compile(r"batter|brown.?out|power.*(?:fail|low)|low volt", re.IGNORECASE),
    "thrust_announced": re.compile(r"thrust loss|motor.*(?:fail|stop|desync)|ESC.*(?:fail|error)", re.IGNORECASE),
}
"""What a vehicle announces itself: ArduCopter `thrust_loss_check`, PX4 `FailureDetector`."""

_SIDES = {"imu": ("imu",), "aiding": AIDING, "estimator": ("autopilot",)}
"""Cause → the sides of the verdict that it stands for."""


@dataclass(frozen=True, slots=True)
class ProbableCause:
    """One cause, its probability, and what speaks for and against it."""

    name: str  # of `priors.INCIDENT`; where control was not lost a side of the verdict
    probability: float
    evidence: tuple[str, ...] = ()


def of_verdict(assessment: Assessment | None) -> tuple[ProbableCause, ...]:
    """Where control was not lost: the probabilities of the verdict, side by side."""
    if assessment is None:
        return ()
    shares, reported = _shares(assessment, math.inf)
    made = (ProbableCause(side, share, tuple(reported.get(side, ()))) for side, share in shares.items())
    return tuple(sorted(made, key=lambda one: -one.probability))


def _shares(assessment: Assessment, until: float) -> tuple[dict[str, float], dict[str, list[str]]]:
    """Side → its probability and the errors of it that began before a time, s; together 1 with "nobody".

    Faults that a plain check of the readings shows, as of a stuck axis, are not among the hypotheses that the verdict
    weighs: they count as an accusation.
    """
    shares = dict(assessment.verdict.probability) or {"nobody": 1.0}
    reported: dict[str, list[str]] = {}
    for f in assessment.verdict.findings:
        if f.severity != "error" or f.side == "data" or f.start_s >= until:
            continue
        cause = f.cause
        side = f.side if cause is None or cause.sensor not in AIDING else cause.sensor
        reported.setdefault(side, []).append(f.evidence)
        sure = cause.side_probability if cause is not None and cause.side_probability is not None else priors.ACCUSED
        if sure > shares.get(side, 0.0):
            others = sum(share for name, share in shares.items() if name != side)
            shares = {name: share * (1.0 - sure) / max(others, 1e-12) for name, share in shares.items()} | {side: sure}
    total = sum(shares.values())
    return {side: share / total for side, share in shares.items()}, reported


def of_loss(
    flight: Flight, assessment: Assessment | None, t: float, tracking: Tracking | None, outputs: Sequence[Output]
) -> tuple[ProbableCause, ...]:
    """Why control was lost at a time, s."""
    seen = _evidence(flight, t, tracking, outputs)
    log_odds = {cause: math.log(row["prior"]) for cause, row in priors.INCIDENT.items()}
    reasons: dict[str, list[str]] = {cause: [] for cause in log_odds}
    for name, (there, text) in seen.items():
        for cause, row in priors.INCIDENT.items():
            share = row[name] if there else 1.0 - row[name]
            log_odds[cause] += math.log(share)
            usual = priors.INCIDENT["other"][name] if there else 1.0 - priors.INCIDENT["other"][name]
            if there and share > usual:
                reasons[cause].append(text)
    for cause, (share, text) in _sensors(assessment, t).items():
        bounded = min(max(share, priors.SENSOR_CLEARED), priors.ACCUSED)
        log_odds[cause] += math.log(bounded / (1.0 - bounded))
        if share >= priors.PROBABLY_HARMFUL:
            reasons[cause].append(text)
    most = max(log_odds.values())
    weights = {cause: math.exp(value - most) for cause, value in log_odds.items()}
    total = sum(weights.values())
    made = (ProbableCause(cause, weight / total, tuple(reasons[cause])) for cause, weight in weights.items())
    return tuple(sorted(made, key=lambda one: -one.probability))


def _evidence(
    flight: Flight, t: float, tracking: Tracking | None, outputs: Sequence[Output]
) -> dict[str, tuple[bool, str]]:
    """Name → whether it is there, and in words; what the log does not show is not among it."""
    seen: dict[str, tuple[bool, str]] = {}
    if flight.actuators is not None:
        full = [one.name for one in outputs if one.end == "full"]
        zero = [one.name for one in outputs if one.end == "zero"]
        seen["output_full"] = bool(full), f"{', '.join(full) or 'no output'} at the upper end of its range"
        seen["output_zero"] = bool(zero), f"{', '.join(zero) or 'no output'} at the lower end of its range"
    if tracking is not None:
        degrees = math.degrees(tracking.worst)
        left = tracking.left_s is not None
        seen["not_followed"] = left, f"the attitude is up to {degrees:.0f}° from the desired one"
        steep = tracking.desired > harm.OVERTURNED_RAD
        seen["desired_steep"] = steep, f"a tilt of {math.degrees(tracking.desired):.0f}° was desired"
    texts = [one.text for one in flight.texts if t - check.INCIDENT_BEFORE_S <= one.t <= t]  # later it may follow
    for name, pattern in _WORDS.items():
        announced = next((text for text in texts if pattern.search(text)), "")
        if flight.texts:
            seen[name] = bool(announced), f"the vehicle reported “{announced}”" if announced else "no report of it"
    took_off = [p.start for p in phases(flight) if p.kind == "flight" and p.start <= t]
    young = bool(took_off) and t - took_off[-1] < check.TAKING_OFF_S
    seen["taking_off"] = young, f"{t - took_off[-1]:.1f} s after it took off" if young else "well after take-off"
    aloft = any(p.kind == "flight" and p.end > t - check.LOST_BEFORE_S for p in phases(flight))
    ends = flight.start + flight.duration - t < check.WORTHLESS_S
    seen["log_ends"] = aloft and ends, "the log ends in the air" if ends else "the log goes on after it"
    return seen


def _sensors(assessment: Assessment | None, t: float) -> dict[str, tuple[float, str]]:
    """Cause → the probability of its sides by the verdict, for what began before the moment."""
    if assessment is None:
        return {}
    shares, reported = _shares(assessment, t)
    made = {}
    for cause, sides in _SIDES.items():
        texts = [text for side in sides for text in reported.get(side, ())]
        share = sum(shares.get(side, 0.0) for side in sides)
        made[cause] = (share, texts[0]) if texts else (min(share, priors.SENSOR_CLEARED), "")
    return made
