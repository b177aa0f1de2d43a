"""What the best estimate says: the sensors' faults, where the autopilot leaves it, and what is set otherwise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from companion.analysis.attribution import findings_of
from companion.analysis.autopilot_error import known_biases
from companion.analysis.deviations import estimator_deviations
from companion.analysis.fault_interval import fault_intervals
from companion.analysis.finding import Finding, are_near
from companion.analysis.findings.consequences import is_led_to
from companion.analysis.findings.settings import setting_findings
from companion.analysis.reference import Limits
from companion.constants import num
from companion.estimation import BestEstimate, kind_of
from companion.model import Flight


def findings_by_estimate(
    flight: Flight,
    best: BestEstimate,
    limits: Limits,
    known: tuple[Sequence[Finding], Sequence[Finding], Sequence[Finding]],
    landed: float,
    tilted: tuple[float, float],
) -> tuple[list[Finding], list[Finding]]:
    """Those of the best estimate, and the jumps as serious as it takes the autopilot to be then.

    known: all findings so far, those of readings that are none, and the jumps of the autopilot. landed: s, from when on
    nothing is judged. tilted: roll and pitch of the IMU, rad.
    """
    so_far, faults, jumps = known
    while_judged = tuple(one for one in fault_intervals(best) if one.start - num.SIGMAS * one.start_sigma < landed)
    deviations = estimator_deviations(flight, best, limits, tilted)
    deviations = tuple(one for one in deviations if not is_led_to(one.start, one.end, faults))
    out = findings_of(while_judged, deviations, best, flight.imu_in_use)
    out += [*known_biases(flight, best), *setting_findings(flight, best, limits)]
    # the best estimate has judged where the autopilot went: a jump is one of the signs of it
    return out, [_confirmed(f, [*so_far, *out], best) for f in jumps]


def leans_in_vain(flight: Flight, best: BestEstimate, limits: Limits, tilted: tuple[float, float]) -> bool:
    """Whether the autopilot leans as the best estimate does, and as that of an IMU that is turned so it does not.

    Its windows alone may take a gyro that begins to be off on a circle for an IMU that sits askew. tilted: its roll and
    pitch, rad.
    """

    def leans(tilted: tuple[float, float]) -> bool:
        return any(one.quantity == "tilt" for one in estimator_deviations(flight, best, limits, tilted))

    return any(tilted) and leans(tilted) and not leans((0.0, 0.0))


def _confirmed(jump: Finding, others: Sequence[Finding], best: BestEstimate) -> Finding:
    """A jump, as serious as the best estimate takes the autopilot to be at that time.

    Without GPS it knows nothing of positions: then a large jump says that the autopilot was wrong before it or is wrong
    after it, and an estimator that corrects itself accuses nobody.
    """
    off = [f for f in others if f.side == "autopilot" and f.severity == "error"]
    if jump.severity != "error" or are_near(off, jump.start_s):
        return jump
    size = jump.cause.size if jump.cause is not None and jump.kind == "position_jump" else None
    if size is not None and size >= kind_of("gps_position").least and "gps_position" not in best.residuals:
        words = (
            f"{jump.evidence}; without GPS it cannot be told whether the position was wrong before it or is after it"
        )
        return replace(jump, side="data", severity="warning", evidence=words, cause=None, undecided=True)
    return replace(jump, severity="info")
