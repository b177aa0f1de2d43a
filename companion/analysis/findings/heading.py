"""The autopilot's heading held against the direction of its own accelerations."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from companion.analysis.comparison import Comparison
from companion.analysis.figures import ImuFigures, ReferenceFigures
from companion.analysis.finding import Finding
from companion.analysis.findings.residuals import Residuals
from companion.strapdown import quaternion
from companion.tracks import Array

_LEAST = np.radians(10.0)
_FEWEST = 8  # windows
_CERTAIN = 6.0  # standard errors
_ROUNDS = 8


def heading_findings(
    comparison: Comparison, found: Residuals, imu: ImuFigures, autopilot: ReferenceFigures
) -> Iterator[Finding]:
    """The forces that the IMU feels point past the accelerations of the autopilot's velocity, all by one angle.

    A wrong heading turns every horizontal acceleration about down, and tilts nothing. An offset of the accelerometer,
    fixed in the body, must not explain it as well.
    """
    if not comparison.has_position or len(found) < _FEWEST or comparison.track.rate_hz < 10.0:
        return
    reference, chosen = comparison.reference, found.chosen
    gained = (reference.velocity[chosen.end] - reference.velocity[chosen.start])[:, :2]
    felt = gained - found.velocity[:, :2]
    sigma = np.sqrt(2.0) * autopilot.velocity + (found.noise[:, 1] + 9.8 * autopilot.tilt) * found.span[:, 0]
    offset = quaternion.to_matrix(found.q_ned_frd)[:, :2] * found.span[:, :, None]  # (W, 2, 3) per m/s² in the body
    turned = np.stack([felt, np.column_stack([-felt[:, 1], felt[:, 0]])], axis=2)  # (W, 2, 2) cos, sin
    bias = 2.0 * imu.accel.residual_bias
    loose = np.concatenate([[1e3, 1e3], np.full(3, bias)])
    both, spread, misfit = _fit(np.concatenate([turned, offset], axis=2), gained, sigma, loose)
    straight = _fit(offset, gained - felt, sigma, np.full(3, 1e3))[2]  # as it is, with any offset
    size, angle = float(np.hypot(both[0], both[1])), float(np.arctan2(both[1], both[0]))
    error = float(np.hypot(spread[0], spread[1])) / max(size, 1e-9)
    if abs(angle) < max(_LEAST, _CERTAIN * error) or not 0.75 < size < 1.3 or misfit > 0.4 * straight:
        return
    yield Finding(
        "heading_wrong",
        "autopilot",
        "error",
        *found.between(0, -1),
        f"its heading is {np.degrees(abs(angle)):.0f} ± {np.degrees(error):.0f}° off: "
        "the forces that the IMU feels point past the vehicle's accelerations by that, and its tilt is right",
        "Calibrate the compass, away from steel, and check its orientation (COMPASS_ORIENT) and the declination.",
    )


def _fit(jacobian: Array, target: Array, sigma: Array, prior: Array) -> tuple[Array, Array, float]:
    """Robust least squares (Cauchy) over windows: the solution, its standard errors, the median squared misfit."""
    x, weight = np.zeros(jacobian.shape[2]), sigma**-2.0
    information = np.diag(prior**-2.0)
    for _ in range(_ROUNDS):
        information = np.diag(prior**-2.0) + np.einsum("w,wij,wik->jk", weight, jacobian, jacobian)
        x = np.linalg.solve(information, np.einsum("w,wij,wi->j", weight, jacobian, target))
        normalised = ((target - jacobian @ x) ** 2).sum(axis=1) / sigma**2
        weight = 1.0 / (sigma**2 * (1.0 + normalised / 6.0))
    spread = float(np.median(normalised)) / 1.39  # the median of chi-square with two degrees of freedom
    return x, np.sqrt(np.diag(np.linalg.inv(information)) * max(1.0, spread)), float(np.median(normalised))
