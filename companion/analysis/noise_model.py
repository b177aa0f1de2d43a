"""Which noise figures to believe of an IMU: what its rest shows, else its flight, else its data sheet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from companion.analysis.imu_spec import SensorSpec
from companion.analysis.noise import ImuNoise, RestNoise
from companion.estimation import Coefficient


@dataclass(frozen=True, slots=True)
class ModelFigure:
    """A figure of an IMU model, u/√Hz or u/√s with u rad/s or m/s²."""

    value: float
    source: str  # where it is from, in words
    measured: bool  # in this flight; else the data sheet's


@dataclass(frozen=True, slots=True)
class SensorModel:
    """What Kalibr and the IMU library want to know of the noise of a sensor: of its worst axis."""

    white: ModelFigure  # N, u/√Hz
    walk: ModelFigure  # K, u/√s


def noise_model(noise: ImuNoise) -> tuple[SensorModel, SensorModel]:
    """Gyro and accelerometer. An upper bound replaces the data sheet's figure only where it is smaller than that."""
    return _sensor(noise, "gyro", noise.figures.gyro), _sensor(noise, "accel", noise.figures.accel)


def _sensor(noise: ImuNoise, sensor: Literal["gyro", "accel"], sheet: SensorSpec) -> SensorModel:
    rest = noise.rest
    axes = [axis for axis in getattr(rest, f"{sensor}_axes") if axis is not None] if rest else []
    white = _worst([axis.white for axis in axes], sheet.noise_density, rest, noise)
    walk = _worst([axis.walk for axis in axes if axis.walk is not None], sheet.bias_walk, rest, noise)
    flying = getattr(noise.flight, sensor) if noise.flight else None
    if not axes and flying is not None and noise.flight is not None:
        seen = flying.sampled if flying.hidden.all() else flying.sampled[~flying.hidden]
        text = (
            f"spectrum of {noise.flight.duration_s:.0f} s in flight at {flying.band_hz[0]:.0f} to "
            f"{flying.band_hz[1]:.0f} Hz, vibration included, worst axis"
        )
        white = ModelFigure(float(np.max(seen)), text, measured=True)
    return SensorModel(white, walk)


def _worst(axes: list[Coefficient], sheet: float, rest: RestNoise | None, noise: ImuNoise) -> ModelFigure:
    told = [axis for axis in axes if axis.value is not None]
    if rest is not None and told:
        worst = max(told, key=lambda axis: axis.most)
        text = (
            f"Allan deviation of a rest of {rest.duration_s:.0f} s at {noise.rate_hz:.1f} Hz, worst axis, 95 %: "
            f"{worst.low:.2g} to {worst.high:.2g}"
        )
        return ModelFigure(worst.most, text, measured=True)
    bound = max((axis.high for axis in axes), default=np.inf)
    if bound < sheet:
        return ModelFigure(bound, "upper bound of a rest that is too short or too coarse to show more", measured=True)
    return ModelFigure(sheet, f"not seen in this flight: that of {noise.figures.name}", measured=False)
