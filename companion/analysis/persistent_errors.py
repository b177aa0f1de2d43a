"""The best estimate's figures of an IMU's lasting errors, as a calibration has them, and its trajectory as a judge."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from companion.analysis.budget import persistent_step_error
from companion.analysis.comparison import Comparison, Windows
from companion.analysis.correction import ACCEL_MISALIGNED, GYRO_MISALIGNED, NAMES, PARTS
from companion.analysis.imu_spec import ImuSpec
from companion.analysis.reference import BoolArray, IntArray, InterpolationError, Reference, States
from companion.constants import healthy, num
from companion.estimation import BestEstimate, ConstantErrors, allowing
from companion.model import Array, Flight, ImuTrack
from companion.strapdown import Preintegration

_COMMON = ("gyro_bias", "accel_bias", "gyro_scale", "accel_scale", "gyro_misalignment", "accel_misalignment")
"""Parts of a calibration that the best estimate has figures of too."""


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """What is known of the figures of a calibration without the autopilot's estimate; zero for what is not."""

    values: Array  # (28,)
    covariance: Array  # (28, 28)
    told: BoolArray  # (28,) which of them are observable


def known_from(errors: ConstantErrors, imu: ImuSpec, track: ImuTrack) -> Known:
    """The same errors in the terms of a calibration of a track, of which they are."""
    wider, turn = allowing(errors, imu.gyro.scale_tolerance, imu.accel.scale), _to_figures()
    place = np.concatenate([np.arange(len(NAMES))[PARTS[part]] for part in _COMMON])
    values, possible = np.zeros(len(NAMES)), np.zeros(len(NAMES))
    covariance = persistent_covariance(track)
    values[place] = turn @ wider.values
    covariance[np.ix_(place, place)] += turn @ wider.covariance @ turn.T
    possible[place] = np.sqrt(np.diag(turn @ np.diag(wider.possible**2) @ turn.T))
    observable = np.sqrt(np.diag(covariance)) < num.OBSERVABLE * np.maximum(possible, np.abs(values))
    return Known(values, covariance, observable)


def persistent_covariance(track: ImuTrack) -> Array:
    """(28, 28) of what truncation takes from every reading of a flight, which no fit can tell from a bias."""
    out = np.zeros((len(NAMES), len(NAMES)))
    for part, readings, step in (
        ("gyro_bias", track.gyro, track.gyro_step),
        ("accel_bias", track.accel, track.accel_step),
    ):
        out[PARTS[part], PARTS[part]] = np.diag(persistent_step_error(readings, step) ** 2)
    return out


def steady_error(best: BestEstimate, sensor: str) -> tuple[Array, Array]:
    """What "gyro" or "accel" reads too much all the time, (3,) FRD, and its 1σ, rad/s or m/s².

    Of an accelerometer when level, bias and scale together.
    """
    value = np.median(getattr(best.states, f"{sensor}_bias"), axis=0)
    if sensor == "accel":
        value = value + best.states.constant("accel_matrix").reshape(3, 3) @ [0.0, 0.0, -best.gravity]
    return value, np.median(getattr(best, f"{sensor}_bias_sigma"), axis=0)


def level_is_unusual(best: BestEstimate, flight: Flight) -> bool:
    """Whether an accelerometer reads more too much when level than a part in order does, unknown to the autopilot."""
    value, sigma = steady_error(best, "accel")
    held = next((one for one in flight.biases if one.imu_instance == best.imu.instance and len(one)), None)
    theirs = np.full(3, np.nan) if held is None else np.median(held.accel, axis=0)
    known = np.abs(value - theirs) <= num.SIGMAS * sigma
    return bool(((np.abs(value) > healthy.USUAL_BIAS["accel"] + num.SIGMAS * sigma) & ~known).any())


ALL_THE_TIME = "it was so from the beginning on: calibration, mounting or what the model lacks would look like it"


def _to_figures() -> Array:
    """(21, 24): the figures of _COMMON from the best estimate's biases and matrices.

    Its matrices M are full: (I - M) = (I + [u]x)(I + E) to first order, E that of the accelerometer lower triangular.
    The turn u = (M₁₂, -M₀₂, M₀₁) of the accelerometer's is one of the IMU's axes, which `mounting` has.
    """
    gyro, accel = (np.eye(24)[start : start + 9].reshape(3, 3, 24) for start in (6, 15))
    u = np.stack([accel[1, 2], -accel[0, 2], accel[0, 1]])
    zero = np.zeros(24)
    cross = np.array([[zero, -u[2], u[1]], [u[2], zero, -u[0]], [-u[1], u[0], zero]])
    gyro, accel = -gyro - cross, -accel - cross
    diagonal = np.arange(3)
    (rows, columns), (low, left) = (np.transpose(places) for places in (GYRO_MISALIGNED, ACCEL_MISALIGNED))
    return np.concatenate(
        [np.eye(6, 24), gyro[diagonal, diagonal], accel[diagonal, diagonal], gyro[rows, columns], accel[low, left]]
    )


def beside_best(own: Comparison, best: BestEstimate, chosen: Windows) -> tuple[Comparison, Windows]:
    """The same track beside the best estimate in place of the autopilot's, and those of the windows in which it is."""
    t, index = own.track.t, best.index
    within = chosen.only((chosen.start >= index[0]) & (chosen.end <= index[-1]))
    samples = np.unique(np.concatenate([within.start, within.end]))
    known, nowhere = np.zeros(len(t), np.bool_), np.zeros(len(t), np.bool_)
    known[samples] = True
    placed = known if "gps_position" in best.residuals else nowhere
    states = States(*best.at(t[samples]))
    return own.beside(Reference(t, known, placed, partial(_looked_up, samples, states), _not_interpolated)), within


def _looked_up(samples: IntArray, states: States, index: IntArray) -> States:
    """The states at samples `index`, of those at `samples`, ascending."""
    return states.rows(np.searchsorted(samples, index))


def _not_interpolated(index: IntArray, _: Preintegration) -> InterpolationError:
    """The best estimate follows the IMU from sample to sample."""
    return InterpolationError(*(np.zeros(len(index)) for _ in range(3)))
