"""The constant IMU errors that best explain a flight, with their uncertainty, and what the flight does not tell.

Each window's error is linear in them, r = J x + ε, with the Jacobians of the error propagation and the budget of
everything else as the covariance of ε. Solved by weighted least squares with the sensor's tolerances as prior, robust
against single windows (Huber on the normalised error), and again about the corrected track until it stands still.

A window has the autopilot's word at its two ends; the best estimate hears GPS, compass and gravity all the time. What
that tells is taken from it, for the autopilot may be wrong, and what the windows say of the rest follows.

What lasts through the flight and is not the IMU's is solved for beside them, so that no figure claims to be better
known than it is: the autopilot's own tilt and heading error, and gravity. No average over windows makes those smaller.

Also here: the errors themselves, as they are taken from the readings afterwards; and the best estimate's figures of
them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from itertools import accumulate
from typing import Final

import numpy as np

from companion.comparison.budget import Budget, budget, nees, persistent_step_error, stacked, turn_jacobian
from companion.comparison.imu_spec import ImuSpec, ReferenceSpec
from companion.comparison.windows import Comparison, Windows, windows
from companion.constants import healthy, num
from companion.estimation import ConstantErrors, allowing
from companion.model import STANDARD_GRAVITY, Array, BoolArray, ImuTrack, brief
from companion.noise import chi_square
from companion.strapdown import quaternion

GYRO_MISALIGNED: Final = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))
ACCEL_MISALIGNED: Final = ((1, 0), (2, 0), (2, 1))
"""Row and column of each misalignment in its sensor's matrix. The accelerometer's is lower triangular: it defines the
IMU's axes, which `mounting` turns into the attitude's (Rehder et al. 2016, Extending kalibr)."""

_XYZ = ("x", "y", "z")
_FIGURES: Final[Mapping[str, tuple[str, ...]]] = {
    **dict.fromkeys(("gyro_bias", "accel_bias", "mounting"), _XYZ),
    "time_offset": ("",),
    **dict.fromkeys(("gyro_scale", "accel_scale"), _XYZ),
    "gyro_misalignment": tuple("xyz"[i] + "xyz"[j] for i, j in GYRO_MISALIGNED),
    "accel_misalignment": tuple("xyz"[i] + "xyz"[j] for i, j in ACCEL_MISALIGNED),
    "lever_arm": _XYZ,
}
_ENDS = zip(_FIGURES.items(), accumulate(map(len, _FIGURES.values())), strict=True)
PARTS: Final[Mapping[str, slice]] = {part: slice(end - len(axes), end) for (part, axes), end in _ENDS}
"""The attributes of a Correction, and their places when all are one vector."""

NAMES: Final = tuple(f"{part}_{axis}".rstrip("_") for part, axes in _FIGURES.items() for axis in axes)
"""One name for each figure, in the order of the vector."""


def _zeros() -> Array:
    return np.zeros(3)


@dataclass(frozen=True, slots=True, eq=False)
class Correction:
    """What is taken from an IMU's readings: true = (1 + [mounting]x)(1 + E)(measured - bias), at t - time_offset.

    E is a sensor's matrix of scale (diagonal) and misalignment. With a lever arm r, what the IMU feels only because it
    is not at the body's origin is taken from the specific force: α x r + ω x (ω x r).
    """

    gyro_bias: Array = field(default_factory=_zeros)  # rad/s
    accel_bias: Array = field(default_factory=_zeros)  # m/s²
    mounting: Array = field(default_factory=_zeros)  # rad, small rotation of its axes into those of the attitude, FRD
    time_offset: float = 0.0  # s by which the IMU's times lag behind the autopilot's estimate
    gyro_scale: Array = field(default_factory=_zeros)  # part of the reading that is missing
    accel_scale: Array = field(default_factory=_zeros)
    gyro_misalignment: Array = field(default_factory=lambda: np.zeros(6))  # rad, in the order of GYRO_MISALIGNED
    accel_misalignment: Array = field(default_factory=_zeros)  # rad, in the order of ACCEL_MISALIGNED
    lever_arm: Array = field(default_factory=_zeros)  # m, FRD, from the point that the autopilot reports to the IMU

    @classmethod
    def of(cls, values: Array) -> Correction:
        """From one vector (28,) in the order of PARTS."""
        parts = {name: values[place] for name, place in PARTS.items() if name != "time_offset"}
        return cls(**parts, time_offset=float(values[PARTS["time_offset"]][0]))

    @property
    def values(self) -> Array:
        """All as one vector (28,) in the order of PARTS."""
        return np.concatenate([np.atleast_1d(getattr(self, f.name)) for f in fields(self)])

    def apply(self, track: ImuTrack) -> ImuTrack:
        """The track freed of these errors; itself where there are none."""
        if not self.values.any():
            return track
        turn = np.eye(3) + np.cross(self.mounting, np.eye(3)).T
        gyro_matrix = _matrix(self.gyro_scale, self.gyro_misalignment, GYRO_MISALIGNED)
        accel_matrix = _matrix(self.accel_scale, self.accel_misalignment, ACCEL_MISALIGNED)
        gyro = (track.gyro - self.gyro_bias) @ (turn @ gyro_matrix).T
        accel = (track.accel - self.accel_bias) @ (turn @ accel_matrix).T
        if self.lever_arm.any() and len(track) > 1:
            # differences of the noisy rate are noisy, but telescope in the integral that they are made for
            angular = np.gradient(gyro, track.t, axis=0)
            swing = quaternion.cross(gyro, self.lever_arm)
            accel = accel - quaternion.cross(angular, self.lever_arm) - quaternion.cross(gyro, swing)
        return replace(track, t=track.t - self.time_offset, gyro=gyro, accel=accel)


NO_CORRECTION: Final = Correction()


def _matrix(scale: Array, misalignment: Array, places: tuple[tuple[int, int], ...]) -> Array:
    matrix = np.diag(1.0 + scale)
    rows, columns = zip(*places, strict=True)
    matrix[rows, columns] = misalignment
    return matrix


_COUNT = len(NAMES)
_PERSISTENT: Final = ("autopilot_tilt_north", "autopilot_tilt_east", "autopilot_heading", "gravity")
_SOLVED_FOR: Final = ("gyro_bias", "accel_bias", "misalignment", "time_offset", "scale", "gravity")
"""Causes of the budget that the unknowns replace."""


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """The errors that explain the flight best."""

    __repr__ = brief

    correction: Correction  # what is worth applying: what is observable or `assumed`, zero for the rest
    values: Array  # (28,) in the order of NAMES; where not observable mostly the prior
    sigma: Array  # (28,) standard errors
    observable: tuple[bool, ...]  # (28,)
    assumed: tuple[bool, ...]  # (28,) biases that are told only if all that is not observable is zero: in `correction`
    assumed_sigma: Array  # (28,) their standard errors then; elsewhere `sigma`
    confounded: tuple[str, ...]  # (28,) the figure that a figure which is not observable goes with, or ""
    level_force: tuple[float, float]  # m/s² that accel z is off by at 1 g, bias and scale together, and standard error
    from_best: tuple[bool, ...]  # (28,) what is the best estimate's
    windows: int  # fitted
    horizon_s: float
    residual: float  # median normalised error of the windows after the fit, per degree of freedom; about 1 is right

    def score(self, part: str) -> bool:
        """Whether the flight tells any figure of a part of PARTS."""
        return any(self.observable[PARTS[part]])

    def observed_by_best(self, part: str) -> bool:
        """Whether any figure of a part of PARTS is, and is told."""
        return any(np.logical_and(self.observable, self.from_best)[PARTS[part]])


def calibrate(
    own: Comparison,
    imu: ImuSpec,
    autopilot: ReferenceSpec,
    *,
    horizon: float = 5.0,
    until: float = np.inf,
    known: Known | None = None,
    iterations: int = 8,
) -> Calibration | None:
    """Fit the errors of the IMU to windows of `horizon` seconds. None without windows.

    until: when the windows have to end, s, boot clock; known: what the best estimate says of the errors.
    """
    prior = _prior(imu, autopilot)
    comparison, seen = own, own.track[: int(np.searchsorted(own.track.t, until + num.CAL_BEYOND_S))]
    values = np.zeros(_COUNT)
    weight, near, before = np.ones(0), False, np.inf
    for _ in range(iterations):
        chosen = windows(comparison, horizon)
        chosen = chosen.only(comparison.track.t[chosen.end] <= until)
        if not len(chosen.start):
            return None
        size = 9 if comparison.has_position else 3
        error = stacked(comparison, chosen)[:, :size]
        if len(weight) != len(error):
            weight, near = np.ones(len(error)), False
        if not near:  # the last step was long: the derivatives are others now
            expected = budget(comparison, chosen, imu, autopilot)
            jacobian = _jacobian(expected, comparison, chosen)[:, :size]
            rest = sum(own for name, own in expected.causes.items() if name not in _SOLVED_FOR)
            covariance = np.asarray(rest)[:, :size, :size]
        step, joint = _solve(error, jacobian, covariance, weight, prior, values)
        normalised = nees(error - jacobian @ step, covariance)
        weight = np.minimum(1.0, chi_square(size, num.Z_95) / np.maximum(normalised, 1e-12))
        values = values + step[:_COUNT]
        moved = float((np.abs(step[:_COUNT]) / np.sqrt(np.diag(joint)[:_COUNT])).max())
        if moved < num.CAL_CONVERGED or (near and moved > num.CAL_SHORTER * before):
            break
        near, before = moved < num.CAL_NEAR, moved
        comparison = own.of(Correction.of(values).apply(seen))
    spread = float(np.median(normalised)) / size
    joint = joint * max(1.0, spread)
    joint[:_COUNT, :_COUNT] += persistent_covariance(own.track)
    enough = num.OBSERVABLE * np.maximum(prior[:_COUNT], np.abs(values))  # a sensor may be off by more than its kind
    taken = np.zeros(_COUNT, np.bool_) if known is None else known.observable
    if known is not None:
        values, joint = _given(values, joint, taken, known.values, known.covariance)
        enough = np.where(taken, np.inf, enough)
    return _calibration(values, joint, enough, taken, len(error), horizon, spread)


def _calibration(
    values: Array, joint: Array, enough: Array, from_best: BoolArray, count: int, horizon: float, residual: float
) -> Calibration:
    """What the flight tells of figures with a joint covariance (32, 32): those with a 1σ below `enough` (28,)."""
    own = joint[:_COUNT, :_COUNT]
    sigma = np.sqrt(np.diag(own))
    seen = sigma < enough
    biases = np.arange(_COUNT) < PARTS["accel_bias"].stop
    # What tilt, mounting and bias explain together is put down to the bias, if the flight tells it then.
    kept, left = _given(values, own, ~seen & ~biases)
    given = np.sqrt(np.diag(left))
    assumed = ~seen & biases & (given < enough)
    kept, _ = _given(kept, left, ~seen & ~assumed)
    alike = np.abs(joint / np.sqrt(np.outer(np.diag(joint), np.diag(joint))))
    np.fill_diagonal(alike, 0.0)
    partner = alike[:_COUNT].argmax(axis=1)
    known = (*NAMES, *_PERSISTENT)
    confounded = ~seen & (alike[np.arange(_COUNT), partner] > num.CONFOUNDED)
    vertical = np.zeros(_COUNT)
    vertical[PARTS["accel_bias"].stop - 1], vertical[PARTS["accel_scale"].stop - 1] = 1.0, STANDARD_GRAVITY
    return Calibration(
        correction=Correction.of(kept),
        values=values,
        sigma=sigma,
        observable=tuple(seen.tolist()),
        assumed=tuple(assumed.tolist()),
        assumed_sigma=np.where(assumed, given, sigma),
        confounded=tuple(known[j] if goes else "" for j, goes in zip(partner, confounded, strict=True)),
        level_force=(float(vertical @ values), float(np.sqrt(vertical @ own @ vertical))),
        from_best=tuple(from_best.tolist()),
        windows=count,
        horizon_s=horizon,
        residual=residual,
    )


def _given(
    values: Array, covariance: Array, where: BoolArray, known: Array | float = 0.0, uncertain: Array | None = None
) -> tuple[Array, Array]:
    """Values (28,) and covariance of all, (28, 28) or with what is beside them, once some are known from elsewhere.

    known: what those are, with its covariance, of all 28; without one they have none. What is known counts alone, and
    its uncertainty is that of the rest too (Schmidt 1966).
    """
    fixed = np.append(where, np.zeros(len(covariance) - len(where), np.bool_))
    gain = covariance[:, fixed] @ np.linalg.pinv(covariance[np.ix_(fixed, fixed)], hermitian=True)
    gain[fixed] = np.eye(int(where.sum()))
    fixed_values = np.broadcast_to(known, values.shape)[where]
    moved = values + gain[: len(values)] @ (fixed_values - values[where])
    left = covariance - gain @ covariance[fixed]
    left[fixed], left[:, fixed] = 0.0, 0.0
    return moved, left if uncertain is None else left + gain @ uncertain[np.ix_(where, where)] @ gain.T


def _prior(imu: ImuSpec, autopilot: ReferenceSpec) -> Array:
    """1σ (32,) of what is possible beforehand: the sensor's tolerances, then what lasts beside them.

    No autopilot calibrates a gyro's scale, so there it is the part's tolerance; an accelerometer's is what is left when
    it has been calibrated in six positions.
    """
    parts = {
        "gyro_bias": imu.gyro.offset,
        "accel_bias": imu.accel.offset,
        "mounting": healthy.MOUNTING_RAD,
        "time_offset": healthy.TIME_OFFSET_S,
        "gyro_scale": imu.gyro.scale_tolerance,
        "accel_scale": imu.accel.scale,
        "gyro_misalignment": autopilot.misalignment,
        "accel_misalignment": autopilot.misalignment,
        "lever_arm": healthy.LEVER_ARM_M,
    }
    lasting = (autopilot.tilt, autopilot.tilt, autopilot.heading, autopilot.gravity)
    own = [np.full(place.stop - place.start, parts[name]) for name, place in PARTS.items()]
    return np.asarray(np.maximum(np.concatenate([*own, lasting]), 1e-9))  # a setting may be zero


def _jacobian(expected: Budget, comparison: Comparison, chosen: Windows) -> Array:
    """(W, 9, 32) change of the error per unit of each unknown."""
    growth, diagonal = expected.propagation, np.arange(3)
    pairs = ((growth.gyro_matrix, GYRO_MISALIGNED), (growth.accel_matrix, ACCEL_MISALIGNED))
    first = growth.transition[:, :9, 9:15], turn_jacobian(growth), growth.time_offset[:, :, None]
    # the matrices are per error δ = E w that is taken off; here it is added
    scales = (-matrix[:, :, diagonal, diagonal] for matrix, _ in pairs)
    misaligned = (-matrix[(slice(None), slice(None), *np.transpose(places))] for matrix, places in pairs)
    leaning = growth.transition[:, :9, :3] - np.eye(9, 3)  # both ends lean alike: the attitude itself does not show it
    lasting = lever_jacobian(comparison, chosen), leaning, growth.gravity[:, :, None]
    return np.concatenate([*first, *scales, *misaligned, *lasting], axis=2)


def lever_jacobian(comparison: Comparison, chosen: Windows) -> Array:
    """(W, 9, 3): error per metre from the point that the autopilot reports to the IMU, FRD.

    The IMU is at p + C r and moves with v + C (ω x r), but is started from v and p: dead reckoning is of another point.
    """
    track, reference = comparison.track, comparison.reference
    c0, c1 = (quaternion.to_matrix(reference.at(i).q_ned_frd) for i in (chosen.start, chosen.end))
    turns = ((c0, track.gyro[chosen.start]), (c1, track.gyro[chosen.end]))
    swing0, swing1 = (c @ np.cross(np.eye(3), rate[:, None]) for c, rate in turns)  # the rows of [ω]x are e x ω
    tau = (track.t[chosen.end] - track.t[chosen.start])[:, None, None]
    return np.concatenate([np.zeros_like(c0), swing0 - swing1, c0 + swing0 * tau - c1], axis=1)


def _solve(
    error: Array, jacobian: Array, covariance: Array, weight: Array, prior: Array, values: Array
) -> tuple[Array, Array]:
    """One Gauss-Newton step (32,) and the covariance (32, 32) after it; in units of the prior, which are alike."""
    scaled = jacobian * prior
    whitened = np.linalg.solve(covariance, np.concatenate([scaled, error[..., None]], axis=2))
    sums = np.einsum("w,wij,wik->jk", weight, scaled, whitened)
    pull = sums[:, -1].copy()
    pull[: len(values)] -= values / prior[: len(values)]
    joint = np.linalg.inv(sums[:, :-1] + np.eye(len(prior)))
    return joint @ pull * prior, joint * np.outer(prior, prior)


_COMMON = ("gyro_bias", "accel_bias", "gyro_scale", "accel_scale", "gyro_misalignment", "accel_misalignment")
"""Parts of a calibration that the best estimate has figures of too."""


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """What is known of the figures of a calibration without the autopilot's estimate; zero for what is not."""

    values: Array  # (28,)
    covariance: Array  # (28, 28)
    observable: BoolArray  # (28,) which of them are observable


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
    diagonal, pairs = np.arange(3), ((gyro, GYRO_MISALIGNED), (accel, ACCEL_MISALIGNED))
    scales = (matrix[diagonal, diagonal] for matrix, _ in pairs)
    return np.concatenate([np.eye(6, 24), *scales, *(matrix[tuple(np.transpose(at))] for matrix, at in pairs)])
