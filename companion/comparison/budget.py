"""How far the dead reckoning should be off at the end of each window, and how much of that each cause accounts for.

Covariances of (attitude rotation vector, velocity, position) in NED, autopilot minus IMU, by cause: the causes stay
apart because each is a running integral along the track (docs/mathematics.md, error propagation). A budget without a
cause is how calibration asks "what is left if I solve for the biases?".

Also here: how many windows are inside what is expected of them, as the verdict judges them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.comparison.imu_spec import ImuSpec, ReferenceSpec
from companion.comparison.reference import InterpolationError
from companion.comparison.spans import runs
from companion.comparison.windows import CURVATURE, RATE, SIGN, ZERO, Comparison, Windows, errors, windows
from companion.constants import check, healthy, num, priors
from companion.model import Array, Phase, counted, interpolated
from companion.noise import chi_square
from companion.strapdown import Preintegration, Propagation

ATTITUDE, VELOCITY, POSITION = slice(0, 3), slice(3, 6), slice(6, 9)


@dataclass(frozen=True, slots=True, eq=False)
class Budget:
    """The expected covariance of each window's error, by cause, beside the error."""

    error: Array  # (W, 9) what it was
    causes: Mapping[str, Array]  # name → (W, 9, 9): rad, m/s, m
    propagation: Propagation  # where the Jacobians are

    @property
    def total(self) -> Array:
        """The sum of all causes, (W, 9, 9)."""
        return np.asarray(sum(self.causes.values()))

    def power(self, block: slice) -> dict[str, float]:
        """The expected mean square of a block by each cause, summed over all windows."""
        return {name: float(mean_square(own[:, block, block]).sum()) for name, own in self.causes.items()}


def mean_square(covariance: Array) -> Array:
    """(W,) of the length of errors with covariances (W, k, k)."""
    return np.asarray(np.trace(covariance, axis1=1, axis2=2))


def shares_of(power: Mapping[str, float]) -> dict[str, float]:
    """Part of a mean square that each cause has; they sum to 1."""
    total = sum(power.values())
    return {name: value / total for name, value in power.items()} if total > 0 else dict.fromkeys(power, 0.0)


def budget(comparison: Comparison, chosen: Windows, imu: ImuSpec, autopilot: ReferenceSpec) -> Budget:
    """The budget of windows of one length. White noise is the data sheet's, or what is measured where that is more."""
    reference, start, end = comparison.reference, chosen.start, chosen.end
    growth, error = comparison.growth(chosen), stacked(comparison, chosen)
    track, means = comparison.track, comparison.reading_means(chosen)
    move = growth.transition[:, :9, :9]
    gyro_bias, accel_bias = growth.transition[:, :9, 9:12], growth.transition[:, :9, 12:15]
    lasting = np.diag(np.square([autopilot.tilt] * 2 + [autopilot.heading]))
    passing = np.diag(np.square([autopilot.attitude_noise] * 3 + [autopilot.velocity] * 3 + [autopilot.position] * 3))
    at_start, at_end = (_interpolated(reference.interpolation_error(i, comparison.path)) for i in (start, end))
    leaned = move[:, :, :3] - np.eye(9, 3)  # a lasting attitude error is in both ends and cancels in the attitude
    noise = growth.noise
    shaken = window_noise(means, track.rate_hz)
    gyro_density = np.maximum(imu.gyro.noise_density, shaken[:, 0])[:, None, None]
    accel_density = np.maximum(imu.accel.noise_density, shaken[:, 1])[:, None, None]
    steps = enumerate((track.gyro_step, track.accel_step))
    gyro_steps, accel_steps = (_step_errors(means[:, SIGN, i], means[:, ZERO, i], step) for i, step in steps)
    gyro_matrix, accel_matrix = (m.reshape(-1, 9, 9) for m in (growth.gyro_matrix, growth.accel_matrix))
    rate, scale, turn = track.rate_hz, np.ravel(np.eye(3)), turn_jacobian(growth)
    causes = {
        "gyro_noise": gyro_density**2 * noise["gyro_noise"][:, :9, :9],
        "accel_noise": accel_density**2 * noise["accel_noise"][:, :9, :9],
        "gyro_bias": imu.gyro.residual_bias**2 * _square(gyro_bias),
        "accel_bias": imu.accel.residual_bias**2 * _square(accel_bias),
        "bias_walk": imu.gyro.bias_walk**2 * noise["gyro_walk"][:, :9, :9]
        + imu.accel.bias_walk**2 * noise["accel_walk"][:, :9, :9],
        "quantisation": _square(gyro_bias * gyro_steps[:, None])
        + _square(accel_bias * accel_steps[:, None])
        + track.gyro_step**2 / (12 * rate) * noise["gyro_noise"][:, :9, :9]
        + track.accel_step**2 / (12 * rate) * noise["accel_noise"][:, :9, :9],
        "sampling": _sampling(comparison, chosen, error),
        "scale": _square(gyro_matrix * (imu.gyro.scale * scale)) + _square(accel_matrix * (imu.accel.scale * scale)),
        "misalignment": autopilot.misalignment**2 * _square(turn),
        "time_offset": autopilot.time_offset**2 * _square(growth.time_offset[:, :, None]),
        "time_jitter": _jitter_covariance(comparison, means[:, RATE].mean(axis=2), growth),
        "gravity": autopilot.gravity**2 * _square(growth.gravity[:, :, None]),
        "autopilot_attitude": leaned @ lasting @ leaned.swapaxes(1, 2),
        "autopilot_anchor": move @ (passing + at_start) @ move.swapaxes(1, 2),
        "autopilot_end": passing + at_end + _contradiction(comparison, chosen),
    }
    return Budget(error, causes, growth)


def _contradiction(comparison: Comparison, chosen: Windows) -> Array:
    """(W, 9, 9) what the autopilot's position changes by in each window, and its velocity does not say.

    Up to where an estimator in order has its velocity: no IMU is further off for it.
    """
    out, own = np.zeros((len(chosen.start), 9)), comparison.position
    if own is not None and len(own):
        beyond = comparison.moved_beyond_velocity
        begin, end = comparison.track.t[chosen.start], comparison.track.t[chosen.end]
        most = (healthy.AP_SIGMA["velocity"] * (end - begin))[:, None]
        change = interpolated(end, own.t, beyond) - interpolated(begin, own.t, beyond)
        out[:, POSITION] = np.nan_to_num(np.clip(change, -most, most))  # a velocity that is not known allows nothing
    return np.asarray(out[:, :, None] * out[:, None, :])


def _interpolated(error: InterpolationError) -> Array:
    """(W, 9, 9) covariance of states of the autopilot's that lie between two of its samples."""
    sigma = np.column_stack([error.attitude] * 3 + [error.velocity] * 3 + [error.position] * 3)
    return np.asarray(sigma[:, :, None] ** 2 * np.eye(9))


def turn_jacobian(growth: Propagation) -> Array:
    """(W, 9, 3): error per small fixed rotation (rad, FRD) of the IMU against the attitude's axes: a board trim.

    True readings are (1 + [r]x) times the measured ones, for gyro and accelerometer alike.
    """
    both = growth.gyro_matrix + growth.accel_matrix  # per error that is taken off the readings
    return np.stack([both[:, :, i, j] - both[:, :, j, i] for i, j in ((1, 2), (2, 0), (0, 1))], axis=2)


def nees(error: Array, covariance: Array) -> Array:
    """Normalised estimation error squared of each window, (W,): errors (W, k), covariances (W, k, k).

    NaN, which is inside of nothing, where a covariance cannot be inverted: nothing is known of that window.
    """
    try:
        solved = np.linalg.solve(covariance, error[..., None])[..., 0]
    except np.linalg.LinAlgError:  # one of them, which costs all: NumPy does not say which
        if len(error) == 1:
            return np.full(1, np.nan)
        return np.concatenate([nees(own, by) for own, by in zip(error[:, None], covariance[:, None], strict=True)])
    return np.asarray(np.einsum("wi,wi->w", error, solved))


def stacked(comparison: Comparison, chosen: Windows, path: Preintegration | None = None) -> Array:
    """The errors of the windows in the order of a budget's covariances, (W, 9); path: as for `errors`."""
    window_errors = errors(comparison, chosen, path=path)
    return np.column_stack([window_errors.attitude, window_errors.velocity, window_errors.position])


def window_noise(means: Array, rate_hz: float) -> Array:
    """White-noise density of gyro and accelerometer in each window, (W, 2): rad/s/√Hz, m/s²/√Hz, worst axis.

    From second differences, which smooth motion leaves alone: `reading_means` of the windows. Zero below
    num.NOISE_RATE_HZ, where motion does not look smooth any more.
    """
    if rate_hz < num.NOISE_RATE_HZ:
        return np.zeros((len(means), 2))
    return np.asarray(np.sqrt(means[:, CURVATURE].max(axis=2) / (6.0 * rate_hz)))


def persistent_step_error(readings: Array, step: float) -> Array:
    """What truncation may take from every reading (N, 3) of a whole flight, 1σ per axis (3,): no fit can tell it."""
    return _step_errors(np.sign(readings).mean(axis=0), (readings == 0.0).mean(axis=0), step)


def _square(jacobian: Array) -> Array:
    return np.asarray(jacobian @ jacobian.swapaxes(1, 2))


def _sampling(comparison: Comparison, chosen: Windows, error: Array) -> Array:
    """Covariance of the error that comes of finite sampling: what the other middle sample changes (embedded pair)."""
    d = error - stacked(comparison, chosen, comparison.coarse(chosen.start, chosen.end))
    return np.asarray(d[:, :, None] * d[:, None, :])


def _step_errors(sign: Array, zero: Array, step: float) -> Array:
    """1σ of the constant part of what truncation towards zero takes from readings, per axis.

    sign, zero: means (..., 3) of their signs, and of whether they are zero.

    A reading that keeps its sign is short by half a step, give or take; one that stays at zero stands for anything
    between minus one and plus one step. One that swings across steps averages out, and is noise.
    """
    return np.asarray(step * np.sqrt((0.5 * sign) ** 2 + zero**2 / 3))


def _jitter_covariance(comparison: Comparison, rate: Array, growth: Propagation) -> Array:
    """(W, 9, 9) covariance at the end of each window of stamps that are off, each by itself.

    A reading at the wrong time is wrong by its rate of change, (W, 2) mean squares, which acts like white noise. That
    the window begins and ends at wrong times cancels: the intervals are wrong by as much as the times that the
    autopilot's state is taken at.
    """
    power = comparison.stamp_jitter**2 * rate[..., None, None] / comparison.track.rate_hz
    white = (growth.noise[name][:, :9, :9] for name in ("gyro_noise", "accel_noise"))
    return np.asarray(sum(power[:, i] * own for i, own in enumerate(white)))


_BLOCKS = {"attitude": ATTITUDE, "velocity": VELOCITY, "position": POSITION}


@dataclass(frozen=True, slots=True)
class Expected:
    """The drift that the budget allows at one horizon, 1σ of the error's length, and what it is made of."""

    attitude_deg: float
    velocity_mps: float | None
    position_m: float | None
    shares: Mapping[str, Mapping[str, float]]  # attitude, velocity, position → cause → part of the mean square
    inside: Mapping[str, float]  # attitude, velocity, position → share of windows inside the 95 % bound of their NEES
    parted: Parted | None


@dataclass(frozen=True, slots=True)
class Parted:
    """Successive windows that are all far outside in one quantity, for as long as a flight has to be to be judged.

    A launch, a gust or a touch of the ground takes some seconds.
    """

    quantity: str  # attitude, velocity, position
    windows: int
    start_s: float  # boot clock
    end_s: float

    @classmethod
    def longest(cls, t: Array, chosen: Windows, normalised: Mapping[str, Array]) -> Parted | None:
        """Of windows of a track at times t (N,), by the NEES (W,) of each quantity; None where there are none."""
        far = check.PARTED * chi_square(3, num.Z_95)
        start, end = t[chosen.start], t[chosen.end]
        each = ((name, *edges) for name, own in normalised.items() for edges in runs(own > far))
        stretches = [(last - first + 1, name, first, last) for name, first, last in each]
        count, name, first, last = max(stretches, default=(0, "", 0, 0))
        least = (num.MIN_WINDOWS - 0.5) * num.JUDGED_S  # none is as long as it is called, to the sample
        if count < num.MIN_WINDOWS or (end - start)[first : last + 1].sum() < least:
            return None
        return cls(name, count, float(start[first]), float(end[last]))


def expected_over(
    comparison: Comparison, chosen: Windows, imu: ImuSpec, autopilot: ReferenceSpec, corrected: Comparison | None = None
) -> Expected | None:
    """Over all windows of one length, some at a time: an hour has thousands. None without any.

    corrected: whose errors they are, in place of the comparison's own: as much is expected of them.
    """
    if not (count := len(chosen.start)):
        return None
    blocks = _BLOCKS if comparison.has_position else {"attitude": ATTITUDE}
    sigma, normalised = {name: np.empty(count) for name in blocks}, {name: np.empty(count) for name in blocks}
    power: dict[str, dict[str, float]] = {name: {} for name in blocks}
    for first in range(0, count, num.WINDOWS_AT_ONCE):
        part = slice(first, first + num.WINDOWS_AT_ONCE)
        some = replace(chosen, start=chosen.start[part], end=chosen.end[part])
        allowed = budget(comparison, some, imu, autopilot)
        error, total = allowed.error if corrected is None else stacked(corrected, some), allowed.total
        for name, block in blocks.items():
            sigma[name][part] = np.sqrt(mean_square(total[:, block, block]))
            normalised[name][part] = nees(error[:, block], total[:, block, block])
            for cause, own in allowed.power(block).items():
                power[name][cause] = power[name].get(cause, 0.0) + own
    typical = {name: float(np.median(value)) for name, value in sigma.items()}
    lengths = float(np.degrees(typical["attitude"])), typical.get("velocity"), typical.get("position")
    inside = {name: float(np.mean(value < chi_square(3, num.Z_95))) for name, value in normalised.items()}
    parted = Parted.longest((corrected or comparison).track.t, chosen, normalised)
    return Expected(*lengths, {name: shares_of(own) for name, own in power.items()}, inside, parted)


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
    parted: Parted | None = None  # where they differ for some time, however small a part of the flight that is

    @property
    def share(self) -> float:
        """In the quantity in which the fewest are inside; 0 without windows."""
        return min(self.inside.values(), default=0.0)

    @property
    def is_consistent(self) -> bool:
        """Whether enough are inside in every quantity: of three one is outside by chance in one flight of seven.

        And nowhere several in a row far outside: what all windows share is the same throughout the flight.
        """
        one = self.windows >= num.MIN_WINDOWS and (1.0 - self.share) * self.windows < 1.5
        return self.parted is None and (one or self.share >= priors.CONSISTENT_SHARE)

    def __str__(self) -> str:
        """How many are inside, and what of."""
        what = f"{counted(self.windows, 'window')} of {self.horizon_s:g} s inside the 95 % bound"
        return f"{100.0 * self.share:.0f} % of {what}, known errors removed"


def agreement(
    corrected: Comparison,
    along: Comparison,
    horizon: float,
    parts: Sequence[Phase],
    usual: ImuSpec,
    autopilot: ReferenceSpec,
    within: Sequence[tuple[float, float]],
) -> Agreement:
    """Of the windows of one length within spans (s) that are judged.

    corrected: with the IMU's known errors removed. along: as it was read, where errors grow alike at the same times.
    """
    chosen = while_judged(windows(corrected, horizon, within=within), corrected.track.t, parts)
    same = np.array_equal(corrected.track.t, along.track.t)
    expected = expected_over(along if same else corrected, chosen, usual, autopilot, corrected)
    if expected is None:
        return Agreement(horizon, 0, chosen.excluded, {})
    return Agreement(horizon, len(chosen.start), chosen.excluded, expected.inside, expected.parted)


def while_judged(chosen: Windows, t: Array, parts: Sequence[Phase]) -> Windows:
    """The windows in which the estimator has aligned and the vehicle has neither landed nor lost control."""
    out = np.zeros(len(chosen.start), np.bool_)
    for part in parts:
        if part.kind in ("aligning", "landed", "impact"):
            out |= (t[chosen.start] < part.end) & (t[chosen.end] > part.start)
    if not out.any():
        return chosen
    return replace(chosen.only(~out), excluded={**chosen.excluded, "not_judged": int(out.sum())})
