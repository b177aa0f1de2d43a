"""IMU readings, the autopilot's estimate, integrated trajectories, any other series: frozen dataclasses of arrays.

Conventions, everywhere (docs/conventions.md):

- time `t` in seconds of the vehicle's boot clock, time first in every array, float64;
- body frame FRD (forward, right, down), world frame NED (north, east, down) about the flight's own origin;
- `q_ned_frd`: Hamilton quaternion `[w, x, y, z]` that rotates FRD vectors into NED;
- specific force is what an accelerometer reads: `(0, 0, -g)` at rest and level; angles in radians.

Also here: the MAVLink messages that carry an IMU: the one table of their names.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, TypeVar, cast

import numpy as np
import numpy.typing as npt

from companion.model.errors import floats, times
from companion.model.wording import brief


@dataclass(frozen=True, slots=True)
class ImuMessage:
    """A message of an IMU, and of the magnetometer beside it."""

    instance: int  # which of the vehicle's IMUs; HIGHRES_IMU carries its own where it is another
    rank: int  # 0: preferred for integration
    clock: str  # "time_boot_ms": when it was sampled, on every autopilot; "time_usec": perhaps when it was sent
    numbered: bool = False  # one of SCALED_IMU, 2 and 3: an IMU by its number


IMU_MESSAGES: Mapping[str, ImuMessage] = {
    "RAW_IMU": ImuMessage(0, rank=1, clock="time_usec"),
    "SCALED_IMU": ImuMessage(0, rank=2, clock="time_boot_ms", numbered=True),
    "SCALED_IMU2": ImuMessage(1, rank=3, clock="time_boot_ms", numbered=True),
    "SCALED_IMU3": ImuMessage(2, rank=4, clock="time_boot_ms", numbered=True),
    "HIGHRES_IMU": ImuMessage(0, rank=0, clock="time_usec"),
}


def by_preference() -> list[str]:
    """The names, that of the message to integrate first; see `Flight.default_imu`."""
    return sorted(IMU_MESSAGES, key=lambda name: IMU_MESSAGES[name].rank)


Array = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.intp]

STANDARD_GRAVITY = 9.80665
"""m/s², the value behind MAVLink's mG and ArduPilot's and PX4's estimators."""

_USUAL = 0.8  # of the median, by which an interval may differ from it and have lost no sample


class Sampled:
    """Arrays over times `t`: as long as those, and shown in a few lines."""

    __slots__ = ()

    t: Array
    __repr__ = brief

    def __len__(self) -> int:
        return len(self.t)


Track = TypeVar("Track", bound=Sampled)


def rows(track: Track, chosen: npt.NDArray[Any] | slice) -> Track:
    """Some samples of a track: of every array that is as long as its times. All of them: the track itself."""
    if isinstance(chosen, np.ndarray) and chosen.dtype == np.bool_ and len(chosen) == len(track) and chosen.all():
        return track
    columns = {field.name: getattr(track, field.name) for field in fields(cast(Any, track))}
    arrays = {n: v[chosen] for n, v in columns.items() if isinstance(v, np.ndarray) and len(v) == len(track)}
    return cast(Track, replace(cast(Any, track), **arrays))


_VECTORS: Mapping[str, tuple[int]] = {
    "q_ned_frd": (4,), "flow": (2,),
    **dict.fromkeys(("velocity", "position", "gyro", "accel", "rates", "gyro_sigma", "accel_sigma", "field"), (3,)),
}  # fmt: skip
"""Arrays of tracks that hold a vector for each sample → its shape; the others hold a number."""


class Checked(Sampled):
    """A track whose fields of type `Array` are checked: each as long as its times, and finite.

    Raises DataError unless shapes agree, everything is finite and time increases strictly.
    """

    __slots__ = ()

    _finite = True  # whether NaN is no value

    def __post_init__(self) -> None:
        name = self._named
        object.__setattr__(self, "t", times(f"{name}.t", self.t))
        for column in (one.name for one in fields(cast(Any, self)) if one.type == "Array" and one.name != "t"):
            shape = (len(self), *self._shapes.get(column, ()))
            values = floats(f"{name}.{column}", getattr(self, column), shape, finite=self._finite)
            object.__setattr__(self, column, values)

    @property
    def _named(self) -> str:
        """What an error calls it."""
        return type(self).__name__

    @property
    def _shapes(self) -> Mapping[str, tuple[int]]:
        """Of a sample; of those that are a number none."""
        return _VECTORS


@dataclass(frozen=True, slots=True, eq=False)
class SensorInUse:
    """Which IMU, receiver, compass, ... the estimator that flew used from each time on."""

    t: Array  # (N,) s
    instance: npt.NDArray[np.int64]  # (N,)
    source: str = ""  # XKF4.PI, sensor_selection, ...

    def __post_init__(self) -> None:
        floats(f"{self.source}.instance", self.instance, self.t.shape)

    def uses(self, instance: int, start: float, end: float) -> bool:
        """Whether it used an instance between two times (s), as far as it is known."""
        until = np.append(self.t[1:], np.inf)
        return not len(self.t) or bool((self.instance[(self.t < end) & (until > start)] == instance).any())

    @property
    def changes(self) -> list[tuple[float, int]]:
        """Each time (s) with the instance that is used from then on."""
        return list(zip(self.t.tolist(), self.instance.tolist(), strict=True))

    def at(self, t: Array) -> npt.NDArray[np.int64]:
        """The instance in use at each of the times t (N,) s (before the first change: the first one)."""
        return self.instance[np.maximum(np.searchsorted(self.t, t, side="right") - 1, 0)]


@dataclass(frozen=True, eq=False, repr=False)  # without slots: its rate is kept
class ImuTrack(Checked):
    """Samples of one IMU in the body frame of the autopilot's attitude.

    Raises DataError for shapes that do not match, non-finite samples or times that do not increase.
    """

    t: Array  # (N,) s, strictly increasing
    gyro: Array  # (N, 3) angular rate, FRD, rad/s
    accel: Array  # (N, 3) specific force, FRD, m/s²
    source: str = ""  # the message it came from: RAW_IMU, SCALED_IMU2, ...
    gyro_step: float = 0.0  # rad/s, quantisation step of the readings; 0 for floats
    accel_step: float = 0.0  # m/s², the same for specific force
    instance: int = 0  # which of the vehicle's IMUs: RAW_IMU is always 0, SCALED_IMU2 is 1, ...
    t_step: float = 0.0  # s, resolution of the message's clock; 0 where it is far finer than an interval
    device_id: int | None = None  # the vehicle's own id of the sensor; None: unknown
    interval: Array | None = None  # (N,) s, the sample is the mean over `t ± interval / 2`: of the gyro the rotation
    #                                vector (coning included), of the force in body axes; None: an instant's reading
    bias_removed: bool = False  # whether the estimator's own bias has been taken off
    gyro_low_pass_hz: float | None = None  # cutoff of the 2-pole filter before sampling, 0 for none; None: not known
    accel_low_pass_hz: float | None = None
    gyro_range: float | None = None  # rad/s, where the gyro saturates; None: unknown
    accel_range: float | None = None  # m/s²
    switches: SensorInUse | None = None  # whose readings these are from each time on; None: of one IMU alone

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        if self.interval is not None:  # NaN for the first one, before which there is nothing
            interval = floats("ImuTrack.interval", self.interval, self.t.shape, finite=False)
            object.__setattr__(self, "interval", interval)

    def __getitem__(self, index: slice) -> ImuTrack:
        """The same track, cut to a slice of its samples."""
        return rows(self, index)

    @cached_property
    def rate_hz(self) -> float:
        """1 / mean of the usual sample intervals; 0 for fewer than two samples.

        A lost sample makes an interval of twice the median, which is none; 100 Hz on a clock of 4 ms makes intervals of
        8 and 12 ms, or now and then of 14, and is 100 Hz.
        """
        if len(self) < 2:
            return 0.0
        intervals = self.t[1:] - self.t[:-1]
        middle = median(intervals)
        usual = intervals[np.abs(intervals - middle) < _USUAL * middle]
        return 1.0 / float(usual.mean() if len(usual) else middle)

    def instance_at(self, t: Array) -> npt.NDArray[np.int64]:
        """(N,) whose readings they are at times t (N,) s."""
        return np.full(len(t), self.instance) if self.switches is None else self.switches.at(t)

    @property
    def low_pass_hz(self) -> float | None:
        """The lower cutoff of both; None where there is none, or none known."""
        return min((cutoff for cutoff in (self.gyro_low_pass_hz, self.accel_low_pass_hz) if cutoff), default=None)

    @property
    def covered(self) -> float:
        """Share of its time over which the samples are means: 1 where their intervals join, 0 for readings."""
        if self.interval is None or len(self) < 2:
            return 0.0
        return float(min(np.nansum(self.interval[1:]) / (self.t[-1] - self.t[0]), 1.0))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class AttitudeTrack(Checked):
    """The autopilot's own attitude. Raises DataError as ImuTrack does."""

    t: Array  # (N,) s, strictly increasing
    q_ned_frd: Array  # (N, 4) wxyz, unit length, sign continuous along the track
    rates: Array  # (N, 3) the autopilot's bias-corrected body rates, FRD, rad/s
    source: str = ""
    rates_reported: bool = True  # by the autopilot; False: computed from its IMU's readings, and no check of them

    @property
    def rates_told(self) -> bool:
        """Deprecated: the old name of `rates_reported`."""
        return self.rates_reported


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PositionTrack(Checked):
    """The autopilot's own position and velocity. Raises DataError as ImuTrack does."""

    t: Array  # (N,) s, strictly increasing
    position: Array  # (N, 3) NED, m, about the flight's origin
    velocity: Array  # (N, 3) NED, m/s
    source: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class NavState:
    """Where a strapdown integration stands at one instant: the start of a run or the end of a chunk."""

    __repr__ = brief

    t: float  # s
    q_ned_frd: Array  # (4,) wxyz
    velocity: Array  # (3,) NED, m/s
    position: Array  # (3,) NED, m


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Trajectory(Sampled):
    """The integrated states at the times of the IMU samples."""

    t: Array  # (N,) s
    q_ned_frd: Array  # (N, 4) wxyz, unit length, sign continuous
    velocity: Array  # (N, 3) NED, m/s
    position: Array  # (N, 3) NED, m
    notes: tuple[str, ...] = ()  # what was done differently from what was requested, and why

    @property
    def end(self) -> NavState:
        """The state at the last sample: where the next chunk continues."""
        return NavState(float(self.t[-1]), self.q_ned_frd[-1], self.velocity[-1], self.position[-1])


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Series(Checked):
    """Quantities over time, as columns whose names end in their unit: "x_mps2", "lat_rad", "pressure_pa".

    Raises DataError for shapes that do not match or times that do not increase.
    """

    t: Array  # (N,) s, strictly increasing
    values: Array  # (N, k) one column per name; NaN where the vehicle does not know
    columns: tuple[str, ...]
    source: str = ""  # the message or record it came from: "VIBRATION", "BARO[1]"
    instance: int = 0  # which sensor of its kind, where there are several

    _finite = False

    @property
    def _named(self) -> str:
        return self.source or "Series"

    @property
    def _shapes(self) -> Mapping[str, tuple[int]]:
        return {"values": (len(self.columns),)}

    def __getitem__(self, column: str) -> Array:
        """One column, (N,). Raises KeyError, with the names that there are."""
        if column not in self.columns:
            raise KeyError(f"{self.source} has no column {column!r}; it has {', '.join(self.columns)}")
        return np.asarray(self.values[:, self.columns.index(column)])


def of_kind(series: Mapping[str, Series], kind: str) -> Iterator[Series]:
    """Those of a kind among a flight's, by their keys "kind" or "kind:source"; the others are not even made."""
    return (series[key] for key in series if key.partition(":")[0] == kind)


def nearest(samples: Array, t: Array) -> npt.NDArray[np.intp]:
    """Index of the sample nearest to each t. Needs two samples or more."""
    index = np.clip(np.searchsorted(samples, t), 1, len(samples) - 1)
    return index - (t - samples[index - 1] < samples[index] - t)


GAP_PERIODS, GAP_S = 3.0, 0.1
"""A gap is longer than so many median sample periods, and than so many s."""


def longest_step(t: Array, periods: float = GAP_PERIODS, least_s: float = GAP_S) -> float:
    """s, from one sample at times t (N,) to the next: a longer one is a gap. 0 of fewer than two samples.

    Integrating across a gap is the largest false error there is: 1 s in a turn is 30° of attitude.
    """
    return max(least_s, periods * median(np.diff(t))) if len(t) > 1 else 0.0


def median(values: Array) -> float:
    """Of finite values (N,), one or more: as NumPy's, which takes ten times as long for a few hundred."""
    half = len(values) // 2
    if len(values) % 2:
        return float(np.partition(values, half)[half])
    ordered = np.partition(values, (half - 1, half))
    return float(0.5 * (ordered[half - 1] + ordered[half]))


def weighted_median(values: Array, weights: Array) -> float:
    """The least of finite values (N,), one or more, at which half of the weights (N,), none negative, is reached."""
    order = np.argsort(values)
    passed = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(passed, 0.5 * passed[-1])])


def percentile(values: Array, percent: float) -> float:
    """Of finite values (N,), one or more, on a line between two of them: as NumPy's, in a tenth of the time."""
    place = percent / 100.0 * (len(values) - 1)
    below = int(place)
    above = min(below + 1, len(values) - 1)
    ordered = np.partition(values, (below, above))
    low, high, share = ordered[below], ordered[above], place - below
    return float(low + share * (high - low) if share < 0.5 else high - (1.0 - share) * (high - low))


def interpolated(t: Array, samples: Array, values: Array) -> Array:
    """(M, n) at the times t (M,): on the lines between values (N, n) at increasing times (N,), and flat beyond them."""
    return np.column_stack([np.interp(t, samples, column) for column in values.T])


def integrated(t: Array, values: Array) -> Array:
    """(N, n) the integral of values (N, n) since the first of increasing times t (N,), by trapezoids."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(t)[:, None]
    return np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)])
