"""A log without windows that can be judged: whether the best estimate speaks for them, and what it would have shown."""

from __future__ import annotations

from companion.analysis.agreement import Agreement
from companion.analysis.comparison import left_out
from companion.analysis.fault_interval import BIAS_UNITS, SENSORS
from companion.constants import check, num
from companion.estimation import BestEstimate, kind_of
from companion.model import counted


def unseen(best: BestEstimate | None, no_windows: str) -> str:
    """Why the best estimate does not speak for windows that there are not; "" where it does.

    Where each fault of the size that such faults have would show in it.
    """
    if best is None or "gyro_bias" not in best.detectable:
        return no_windows
    hidden = [sensor for sensor, size in _biases(best).items() if size > kind_of(f"{sensor}_bias").prior]
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
    if _biases(best)[sensor] > check.ANY_BIAS * kind_of(f"{sensor}_bias").prior:
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
