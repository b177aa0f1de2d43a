"""Every IMU of a flight through the same windows, and what another IMU than the judged one reads all the time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from companion.analysis.budget import ATTITUDE, POSITION, budget, chi_square_95, nees, stacked
from companion.analysis.comparison import Comparison, windows
from companion.analysis.drift import DriftRow, drift_of
from companion.analysis.episode import BIAS_UNITS, SENSORS
from companion.analysis.finding import Finding, digits
from companion.analysis.imu_spec import USUAL_BIAS, ImuSpec, ReferenceSpec
from companion.estimation import BestEstimate, differences, kind_of
from companion.model import Array, Flight, ImuTrack

_HORIZON_S = 5.0


@dataclass(frozen=True, slots=True, eq=False)
class RedundantImu:
    """One IMU of several."""

    imu: str
    instance: int
    rate_hz: float
    drift: DriftRow  # after 5 s
    inside: Mapping[str, float]  # attitude, position → share of windows inside the 95 % bound; empty without windows


def each_imu(
    flight: Flight,
    compare_imu: Callable[[str], Comparison],
    imu_spec_of: Callable[[str], ImuSpec],
    autopilot: ReferenceSpec,
) -> tuple[RedundantImu, ...]:
    """Every IMU of the flight with two samples or more, each by its own part's figures."""
    return tuple(
        _redundant(compare_imu(name), imu_spec_of(name), autopilot)
        for name, track in flight.imus.items()
        if len(track) > 1
    )


def _redundant(comparison: Comparison, figures: ImuSpec, autopilot: ReferenceSpec) -> RedundantImu:
    chosen = windows(comparison, _HORIZON_S)
    inside: dict[str, float] = {}
    if len(chosen.start):
        total = budget(comparison, chosen, figures, autopilot).total
        error = stacked(comparison, chosen)
        blocks = {"attitude": ATTITUDE, "position": POSITION} if comparison.has_position else {"attitude": ATTITUDE}
        inside = {
            name: float(np.mean(nees(error[:, b], total[:, b, b]) < chi_square_95(3))) for name, b in blocks.items()
        }
    row = drift_of(comparison, (_HORIZON_S,)).rows[0]
    track = comparison.track
    return RedundantImu(track.source, track.instance, track.rate_hz, row, inside)


def steady_findings(flight: Flight, used: ImuTrack, best: BestEstimate) -> list[Finding]:
    """What another IMU of the flight reads too much all the time, and the best estimate's own does not.

    Where one of the two has an error of another time, what both read all the time tells nothing of the other.
    """
    changed = {(e.imu, kind_of(e.kind).sensor) for e in best.explained if not kind_of(e.kind).nuisance}
    if any(kind_of(e.kind).side == "imu" and e.imu is None for e in best.explained):
        return []
    return [
        biased
        for one in differences(flight, used)
        for sensor, off in one.value.items()
        if (one.instance, sensor) not in changed
        if (biased := _biased(used, flight.imus[one.source], sensor, off, best)) is not None
    ]


def _biased(used: ImuTrack, track: ImuTrack, sensor: str, off: Array, best: BestEstimate) -> Finding | None:
    """Another IMU whose bias is larger than real parts have in flight, all the time; off: of `Differences`."""
    bias = np.median(getattr(best.states, f"{sensor}_bias"), axis=0) + np.median(off, axis=0)
    sigma = np.median(getattr(best, f"{sensor}_bias_sigma"), axis=0)  # that of the difference is far less
    if not (np.abs(bias) > USUAL_BIAS[sensor] + sigma).any():
        return None
    unit, scale, decimals = BIAS_UNITS[sensor]
    return Finding(
        "imus_disagree",
        "imu",
        "warning",
        float(track.t[0]),
        float(track.t[-1]),
        f"{track.source} (IMU {track.instance}): {SENSORS[sensor]} bias ({digits(scale * bias, decimals)}) ± "
        f"{float(sigma.max()) * scale:.{decimals}f} {unit} all the time; {used.source} (IMU {used.instance}), "
        "which was judged, agrees with all other sensors",
        f"Calibrate IMU {track.instance} at rest: the autopilot may switch to it.",
    )
