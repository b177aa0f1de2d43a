"""How many windows of a flight are inside what is expected of them, as the verdict judges them.

Also here: a log without windows that can be judged: whether the best estimate speaks for them, and what it would have
shown.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.analysis.budget import expected_over
from companion.analysis.comparison import Comparison, Windows, left_out, windows
from companion.analysis.fault_interval import BIAS_UNITS, SENSORS
from companion.analysis.imu_spec import ImuSpec, ReferenceSpec
from companion.constants import check, num, priors
from companion.estimation import BestEstimate, hypothesis_of
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
    corrected: Comparison,
    horizon: float,
    parts: Sequence[Phase],
    usual: ImuSpec,
    autopilot: ReferenceSpec,
    within: Sequence[tuple[float, float]],
) -> Agreement:
    """Of the windows of one length within spans (s) that are judged; corrected: with the IMU's known errors removed."""
    chosen = while_judged(windows(corrected, horizon, within=within), corrected.track.t, parts)
    expected = expected_over(corrected, chosen, usual, autopilot)
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


def unseen(best: BestEstimate | None, no_windows: str) -> str:
    """Why the best estimate does not speak for windows that there are not; "" where it does.

    Where each fault of the size that such faults have would show in it.
    """
    if best is None or "gyro_bias" not in best.detectable:
        return no_windows
    hidden = [sensor for sensor, size in _biases(best).items() if size > hypothesis_of(f"{sensor}_bias").prior]
    would_not = " and ".join(_bias_of(sensor, best) for sensor in hidden)
    return f"{no_windows}; no fault was found, but {would_not} would not have shown" if hidden else ""


def would_show(best: BestEstimate | None) -> str:
    """The smallest biases that would have shown, in words."""
    return "" if best is None else " or ".join(_bias_of(sensor, best) for sensor in _biases(best))


def _biases(best: BestEstimate) -> dict[str, float]:
    """Sensor of the IMU → the smallest bias that would have shown, SI."""
    return {name: best.detectable[f"{name}_bias"] for name in BIAS_UNITS if f"{name}_bias" in best.detectable}


def _bias_of(sensor: str, best: BestEstimate) -> str:
    unit, scale, decimals = BIAS_UNITS[sensor]
    if _biases(best)[sensor] > check.ANY_BIAS * hypothesis_of(f"{sensor}_bias").prior:
        return f"any bias of the {SENSORS[sensor]}"
    return f"a bias of the {SENSORS[sensor]} of {scale * _biases(best)[sensor]:.{decimals}f} {unit}"


def too_few_windows(judged: Agreement) -> str:
    """Why there are too few windows to be judged; "" where there are enough."""
    if judged.windows >= num.MIN_WINDOWS:
        return ""
    reasons = left_out(judged.excluded)
    short = f"the flight is too short: at least {num.MIN_WINDOWS * num.JUDGED_S:g} s are needed"
    usable = f"only {counted(judged.windows, 'window')}" if judged.windows else "no window"
    return f"{usable} of {num.JUDGED_S:g} s can be used ({f'left out: {reasons}' if reasons else short})"
