"""The drift that the error budget allows, and how many windows are inside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from companion.analysis.budget import (
    ATTITUDE,
    POSITION,
    VELOCITY,
    budget,
    chi_square_95,
    chi_square_999,
    nees,
    stacked,
)
from companion.analysis.comparison import Comparison, Windows
from companion.analysis.imu_spec import ImuSpec, ReferenceSpec

_BLOCKS = {"attitude": ATTITUDE, "velocity": VELOCITY, "position": POSITION}


@dataclass(frozen=True, slots=True)
class Expected:
    """The drift that the budget allows at one horizon, 1σ of the error's length, and what it is made of."""

    attitude_deg: float
    velocity_mps: float | None
    position_m: float | None
    shares: Mapping[str, Mapping[str, float]]  # attitude, velocity, position → cause → part of the mean square
    inside: Mapping[str, float]  # attitude, velocity, position → share of windows inside the 95 % bound of their NEES
    plausible: Mapping[str, float]  # the same for the 99.9 % bound


def expected_over(
    comparison: Comparison, chosen: Windows, figures: ImuSpec, autopilot: ReferenceSpec
) -> Expected | None:
    if not len(chosen.start):
        return None
    allowed = budget(comparison, chosen, figures, autopilot)
    error, total = stacked(comparison, chosen), allowed.total
    blocks = _BLOCKS if comparison.has_position else {"attitude": ATTITUDE}
    sigma = {name: float(np.median(allowed.sigma(block))) for name, block in blocks.items()}
    normalised = {name: nees(error[:, block], total[:, block, block]) for name, block in blocks.items()}
    return Expected(
        attitude_deg=float(np.degrees(sigma["attitude"])),
        velocity_mps=sigma.get("velocity"),
        position_m=sigma.get("position"),
        shares={name: allowed.shares(block) for name, block in blocks.items()},
        inside={name: float(np.mean(value < chi_square_95(3))) for name, value in normalised.items()},
        plausible={name: float(np.mean(value < chi_square_999(3))) for name, value in normalised.items()},
    )
