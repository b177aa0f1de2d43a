"""How many windows of a flight are inside what is expected of them, as the verdict judges them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.analysis.budget import expected_over
from companion.analysis.comparison import Comparison, Windows, windows
from companion.analysis.imu_spec import ImuSpec, ReferenceSpec
from companion.constants import priors
from companion.model import Array, Phase, counted


@dataclass(frozen=True, slots=True)
class Agreement:
    """How many windows of one length are inside the 95 % bound, as they are judged: with the known errors removed.

    Those are what the best estimate and the installation explain of the IMU: its usual bias, lag, mounting. The noise
    is that of the flight, and windows in which nothing is judged are left out.
    """

    horizon_s: float
    windows: int  # used
    excluded: Mapping[str, int]  # windows left out, by reason
    inside: Mapping[str, float]  # attitude, velocity, position → share of the windows; empty without windows

    @property
    def share(self) -> float:
        """In the quantity in which the fewest are inside; 0 without windows."""
        return min(self.inside.values(), default=0.0)

    @property
    def is_consistent(self) -> bool:
        """Whether enough are inside in every quantity."""
        return self.share >= priors.CONSISTENT_SHARE

    def __str__(self) -> str:
        """How many are inside, and what of."""
        what = f"{counted(self.windows, 'window')} of {self.horizon_s:g} s inside the 95 % bound"
        return f"{100.0 * self.share:.0f} % of {what}, known errors removed"


def agreement(
    told: Comparison,
    horizon: float,
    parts: Sequence[Phase],
    usual: ImuSpec,
    autopilot: ReferenceSpec,
    within: Sequence[tuple[float, float]],
) -> Agreement:
    """Of the windows of one length within spans (s) that are judged; told: with the IMU's known errors removed."""
    chosen = while_judged(windows(told, horizon, within=within), told.track.t, parts)
    expected = expected_over(told, chosen, usual, autopilot)
    return Agreement(horizon, len(chosen.start), chosen.excluded, expected.inside if expected else {})


def while_judged(chosen: Windows, t: Array, parts: Sequence[Phase]) -> Windows:
    """The windows in which the estimator has aligned and the vehicle has neither landed nor lost control."""
    out = np.zeros(len(chosen.start), np.bool_)
    for part in parts:
        if part.kind in ("aligning", "landed", "impact"):
            out |= (t[chosen.start] < part.end) & (t[chosen.end] > part.start)
    if not out.any():
        return chosen
    reasons = {**chosen.excluded, "not_judged": int(out.sum())}
    kept = ~out
    return replace(chosen.only(kept), excluded=reasons)
