"""Every IMU of a flight through the same windows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from companion.analysis.budget import ATTITUDE, POSITION, budget, nees, stacked
from companion.analysis.comparison import Comparison, windows
from companion.analysis.drift import DriftRow, drift_of
from companion.analysis.imu_spec import ImuSpec, ReferenceSpec
from companion.constants import num
from companion.estimation import chi_square
from companion.model import Flight


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
    chosen = windows(comparison, num.JUDGED_S)
    inside: dict[str, float] = {}
    if len(chosen.start):
        total = budget(comparison, chosen, figures, autopilot).total
        error = stacked(comparison, chosen)
        blocks = {"attitude": ATTITUDE, "position": POSITION} if comparison.has_position else {"attitude": ATTITUDE}
        inside = {
            name: float(np.mean(nees(error[:, b], total[:, b, b]) < chi_square(3, num.Z_95)))
            for name, b in blocks.items()
        }
    row = drift_of(comparison, (num.JUDGED_S,)).rows[0]
    track = comparison.track
    return RedundantImu(track.source, track.instance, track.rate_hz, row, inside)
