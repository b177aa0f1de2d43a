"""Factors of the aiding sensors' readings: what each observes of the keyframes, linear in their errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from companion.estimation.aiding_sensors import SENSORS, SLOW
from companion.estimation.model import (
    ATTITUDE,
    CONSTANT_STATES,
    CONSTANTS,
    GYRO_BIAS,
    POSITION,
    STATES,
    VELOCITY,
)
from companion.estimation.readings import Kinematics, Readings
from companion.estimation.system import Measurement

_BLOCKS: Mapping[str, slice] = {
    "attitude": ATTITUDE, "velocity": VELOCITY, "position": POSITION, "gyro_bias": GYRO_BIAS,
}  # fmt: skip


def measure(one: Readings, at: Kinematics) -> Measurement:
    """The measurement factor of an aiding sensor about its states; weights 1."""
    count, d = one.value.shape
    h, h_c = np.zeros((count, d, STATES)), np.zeros((count, d, CONSTANT_STATES))
    sensor = SENSORS[one.name]
    predicted = sensor.predict(one, at)
    for name, derivative in predicted.derivatives.items():
        if name in _BLOCKS:
            h[:, :, _BLOCKS[name]] = derivative
        else:
            h_c[:, :, CONSTANTS[name][0]] = derivative
    residual = one.value - predicted.value
    return Measurement(one.name, one.t, one.keyframe, residual, h, h_c, one.sigma, np.ones(count), sensor.unit)


def slow_places(readings: Sequence[Readings]) -> dict[str, slice]:
    """Aiding sensor → place of its slow error among the states of a keyframe, behind those of the motion."""
    places, at = dict[str, slice](), STATES
    for one in readings:
        if one.name in SLOW:
            places[one.name] = slice(at, at + one.value.shape[1])
            at = places[one.name].stop
    return places
