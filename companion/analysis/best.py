"""The best estimate of a flight from the readings that are some, and what it says of the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from companion.analysis.comparison import Comparison
from companion.analysis.finding import Finding
from companion.analysis.findings import missed_findings
from companion.analysis.findings.axes import misread_finding
from companion.estimation import BestEstimate, other_reading, smooth
from companion.model import Flight, NoEstimateError, Phase

_UNTRUSTED = ("frozen", "stuck_axis", "gyro_clipping", "accel_clipping")


def best_estimate(
    flight: Flight,
    comparison: Comparison,
    faults: Sequence[Finding],
    lost: Phase | None,
    before: BestEstimate | None,
    *,
    differ: bool,
) -> tuple[BestEstimate | NoEstimateError, list[Finding]]:
    """The best estimate, with the IMU's readings left out where they are none; or why there is none.

    And what it says of the readings: an axis that is stuck, or another way to read the axes that fits far better. The
    latter where IMU and autopilot differ, which take turns and forces for the same with the right axes alone, and where
    GPS tells of these: a compass and gravity by themselves fit many ways.
    lost: from when on nothing is. differ: whether windows that are enough to be judged do.
    """
    imu, gravity = comparison.track.source, comparison.how.gravity
    if any(f.kind == "units_wrong" for f in faults):
        return NoEstimateError(imu, "its readings are of other units", "Try another IMU: --imu."), []
    untrusted = [(f.start_s - 0.5, f.end_s + 0.5) for f in faults if f.kind in _UNTRUSTED]
    span = None if lost is None else (-np.inf, lost.start)
    try:
        best = smooth(flight, imu, gravity=gravity, span=span, untrusted=untrusted, before=before)
    except NoEstimateError as why:
        return why, []

    def without(aiding: str) -> BestEstimate | None:
        if not any(name.startswith(aiding) for name in best.residuals):
            return None
        other = replace(flight, **{"compass": {"compasses": ()}, "gps": {"gps": ()}}[aiding])
        try:
            return smooth(other, imu, gravity=gravity, span=span, untrusted=untrusted)
        except NoEstimateError:
            return None

    others = [track for track in flight.imus.values() if track.instance != comparison.track.instance]
    stuck = [f for f in missed_findings(comparison, best, others, without) if f not in faults]
    if stuck:
        best_without, told = best_estimate(flight, comparison, [*faults, *stuck], lost, before, differ=differ)
        return best_without, [*stuck, *told]
    if not differ or "gps_position" not in best.residuals or any(f.kind == "axes_wrong" for f in faults):
        return best, []
    other = other_reading(flight, best, gravity=gravity, span=span, untrusted=untrusted)
    return best, [] if other is None else [misread_finding(flight.imu(imu), other, best)]
