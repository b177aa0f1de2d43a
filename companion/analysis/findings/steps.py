"""Findings about a bias that steps inside a flight: a calibration saved while running, a sensor that was knocked."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from companion.analysis.compare import length
from companion.analysis.comparison import Comparison
from companion.analysis.figures import ImuFigures
from companion.analysis.finding import Finding, digits
from companion.analysis.findings.biases import BIAS_RATE_HZ
from companion.analysis.findings.residuals import Residuals
from companion.tracks import Array

_SIDE = 8  # windows on either side
_FEWEST = 4
_STEP = 3.0  # times what calibration leaves
_CERTAIN = 6.0  # standard errors


def step_findings(comparison: Comparison, found: Residuals, imu: ImuFigures) -> Iterator[Finding]:
    """One finding for each time at which the bias of a sensor steps from one lasting level to another."""
    if comparison.track.rate_hz < BIAS_RATE_HZ:
        return
    for name, value, least, unit, factor, decimals in (
        ("gyro", found.rate, _STEP * imu.gyro.residual_bias + comparison.track.gyro_step, "mrad/s", 1e3, 1),
        ("accelerometer", found.force, _STEP * imu.accel.residual_bias, "m/s²", 1.0, 2),
    ):
        for k, before, after in _steps(value, least):
            at = float(0.5 * (found.end[k - 1] + found.begin[k]))
            old, new = (digits(level * factor, decimals) for level in (before, after))
            yield Finding(
                "bias_step",
                "imu",
                "warning",
                float(found.begin[k - 1]),
                float(found.end[k]),
                f"the {name}'s bias steps at {at:.0f} s from ({old}) to ({new}) {unit}",
                "A calibration that was saved while running, or a sensor that was knocked or warmed. Calibrate at rest "
                "before take-off, and judge the parts of the flight by themselves.",
            )


def _steps(value: Array, least: float) -> Iterator[tuple[int, Array, Array]]:
    """(first window after it, level before, level after) of each step, the clearest first."""
    count = len(value)
    misfit = np.full(count, np.inf)  # of two levels that meet at each window
    for k in range(_FEWEST, count - _FEWEST + 1):
        before, after = _sides(value, k)
        old, new = np.median(before, axis=0), np.median(after, axis=0)
        off = length(before - old), length(after - new)
        # both sides have to stand still: a level, not a slope or a swing
        scatter = max(float(np.median(off[0])), float(np.median(off[1])))
        error = 1.3 * scatter * np.sqrt(1 / len(before) + 1 / len(after))
        step = float(length(new - old))
        if step > max(least, _CERTAIN * error) and step > 2.0 * scatter:
            misfit[k] = float(off[0].mean() + off[1].mean())
    while np.isfinite(misfit).any():
        k = int(np.argmin(misfit))
        before, after = _sides(value, k)
        yield k, np.median(before, axis=0), np.median(after, axis=0)
        misfit[max(0, k - _SIDE) : k + _SIDE] = np.inf


def _sides(value: Array, k: int) -> tuple[Array, Array]:
    return value[max(0, k - _SIDE) : k], value[k : k + _SIDE]
