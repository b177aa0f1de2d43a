"""A replay made ready for the eye: finite, in the units people read, and at any instant between two samples.

And what the user has chosen of it: the dead reckoning is computed at once, the analysis later.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from companion.comparison import (
    HORIZONS_S,
    NO_CORRECTION,
    Correction,
    Expectation,
    Expected,
    ImuNoise,
    Integration,
    RedundantImu,
    Replay,
    gravity_for,
)
from companion.model import Array, DataError, Flight, ImuTrack
from companion.strapdown import SAME_TIME, ImuModel, Sensor, correct, quaternion
from companion.verdict import Assessment, Lanes, Preflight, Verdict
from companion.view.state.sending import Indices

MOST = 1e12
"""A figure that diverged is finite here and infinite as the float32 that the browser gets: it is cut off."""


@dataclass(frozen=True, slots=True, eq=False)
class AnalysisResult:
    """The analysis of the IMU that is shown, integrated and corrected as it is shown. It comes after the picture."""

    assessment: Assessment
    trailing: Errors  # over the chosen horizon, at the ends of its windows
    horizon_s: float
    redundant_imus: tuple[RedundantImu, ...] = ()
    expected: Expectation | None = None  # over the replay; None where it is not known
    noise: ImuNoise | None = None  # of that IMU as it was read; None where the log is too short to tell
    calibrated: Expected | None = None  # at the horizon, with what the flight's calibration leaves unknown of the IMU
    replay: Replay | None = None  # anchored where the page opens as well; None: what is shown already is

    @property
    def allowed(self) -> Expected | None:
        """What is allowed of a window of the chosen horizon, 1σ, before the flight's own calibration."""
        rows = zip(self.assessment.drift.rows, self.assessment.expected, strict=True)
        return next((one for row, one in rows if row.horizon_s == self.horizon_s), None)

    def after_horizon(self, t: float) -> tuple[float, float] | None:
        """Attitude error (°) and position error (m) of the window of the chosen horizon that ends at `t`, s.

        None before the first such window, and where it could not be used.
        """
        errors = self.trailing
        i = int(np.searchsorted(errors.t, t + SAME_TIME, side="right")) - 1
        if i < 0 or t - errors.t[i] > _STALE_S:
            return None
        return float(errors.attitude_deg[i]), float(errors.position_m[i])


@dataclass(frozen=True, slots=True, eq=False)
class FlightChecks:
    """What is said of a flight beside the verdict on its IMU. It comes after that."""

    lanes: Lanes | None = None  # None: the log has no two of them, or nothing to compare them with
    preflight: Preflight | None = None  # None: it never stands


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """How far both are apart, in the units people read."""

    t: Array  # (N,) s, boot clock
    tilt_deg: Array  # (N,) size of the horizontal part of the attitude error
    heading_deg: Array  # (N,) its vertical part: positive when the autopilot points clockwise of the IMU, from above
    velocity_mps: Array  # (N,)
    position_m: Array  # (N,)

    @property
    def attitude_deg(self) -> Array:
        """(N,) the size of the attitude error."""
        return np.hypot(self.tilt_deg, self.heading_deg)


def errors_of(t: Array, attitude: Array, velocity: Array, position: Array) -> Errors:
    """Errors (N, 3) as analysis has them (rad, m/s, m, NED) in degrees and as lengths; finite."""
    degrees = _bounded(np.degrees(attitude))

    def length(vectors: Array) -> Array:
        return np.asarray(np.linalg.norm(_bounded(vectors), axis=1))

    return Errors(t, length(degrees[:, :2]), degrees[:, 2].copy(), length(velocity), length(position))


def _bounded(values: Array, most: float = MOST) -> Array:
    if np.abs(values).max(initial=0.0) <= most:  # which NaN is not
        return values
    return np.clip(np.nan_to_num(values), -most, most)


@dataclass(frozen=True, slots=True, eq=False)
class Envelope:
    """How far apart both are expected to be: one standard deviation of each error's length, over time."""

    t: Array  # (M,) s, boot clock, increasing
    attitude_deg: Array  # (M,)
    velocity_mps: Array  # (M,)
    position_m: Array  # (M,)
    covariance: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))  # (M, 3, 3) of the position, NED, m²

    def at(self, t: float, attribute: str) -> float:
        """One of them at `t`, s."""
        return float(np.interp(t, self.t, getattr(self, attribute)))

    def ellipsoid(self, t: float) -> Array:
        """Covariance of the position (3, 3) at `t`, s: on a straight line between those that are known."""
        if not len(self.covariance):
            return np.zeros((3, 3))
        i = int(np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2))
        share = float(np.clip((t - self.t[i]) / (self.t[i + 1] - self.t[i]), 0.0, 1.0))
        return np.asarray((1 - share) * self.covariance[i] + share * self.covariance[i + 1])


def _envelope_of(expected: Expectation) -> Envelope:
    """The lengths and the position's covariance of an expectation, finite."""
    attitude, velocity, position = map(_bounded, expected.lengths)
    return Envelope(expected.t, attitude, velocity, position, _bounded(expected.covariance[:, 6:9, 6:9], MOST**2))


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """Both states at one instant, and how far apart they are."""

    t: float  # s, boot clock
    q_imu: Array  # (4,) wxyz NED/FRD, unit length
    position_imu: Array  # (3,) NED, m
    q_ref: Array  # (4,)
    position_ref: Array  # (3,) NED, m
    tilt_deg: float  # size of the horizontal part of the attitude error
    heading_deg: float  # its vertical part: positive when the autopilot points clockwise of the IMU, seen from above
    velocity_mps: float
    position_m: float
    since_anchor_s: float
    velocity_imu: Array  # (3,) NED, m/s
    velocity_ref: Array  # (3,) NED, m/s, the autopilot's
    covariance: Array  # (3, 3) of the expected position error, NED, m²; zero where nothing is expected
    known: bool  # whether the autopilot's state is known here, or only interpolated across a gap

    @property
    def attitude_deg(self) -> float:
        """The size of the attitude error."""
        return float(np.hypot(self.tilt_deg, self.heading_deg))


@dataclass(frozen=True, slots=True, eq=False)
class DisplayTrajectory:
    """A replay with its errors as people read them. Everything in it is finite, every quaternion of unit length."""

    replay: Replay
    track: ImuTrack | None  # the readings, corrected as they were integrated; None: not kept
    errors: Errors  # at the replay's times
    restarts: Indices  # (A,) the first sample at or after each anchor: the IMU's track is broken just before it
    others: Mapping[str, DisplayTrajectory]  # other IMUs of the flight, by message name
    result: AnalysisResult | None = None  # once it has come
    expected: Envelope | None = None  # of the errors since the anchor

    @property
    def source(self) -> str:
        """The IMU message that was integrated, or "IMU"."""
        return self.track.source if self.track is not None else "IMU"

    @property
    def by_imu(self) -> dict[str, DisplayTrajectory]:
        """Those of all IMUs shown, by message name: first the one that was integrated."""
        return {self.source: self, **self.others}

    @property
    def start(self) -> float:
        """s, boot clock, of the first sample."""
        return float(self.replay.t[0])

    @property
    def end(self) -> float:
        """s, boot clock, of the last sample."""
        return float(self.replay.t[-1])

    def at(self, t: float) -> Sample:
        """The instant `t`: see `samples`."""
        return self.samples(np.array([t]))[0]

    def samples(self, times: Array) -> list[Sample]:
        """The instants `times` (F,) s, between two samples by straight lines; beyond the ends the first or last sample.

        Across an anchor the IMU's track jumps back to the autopilot's: there the sample before is held.
        """
        r = self.replay
        last = len(r.t) - 1
        left = np.maximum(np.minimum(r.t.searchsorted(times, side="right") - 1, last - 1), 0)
        right = np.minimum(left + 1, last)
        begin, end = r.t[left], r.t[right]
        share = np.minimum(np.maximum(times - begin, 0.0) / np.where(end > begin, end - begin, np.inf), 1.0)
        jumps = self.restarts.searchsorted(right) < self.restarts.searchsorted(right, side="right")
        imu_share = np.where(jumps & (share < 1.0), 0.0, share)
        anchors = r.anchors.searchsorted(times, side="right")
        whole = {name: getattr(r, name) for name in _STATES} | {name: getattr(self.errors, name) for name in _ERRORS}
        columns = {
            name: _between(column[left], column[right], share if name.endswith("_ref") else imu_share)
            for name, column in whole.items()
        }
        columns |= {
            "t": times,
            "since_anchor_s": np.where(anchors > 0, times - np.append(r.anchors, 0.0)[anchors - 1], 0.0),
            "covariance": np.array([self._covariance(t) for t in times]).reshape(-1, 3, 3),
            "known": r.reference_valid[left] & r.reference_valid[right],
        }
        return [Sample(**dict(zip(columns, row, strict=True))) for row in zip(*columns.values(), strict=True)]

    def _covariance(self, t: float) -> Array:
        return np.zeros((3, 3)) if self.expected is None else self.expected.ellipsoid(t)


def with_result(shown: DisplayTrajectory, result: AnalysisResult) -> DisplayTrajectory:
    """The same with its analysis, and with the anchor that the analysis adds."""
    if result.replay is not None:
        shown = replace(display_trajectory(result.replay, shown.track), others=shown.others)
    return replace(shown, result=result, expected=_envelope_of(result.expected) if result.expected else None)


def display_trajectory(
    replay: Replay, track: ImuTrack | None = None, others: Mapping[str, Replay] | None = None
) -> DisplayTrajectory:
    """A replay without the samples that a screen cannot show: non-finite ones and quaternions of no length.

    track: the readings as they were integrated, with the chosen corrections taken off; None: not kept. others: the
    replays of other IMUs, by message name. Raises DataError when nothing is left.
    """
    q_norms = np.minimum(np.linalg.norm(replay.q_imu, axis=1), np.linalg.norm(replay.q_ref, axis=1))
    # A track that diverged to 1e30 m is finite here and infinite as the float32 that the browser gets.
    good = np.isfinite(replay.t) & (q_norms > 1e-9) & (q_norms < np.inf)
    for name in COLUMNS:
        size = np.abs(getattr(replay, name))
        if not size.max(initial=0.0) < MOST:  # row by row takes longer
            good &= (size < MOST).all(axis=1)
    if not good.any():
        raise DataError(
            f"None of the {len(replay.t)} samples of this replay is finite: there is nothing to show. "
            "Start later, or choose another IMU."
        )
    clean = replay if good.all() else samples_of(replay, good)
    clean = replace(
        clean,
        q_imu=quaternion.normalize(clean.q_imu),
        q_ref=quaternion.normalize(clean.q_ref),
        anchors=replay.anchors[np.isfinite(replay.anchors)],
    )
    return DisplayTrajectory(
        clean,
        track,
        errors=errors_of(clean.t, clean.attitude_error, clean.velocity_error, clean.position_error),
        restarts=np.searchsorted(clean.t, clean.anchors, side="left").astype(np.intp),
        others={name: display_trajectory(other) for name, other in (others or {}).items()},
    )


def samples_of(replay: Replay, chosen: slice | npt.NDArray[np.bool_]) -> Replay:
    """Some samples of a replay, with all of its anchors."""
    columns: dict[str, Any] = {name: getattr(replay, name)[chosen] for name in _SAMPLED}
    return replace(replay, **columns)


def joined(before: Replay, after: Replay) -> Replay:
    """One replay until another of the same flight begins, which has an anchor there, and that one from then on."""
    kept = samples_of(before, before.t < after.t[0])
    columns: dict[str, Any] = {name: np.concatenate([getattr(kept, name), getattr(after, name)]) for name in _SAMPLED}
    anchors = np.concatenate([before.anchors[before.anchors < after.t[0]], after.anchors])
    return replace(before, **columns, anchors=anchors)


_STATES = ("q_imu", "velocity_imu", "position_imu", "q_ref", "velocity_ref", "position_ref")
COLUMNS = (*_STATES, "attitude_error", "velocity_error", "position_error")
_SAMPLED = ("t", *COLUMNS, "reference_valid")
_ERRORS = ("tilt_deg", "heading_deg", "velocity_mps", "position_m")
_STALE_S = 1.0  # between the ends of two windows: longer is a stretch where none could be used


def _between(a: Array, b: Array, share: Array) -> Array:
    """Straight lines between neighbouring samples, (F,), (F, 3) or rotations (F, 4), which are put back to unit length.

    Signs of rotations are chosen so that a·b >= 0; the length before is at least √½ then.
    """
    if a.ndim == 1:
        return a + share * (b - a)
    if a.shape[1] == 3:
        return a + share[:, None] * (b - a)
    b = np.where((a * b).sum(axis=1, keepdims=True) < 0, -b, b)
    return quaternion.normalize(a + share[:, None] * (b - a))


@dataclass(frozen=True, slots=True)
class Worst:
    """The stretch of a replay that ends farthest apart."""

    start_s: float  # boot clock: where the dead reckoning last started from the autopilot
    end_s: float  # where they are farthest apart
    apart_m: float

    @property
    def span(self) -> tuple[float, float]:
        """From when to when, s."""
        return self.start_s, self.end_s


def worst_stretch(replay: Replay) -> Worst | None:
    """The instant at which IMU and autopilot are farthest apart, and the stretch that leads there.

    Only where the autopilot's state is known. None where the log has no position, or they never part.
    """
    known = np.flatnonzero(replay.reference_valid)
    if not replay.has_position or not len(known):
        return None
    distances = np.linalg.norm(np.nan_to_num(replay.position_error[known]), axis=1)
    at, apart = int(known[np.argmax(distances)]), float(distances.max())
    if apart <= 0.0:
        return None
    end = float(replay.t[at])
    before = replay.anchors[replay.anchors < end]
    start = float(before[-1]) if len(before) else float(replay.t[0])
    return Worst(start, end, apart)


CameraMode = Literal["Free", "Follow", "Chase", "From above", "Map"]
ExtraPath = Literal["gps", "best"]
EXTRA_PATHS: dict[ExtraPath, tuple[str, str, bool]] = {
    "gps": ("GPS fixes", "Positions of the GPS receiver, unfiltered", True),
    "best": ("Best estimate", "From IMU, GPS, compass, barometer and rest, without the autopilot's estimate", False),
}
"""Name, hint, and whether it is shown at first."""


class TrailSpan(NamedTuple):
    """How much of the paths is shown."""

    seconds: float | None  # up to the instant shown; None: since the start
    ahead: bool = False  # the rest of the path too
    anchored: bool = False  # since the anchor

    def around(self, t: float, anchor: float) -> tuple[float, float]:
        """From when to when, s, at the instant `t`; anchor: s, the last before it."""
        since = anchor if self.anchored else -np.inf if self.seconds is None else t - self.seconds
        return since, np.inf if self.ahead else t


NO_BIAS = (0.0, 0.0, 0.0)
Corrected = Literal["no", "flight", "file"]


@dataclass(frozen=True, slots=True)
class ReplayChoice:
    """Which IMU of a flight is dead-reckoned, and how."""

    imu: str | None = None  # message name; None: the flight's default
    others: tuple[str, ...] = ()  # IMUs whose trajectories are shown beside it, as they are
    how: Integration = field(default_factory=Integration)  # but for its gravity, which may depend on the flight
    gravity: str | float = "standard"  # "standard" (9.80665), "normal" (WGS-84 where it flew), or m/s²
    reanchor_s: float | None = 10.0  # start again from the autopilot's state every so many s; None: run free
    start_s: float | None = None  # s, boot clock, of the first anchor; None: as early as possible
    horizon_s: float = 5.0  # length of the windows of the drift "after so many seconds"
    correction: Corrected = "no"  # take out what calibration finds in this flight, or what is in a file
    gyro_bias: tuple[float, float, float] = NO_BIAS  # rad/s, FRD, taken off the readings
    accel_bias: tuple[float, float, float] = NO_BIAS  # m/s², FRD, taken off the readings

    def integration(self, flight: Flight) -> Integration:
        """How, for this flight. Raises DataError when gravity depends on where it flew and the log does not tell."""
        return replace(self.how, gravity=gravity_for(flight, self.gravity))

    @property
    def corrects(self) -> bool:
        """Whether the IMU's readings are changed before they are integrated."""
        return self.correction != "no" or self.gyro_bias != NO_BIAS or self.accel_bias != NO_BIAS


Recompute = Callable[[Flight, ReplayChoice], DisplayTrajectory]
"""Dead-reckons a flight as chosen. Raises CompanionError when that cannot be done. Runs in a worker thread."""
Examine = Callable[[Flight, ReplayChoice, DisplayTrajectory], AnalysisResult]
"""The analysis of what was dead-reckoned. Raises CompanionError likewise. Runs in another worker thread."""


@dataclass(frozen=True, slots=True)
class Offer:
    """What else can be chosen from, and said of what is shown. Its calls raise CompanionError as `Examine` does.

    judge: the verdict alone, which is known seconds before the rest; None: it comes with that. check: lanes and the
    checks before take-off, after the analysis in the same thread; report: one HTML file. None of either: nothing.
    """

    horizons_s: tuple[float, ...] = HORIZONS_S  # of the drift table
    correction_file: str | None = None  # the name of one that was given
    judge: Callable[[Flight, ReplayChoice, DisplayTrajectory], Verdict] | None = None
    check: Callable[[Flight, ReplayChoice, DisplayTrajectory], FlightChecks] | None = None
    report: Callable[[Flight, ReplayChoice, DisplayTrajectory], str] | None = None
    map_url: str | None = None  # template of a map's tiles; None: there is no map
    map_shown: bool = False  # from the start


_HORIZON_S = 5.0  # of the windows that the verdict is reached with


def first_horizon(horizons: Sequence[float]) -> float:
    """The one of a drift table that is shown first."""
    return _HORIZON_S if _HORIZON_S in horizons else horizons[len(horizons) // 2]


def chosen_track(flight: Flight, choice: ReplayChoice, correction: Correction = NO_CORRECTION) -> ImuTrack:
    """The readings of the chosen IMU with the correction and the chosen biases taken off."""
    track = flight.imu(choice.imu)
    if correction is not NO_CORRECTION:
        track = correction.apply(track)
    if choice.gyro_bias != NO_BIAS or choice.accel_bias != NO_BIAS:
        gyro, accel = Sensor(bias=np.array(choice.gyro_bias)), Sensor(bias=np.array(choice.accel_bias))
        track = correct(track, ImuModel(gyro, accel))
    return track
