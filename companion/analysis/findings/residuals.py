"""What an IMU reads too much, in short windows: they say when an error begins and ends, which no long fit can."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.analysis.budget import VELOCITY, window_noise
from companion.analysis.comparison import Comparison, Windows, errors, windows
from companion.constants import check
from companion.model import Array
from companion.strapdown import Propagation, quaternion

GYRO_BIAS = slice(9, 12)  # places in the 15-state error of `propagate`
ACCEL_BIAS = slice(12, 15)


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """The errors of short windows, as readings that are too large. Force is zero for a flight without position."""

    chosen: Windows
    begin: Array  # (W,) s, boot clock
    end: Array  # (W,)
    q_ned_frd: Array  # (W, 4) the autopilot's attitude where the window begins
    attitude: Array  # (W, 3) error at the end, autopilot minus IMU: rotation vector in NED, rad
    velocity: Array  # (W, 3) likewise, NED m/s
    growth: Propagation
    noise: Array  # (W, 2) standard error of a window's mean reading: rad/s, m/s²
    interpolated: Array  # (W, 2) 1σ of what the ends' interpolation makes of the error per axis: rad, m/s
    rate: Array  # (W, 3) rad/s, FRD: what the gyro turned more than the attitude
    force: Array  # (W, 3) m/s², FRD: what the accelerometer felt more than the velocity says

    def __len__(self) -> int:
        return len(self.begin)

    @property
    def span(self) -> Array:
        """(W, 1) s"""
        return (self.end - self.begin)[:, None]


def residuals(comparison: Comparison) -> Residuals:
    """The short windows of a comparison."""
    chosen = windows(comparison, check.SHORT_S)
    window_errors = errors(comparison, chosen)
    begin = comparison.reference.at(chosen.start)
    growth = comparison.growth(chosen)
    span = (window_errors.end_s - window_errors.anchor_s)[:, None]
    ends = [comparison.reference.interpolation_error(i, comparison.path) for i in (chosen.start, chosen.end)]
    back = quaternion.conjugate(begin.q_ned_frd)
    # to first order truth minus estimate is -(bias) t: with the sign turned, and in the body, it is the bias
    rate = -quaternion.rotate(back, window_errors.attitude) / span
    force = np.zeros_like(rate)
    if comparison.has_position:
        # a gyro bias leans gravity over; that is not the accelerometer's
        leaned = np.einsum("wij,wj->wi", growth.transition[:, VELOCITY, GYRO_BIAS], rate)
        force = -quaternion.rotate(back, window_errors.velocity - leaned) / span
    return Residuals(
        chosen=chosen,
        begin=window_errors.anchor_s,
        end=window_errors.end_s,
        q_ned_frd=begin.q_ned_frd,
        attitude=window_errors.attitude,
        velocity=window_errors.velocity if comparison.has_position else np.zeros_like(rate),
        growth=growth,
        noise=window_noise(comparison.track, chosen) / np.sqrt(span),
        interpolated=np.sqrt(sum(np.column_stack([end.attitude, end.velocity]) ** 2 for end in ends)),
        rate=rate,
        force=force,
    )
