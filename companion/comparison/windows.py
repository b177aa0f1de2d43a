"""One IMU of a flight, integrated once, beside the autopilot: what drift, budget, calibration and findings share.

Also here: how an IMU is integrated, in which gravity, and what ends a window.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from companion.comparison.reference import (
    Limits,
    Reference,
    attitude_error,
    attitude_jumps,
    position_jumps,
    reference_at,
)
from companion.constants import num
from companion.model import (
    STANDARD_GRAVITY,
    Array,
    AttitudeTrack,
    BoolArray,
    DataError,
    Flight,
    ImuTrack,
    IntArray,
    PositionTrack,
    SettingsError,
    brief,
    check_number,
    check_seconds,
    integrated,
    median,
    nearest,
)
from companion.strapdown import (
    Preintegration,
    Propagation,
    Sums,
    error_sums,
    joined,
    normal_gravity,
    preintegrate,
    propagate,
)


@dataclass(frozen=True, slots=True)
class Integration:
    """One way to integrate.

    Raises SettingsError for gravity that is no number; the analysis, for a method or middle sample that is none.
    """

    method: str = "rk4"  # of `strapdown.METHODS`
    middle: str = "cubic"  # the signal between two samples: linear or cubic
    segments: int = 1  # steps between two samples
    gravity: float = STANDARD_GRAVITY  # m/s², along NED's down
    limits: Limits = field(default_factory=Limits)  # what is a gap, what is a jump

    def __post_init__(self) -> None:
        check_number("gravity", self.gravity)

    def preintegrate(self, track: ImuTrack) -> Preintegration:
        """One pass over a track, that carries any window."""
        return preintegrate(track, method=self.method, middle=self.middle, segments=self.segments)


DEFAULT = Integration()


def gravity_for(flight: Flight, model: str | float) -> float:
    """Gravity along NED's down, m/s²: "standard" (9.80665), "normal" (WGS-84 at the flight's origin) or a number.

    Raises DataError for "normal" when the log does not say where on Earth the flight was, SettingsError for another
    word.
    """
    if isinstance(model, int | float):
        return float(model)
    if model == "standard":
        return STANDARD_GRAVITY
    if model != "normal":
        raise SettingsError(f'gravity must be "standard", "normal" or a number in m/s², got {model!r}')
    if flight.origin is None:
        lacking = "no latitude in the log (GLOBAL_POSITION_INT, GPS_RAW_INT, GPS_GLOBAL_ORIGIN)"
        remedy = 'which gravity = "normal" needs. Use "standard", or give a number in m/s².'
        raise DataError(f"vehicle {flight.vehicle}, boot {flight.boot}: {lacking}, {remedy}")
    return float(normal_gravity(flight.origin.latitude, flight.origin.height))


def means_between(values: Array | BoolArray, start: IntArray, end: IntArray) -> Array:
    """(W,) means of values of samples (N,), or (W, d) of (N, d), each from `start` up to `end`, which is not in it."""
    edges = np.column_stack((start, end)).ravel()
    beyond = np.concatenate((values, np.zeros((1, *values.shape[1:]))))  # a window may go to the end of the track
    sums = np.add.reduceat(beyond, edges, axis=0)[::2]
    return np.asarray(sums / (end - start).reshape(-1, *[1] * (values.ndim - 1)))


CURVATURE, RATE, SIGN, ZERO = range(4)
"""What is averaged of the readings: squared second differences, squared rates of change (per s²), their signs, and
whether they are exactly zero."""


def reading_means(track: ImuTrack, gaps: BoolArray, start: IntArray, end: IntArray) -> Array:
    """(W, 4, 2, 3) means of those over windows, for the axes of gyro and accelerometer.

    gaps: (N-1,) intervals across which the motion went on: no change over one of them is noise, nor a rate.
    """
    means = np.empty((len(start), 4, 2, 3))
    square, apart = np.zeros((2, len(track))), track.t[2:] - track.t[:-2]
    whole = ~(gaps[1:] | gaps[:-1])
    for sensor, readings in enumerate((track.gyro, track.accel)):
        for i, axis in enumerate(readings.T):
            change = axis[1:] - axis[:-1]
            np.square(change[1:] - change[:-1], out=square[CURVATURE, 2:], where=whole)
            np.square((change[1:] + change[:-1]) / apart, out=square[RATE, 1:-1], where=whole)
            for what, values in enumerate((*square, np.sign(axis), axis == 0.0)):
                means[:, what, sensor, i] = means_between(values, start, np.maximum(end, start + 1))
    return means


class Passes:
    """The passes over one track, each made when it is first asked for and kept."""

    def __init__(self, track: ImuTrack, how: Integration) -> None:
        self._track, self._how = track, how
        self._coarse: tuple[IntArray, Preintegration] | None = None

    @cached_property
    def path(self) -> Preintegration:
        """Carries any window."""
        return self._how.preintegrate(self._track)

    def coarse(self, samples: IntArray, usual: IntArray) -> Preintegration:
        """That of rk4's other middle sample, at the samples that are wanted and those that usually are; kept for all
        whose samples are among them.

        Where much is turned in an interval, its steps are half as long: an even turn is the same with both middles, and
        what a step makes of it is not.
        """
        if self._coarse is None or not np.isin(samples, self._coarse[0]).all():
            known = np.unique(np.concatenate([samples, usual]))
            other = "linear" if self._how.middle == "cubic" else "cubic"
            track, steps = self._track, self._how.segments
            turns = np.abs(track.gyro).max() > num.COARSE_TURN_RAD * steps * track.rate_hz
            coarse = replace(self._how, method="rk4", middle=other, segments=2 * steps if turns else steps)
            whole = coarse.preintegrate(track)
            self._coarse = known, whole.at(known)
        return self._coarse[1]


@dataclass(frozen=True, eq=False)
class Comparison:
    """The dead reckoning of one IMU and the autopilot's state at its samples."""

    __repr__ = brief

    track: ImuTrack
    attitude: AttitudeTrack  # the autopilot's own
    position: PositionTrack | None
    reference: Reference  # at the samples of the track
    how: Integration
    gaps: BoolArray  # (N-1,) intervals of the track that are a gap
    attitude_steps: Array  # (J, 2) s, jumps of the autopilot's attitude
    position_steps: Array  # (J, 2) s, jumps of its position
    passes: Passes  # over the track

    @property
    def path(self) -> Preintegration:
        """One pass over the track; carries any window."""
        return self.passes.path

    def coarse(self, *samples: IntArray) -> Preintegration:
        """The same pass with rk4's other middle sample, at these samples: the difference is the error of the sampling.

        It is made once for all windows of whole seconds, which begin and end on the same samples.
        """
        return self.passes.coarse(np.unique(np.concatenate(samples)), self._seconds)

    def growth(self, chosen: Windows) -> Propagation:
        """How errors grow over windows. Those of whole seconds, of whatever length, share one pass over the track."""
        start, end, seconds = chosen.start, chosen.end, self._of_seconds(chosen)
        begin = self.reference.at(start)
        sums = None if seconds is None else joined(self._second_sums, *seconds)
        state, gravity = (begin.q_ned_frd, begin.velocity), self.how.gravity
        return propagate(self.track, self.path, start, end, *state, gravity=gravity, sums=sums)

    @cached_property
    def moved_beyond_velocity(self) -> Array:
        """(M, 3) NED, m: the autopilot's position less the integral of its own velocity; empty without a position."""
        own = self.position
        return np.zeros((0, 3)) if own is None else own.position - integrated(own.t, own.velocity)

    @cached_property
    def _seconds(self) -> IntArray:
        """The samples on which windows of a second begin and end."""
        return np.unique(np.concatenate(_grid(self, 1.0, self.whole)))

    def reading_means(self, chosen: Windows) -> Array:
        """(W, 4, 2, 3): see the function. Of windows of whole seconds the samples are looked at once."""
        seconds = self._of_seconds(chosen)
        if seconds is None:
            return reading_means(self.track, self.gaps, chosen.start, chosen.end)
        sums = self._second_means * np.diff(self._seconds)[:, None, None, None]
        samples = (chosen.end - chosen.start)[:, None, None, None]
        return np.asarray(means_between(sums, *seconds) * (seconds[1] - seconds[0])[:, None, None, None] / samples)

    def _of_seconds(self, chosen: Windows) -> tuple[IntArray, IntArray] | None:
        """The first second of each window, and the one behind it; None where they are not made of whole seconds."""
        if chosen.horizon < 1.0 or len(np.setdiff1d(np.append(chosen.start, chosen.end), self._seconds)):
            return None
        return self._seconds.searchsorted(chosen.start), self._seconds.searchsorted(chosen.end)

    @cached_property
    def _second_means(self) -> Array:
        return reading_means(self.track, self.gaps, self._seconds[:-1], self._seconds[1:])

    @cached_property
    def _second_sums(self) -> Sums:
        return error_sums(self.track, self.path, self._seconds[:-1], self._seconds[1:], step_s=num.COVARIANCE_STEP_S)

    @cached_property
    def stamp_jitter(self) -> float:
        """1σ, s: see the function."""
        return stamp_jitter(self.track)

    def of(self, track: ImuTrack) -> Comparison:
        """The same for other readings; the autopilot is looked at anew where their times are others."""
        if track is self.track:
            return self
        own = replace(self, track=track, passes=Passes(track, self.how))
        if np.array_equal(track.t, self.track.t):
            return own
        limits = self.how.limits
        reference = reference_at(self.attitude, self.position, track.t, limits)
        return replace(own, reference=reference, gaps=np.diff(track.t) > limits.longest_step(track.t))

    def beside(self, reference: Reference) -> Comparison:
        """The same beside another judge, who never jumps; the pass over the track is as it was."""
        never = np.zeros((0, 2))
        return replace(self, reference=reference, attitude_steps=never, position_steps=never)

    @property
    def has_position(self) -> bool:
        """Whether the autopilot's position is known anywhere."""
        return self.reference.has_position

    @property
    def whole(self) -> Part:
        """All windows, from the first sample on at which all that is compared is known.

        That is one with a position, so that none of the time with one is given away.
        """
        known = np.flatnonzero(self.reference.known)
        return Part(float(self.reference.t[known[0]]) if len(known) else np.nan, self.has_position)


@dataclass(frozen=True, slots=True, eq=False)
class Windows:
    """Windows of one length that can be used, and how many could not."""

    __repr__ = brief

    horizon: float  # s
    start: IntArray  # (W,) sample of the anchor
    end: IntArray  # (W,) sample of the end
    excluded: Mapping[str, int]  # left out, by reason

    def only(self, used: BoolArray) -> Windows:
        """Some of them (W,); what else was left out is not told again."""
        return replace(self, start=self.start[used], end=self.end[used], excluded={})


@dataclass(frozen=True, slots=True)
class Part:
    """Which windows of a longer flight are wanted from a piece of it."""

    origin_s: float  # s, boot clock, where the grid of the whole flight stands, of whatever length; NaN: nowhere
    has_position: bool  # whether the whole flight has one
    first: int | None = None  # the edge of the grid to begin with; None: the piece's first
    before_s: float = np.inf  # s, boot clock, when a window must have ended


@dataclass(frozen=True, slots=True, eq=False)
class WindowErrors:
    """The error of every window at its end, autopilot minus IMU."""

    __repr__ = brief

    anchor_s: Array  # (W,) s, boot clock
    end_s: Array  # (W,)
    attitude: Array  # (W, 3) rotation vector in NED, rad
    velocity: Array  # (W, 3) NED m/s; meaningless when the flight has no position
    position: Array  # (W, 3) NED m, likewise


def compare(
    flight: Flight, *, imu: str | None = None, how: Integration = DEFAULT, track: ImuTrack | None = None
) -> Comparison:
    """Integrate one IMU of the flight and find the autopilot's state at its samples.

    track: taken in place of the flight's own, e.g. the same IMU corrected. Raises DataError when the flight has no
    usable IMU or no attitude, SettingsError for an unknown method.
    """
    track = track or flight.imu(imu)
    attitude, position, limits = flight.require_attitude(), flight.position, how.limits
    reference, gaps = reference_at(attitude, position, track.t, limits), np.diff(track.t) > limits.longest_step(track.t)
    steps = attitude_jumps(attitude, limits), position_jumps(position, limits) if position else np.zeros((0, 2))
    made = Comparison(track, attitude, position, reference, how, gaps, *steps, Passes(track, how))
    _ = made.path  # a method that there is not is said at once
    return made


def windows(
    comparison: Comparison,
    horizon: float,
    part: Part | None = None,
    within: Sequence[tuple[float, float]] = ((-np.inf, np.inf),),
) -> Windows:
    """Windows of `horizon` seconds end to end, without those that have a gap, an unknown end or a jump in them.

    A flight that has a position is judged where it has one. part: of a longer flight, of which the comparison is a
    piece. within: spans (s, boot clock), in one of which a window has to lie.
    Raises SettingsError for a horizon that is not positive.
    """
    check_seconds("horizons", horizon)
    part = part or comparison.whole
    start, end = _grid(comparison, horizon, part)
    t = comparison.track.t
    inside = np.any([(t[start] >= first) & (t[end] <= last) for first, last in within], axis=0)
    return _usable(comparison, horizon, start[inside], end[inside], part.has_position)


def trailing(comparison: Comparison, horizon: float) -> Windows:
    """Windows of `horizon` seconds that overlap: one ends at every sample, where one can be used.

    Raises SettingsError for a horizon that is not positive.
    """
    check_seconds("horizons", horizon)
    t = comparison.track.t
    end = np.flatnonzero(t >= t[0] + horizon * (1 - 1e-9))
    start = nearest(t, t[end] - horizon)
    whole = start < end
    return _usable(comparison, horizon, start[whole], end[whole], comparison.has_position)


LEFT_OUT = {
    "imu_gap": "across an IMU gap",
    "no_attitude": "without an attitude",
    "attitude_jump": "across an attitude jump",
    "no_position": "without a position",
    "position_jump": "across a position jump",
    "not_judged": "while the estimator aligned, after landing or loss of control",
}
"""Why a window is left out → the same in words, after how many they are."""


def left_out(excluded: Mapping[str, int]) -> str:
    """How many windows are left out for which reason, in words: "9 across an IMU gap"; "" for none."""
    return ", ".join(f"{count} {LEFT_OUT[reason]}" for reason, count in excluded.items())


def _usable(comparison: Comparison, horizon: float, start: IntArray, end: IntArray, has_position: bool) -> Windows:
    """Those of the windows that have no gap, no unknown end and no jump in them; excluded: how many have which.

    One that would begin or end within a gap begins or ends beside it, and has another length.
    """
    track, reference = comparison.track, comparison.reference
    running = np.concatenate([[0], np.cumsum(comparison.gaps)])
    off = np.abs(track.t[end] - track.t[start] - horizon)
    reasons = {"imu_gap": (running[end] > running[start]) | (off > comparison.how.limits.longest_step(track.t))}
    for name, known, steps in (
        ("attitude", reference.attitude_known, comparison.attitude_steps),
        ("position", reference.position_known, comparison.position_steps),
    )[: 2 if has_position else 1]:
        reasons[f"no_{name}"] = ~(known[start] & known[end])
        reasons[f"{name}_jump"] = _touched(steps, track.t, start, end)
    used = np.ones(len(start), np.bool_)
    excluded: dict[str, int] = {}
    for reason, bad in reasons.items():  # a window with several reasons counts under the first
        if left_out := int((used & bad).sum()):
            excluded[reason] = left_out
        used &= ~bad
    return Windows(float(horizon), start[used], end[used], excluded)


def errors(comparison: Comparison, chosen: Windows, *, path: Preintegration | None = None) -> WindowErrors:
    """How far each window's end is from the autopilot; path: another dead reckoning of the same samples."""
    reference, start, end = comparison.reference, chosen.start, chosen.end
    begin, arrived = reference.at(start), reference.at(end)
    q, velocity, position = (path or comparison.path).carry(
        start, end, begin.q_ned_frd, begin.velocity, begin.position, gravity=comparison.how.gravity
    )
    turned = attitude_error(arrived.q_ned_frd, q)
    moved = arrived.velocity - velocity, arrived.position - position
    return WindowErrors(reference.t[start], reference.t[end], turned, *moved)


def edges(comparison: Comparison, horizon: float, part: Part) -> IntArray:
    """Where windows begin and end, over all that has an attitude: at the origin + horizon times these numbers."""
    t, known = comparison.track.t, np.flatnonzero(comparison.reference.attitude_known)
    if not len(known) or len(t) < 2 or horizon < 0.5 * median(t[1:] - t[:-1]):
        return np.zeros(0, np.intp)
    last = min(float(t[known[-1]]), part.before_s)
    slack = 1e-9 * horizon  # so that an end that falls on the last sample is kept in spite of rounding
    spans = part.origin_s - t[known[0]], last - part.origin_s
    before, after = (int(np.floor((span + slack) / horizon)) for span in spans)
    first = -before if part.first is None else max(-before, part.first)
    return np.arange(first, after + 1, dtype=np.intp)


def _grid(comparison: Comparison, horizon: float, part: Part) -> tuple[IntArray, IntArray]:
    """Sample indices of anchors and ends."""
    numbers, t = edges(comparison, horizon, part), comparison.track.t
    if len(numbers) < 2:
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    index = nearest(t, part.origin_s + horizon * numbers.astype(np.float64))
    apart = np.diff(index) > 0  # in a gap, or at a very low rate, two edges can fall on one sample
    return index[:-1][apart], index[1:][apart]


def _touched(steps: Array, t: Array, start: IntArray, end: IntArray) -> BoolArray:
    """Whether one of the steps (J, 2), from s to s, lies in the window or is interpolated across at its ends."""
    over = np.searchsorted(steps[:, 1], t[start], side="right")
    to_come = len(steps) - np.searchsorted(steps[:, 0], t[end], side="left")
    return np.asarray(len(steps) - over - to_come > 0)


def stamp_jitter(track: ImuTrack) -> float:
    """1σ, s, of the error of one stamp against its neighbours'.

    From how irregular the intervals are, once whole ticks are taken off: an interval that is one tick longer holds one
    sample less, and its stamps are right. Never less than the resolution of the message's clock allows.
    """
    least = float(track.t_step / np.sqrt(12.0))
    intervals = np.diff(track.t)
    if len(intervals) < num.TICK_MIN_INTERVALS:
        return least
    period = float(np.percentile(intervals, 10.0))
    near = intervals[intervals < 5.5 * period]
    spreads = []
    for pieces in range(1, num.TICK_MAX_PIECES + 1):
        tick = period / pieces
        low, high = np.percentile(near - tick * np.round(near / tick), [16.0, 84.0])
        spreads.append(0.5 * float(high - low))
        if spreads[-1] < num.TICK_REGULAR * tick:
            return float(max(least, spreads[-1] / np.sqrt(2.0)))  # an interval has two stamps
    return float(max(least, spreads[0] / np.sqrt(2.0)))
