"""A replay made ready for the eye: finite, in the units people read, and at any instant between two samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from companion.analysis import Replay
from companion.model import Array, DataError, ImuTrack
from companion.strapdown import SAME_TIME
from companion.view.state.decimation import Indices
from companion.view.state.insight import MOST, Envelope, Errors, Insight, envelope_of, errors_of


@dataclass(frozen=True, slots=True, eq=False)
class Reckoning:
    """A replay, the readings that it was made from, and the replays of other IMUs beside it."""

    replay: Replay
    track: ImuTrack | None = None  # as it was integrated, with the chosen corrections taken off; None: not kept
    others: Mapping[str, Replay] = field(default_factory=dict)  # by message name


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """What both say at one instant, and how far apart they are."""

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


@dataclass(frozen=True, slots=True, eq=False)
class Footage:
    """A replay with its errors as people read them. Everything in it is finite, every quaternion of unit length."""

    replay: Replay
    track: ImuTrack | None  # the readings, corrected as they were integrated; None: not kept
    errors: Errors  # at the replay's times
    restarts: Indices  # (A,) the first sample at or after each anchor: the IMU's track is broken just before it
    others: Mapping[str, Footage]  # other IMUs of the flight, by message name
    insight: Insight | None = None  # what the analysis says, once it has come
    envelope: Envelope | None = None  # of the errors since the anchor
    trailing: Errors | None = None  # over the chosen horizon, at the ends of its windows

    @property
    def source(self) -> str:
        """The IMU message that was reckoned, or "IMU"."""
        return self.track.source if self.track is not None else "IMU"

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

    @property
    def last(self) -> Sample:
        """The last sample: what `at(end)` is, in a tenth of the time."""
        r, errors = self.replay, self.errors
        begun = r.anchors[r.anchors <= r.t[-1]]
        return Sample(
            t=self.end,
            q_imu=r.q_imu[-1],
            position_imu=r.position_imu[-1],
            q_ref=r.q_ref[-1],
            position_ref=r.position_ref[-1],
            tilt_deg=float(errors.tilt_deg[-1]),
            heading_deg=float(errors.heading_deg[-1]),
            velocity_mps=float(errors.velocity_mps[-1]),
            position_m=float(errors.position_m[-1]),
            since_anchor_s=self.end - float(begun[-1]) if len(begun) else 0.0,
            velocity_imu=r.velocity_imu[-1],
            velocity_ref=r.velocity_ref[-1],
            covariance=self._covariance(self.end),
            known=bool(r.reference_valid[-2:].all()),
        )

    def samples(self, times: Array) -> list[Sample]:
        """The instants `times` (F,) s, between two samples by straight lines; beyond the ends the first or last sample.

        Across an anchor the IMU's track jumps back to the autopilot's: there the sample before is held.
        """
        r, errors = self.replay, self.errors
        last = len(r.t) - 1
        left = np.maximum(np.minimum(r.t.searchsorted(times, side="right") - 1, last - 1), 0)
        right = np.minimum(left + 1, last)
        begin, end = r.t[left], r.t[right]
        share = np.minimum(np.maximum(times - begin, 0.0) / np.where(end > begin, end - begin, np.inf), 1.0)
        jumps = self.restarts.searchsorted(right) < self.restarts.searchsorted(right, side="right")
        imu_share = np.where(jumps & (share < 1.0), 0.0, share)

        def line(values: Array, s: Array) -> Array:
            start = values[left]
            return np.asarray(start + (s * (values[right] - start).T).T, dtype=np.float64)

        anchors = r.anchors.searchsorted(times, side="right")
        since = np.where(anchors > 0, times - np.append(r.anchors, 0.0)[anchors - 1], 0.0)
        columns = {
            "t": times.tolist(),
            "q_imu": _between(r.q_imu[left], r.q_imu[right], imu_share),
            "position_imu": line(r.position_imu, imu_share),
            "q_ref": _between(r.q_ref[left], r.q_ref[right], share),
            "position_ref": line(r.position_ref, share),
            "tilt_deg": line(errors.tilt_deg, imu_share).tolist(),
            "heading_deg": line(errors.heading_deg, imu_share).tolist(),
            "velocity_mps": line(errors.velocity_mps, imu_share).tolist(),
            "position_m": line(errors.position_m, imu_share).tolist(),
            "since_anchor_s": since.tolist(),
            "velocity_imu": line(r.velocity_imu, imu_share),
            "velocity_ref": line(r.velocity_ref, share),
            "covariance": [self._covariance(t) for t in times],
            "known": (r.reference_valid[left] & r.reference_valid[right]).tolist(),
        }
        return [Sample(**dict(zip(columns, row, strict=True))) for row in zip(*columns.values(), strict=True)]

    def _covariance(self, t: float) -> Array:
        return np.zeros((3, 3)) if self.envelope is None else self.envelope.ellipsoid(t)

    def after_horizon(self, t: float) -> tuple[float, float] | None:
        """Attitude error (°) and position error (m) of the window of the chosen horizon that ends at `t`, s.

        None before the first such window, and where it could not be used.
        """
        errors = self.trailing
        if errors is None or not len(errors.t):
            return None
        i = int(np.searchsorted(errors.t, t + SAME_TIME, side="right")) - 1
        if i < 0 or t - errors.t[i] > _STALE_S:
            return None
        return float(np.hypot(errors.tilt_deg[i], errors.heading_deg[i])), float(errors.position_m[i])


def footage(reckoning: Reckoning) -> Footage:
    """The replay without the samples that a screen cannot show: non-finite ones and quaternions of no length.

    Raises DataError when nothing is left.
    """
    others = {name: _film(replay, None) for name, replay in reckoning.others.items()}
    return replace(_film(reckoning.replay, reckoning.track), others=others)


def with_insight(film: Footage, insight: Insight) -> Footage:
    """The same footage with what the analysis says of it."""
    trailing = insight.trailing
    return replace(
        film,
        insight=insight,
        envelope=envelope_of(insight.expected) if insight.expected else None,
        trailing=errors_of(trailing.end_s, trailing.attitude, trailing.velocity, trailing.position),
    )


def _film(replay: Replay, track: ImuTrack | None) -> Footage:
    q_norms = np.minimum(np.linalg.norm(replay.q_imu, axis=1), np.linalg.norm(replay.q_ref, axis=1))
    # A track that diverged to 1e30 m is finite here and infinite as the float32 that the browser gets.
    good = np.isfinite(replay.t) & (q_norms > 1e-9) & (q_norms < np.inf)
    for name in _COLUMNS:
        size = np.abs(getattr(replay, name))
        if not size.max(initial=0.0) < MOST:  # row by row takes longer
            good &= (size < MOST).all(axis=1)
    if not good.any():
        raise DataError(
            f"None of the {len(replay.t)} samples of this replay is finite: there is nothing to show. "
            "Start later, or choose another IMU."
        )
    clean = replay
    if not good.all():
        clean = replace(
            replay,
            t=replay.t[good],
            **{name: getattr(replay, name)[good] for name in _COLUMNS},
            reference_valid=replay.reference_valid[good],
        )
    clean = replace(
        clean,
        q_imu=_unit(clean.q_imu),
        q_ref=_unit(clean.q_ref),
        anchors=replay.anchors[np.isfinite(replay.anchors)],
    )
    return Footage(
        clean,
        track,
        errors=errors_of(clean.t, clean.attitude_error, clean.velocity_error, clean.position_error),
        restarts=np.searchsorted(clean.t, clean.anchors, side="left").astype(np.intp),
        others={},
    )


_COLUMNS = (
    "q_imu",
    "velocity_imu",
    "position_imu",
    "q_ref",
    "velocity_ref",
    "position_ref",
    "attitude_error",
    "velocity_error",
    "position_error",
)
_STALE_S = 1.0  # between the ends of two windows: longer is a stretch where none could be used


def _unit(q: Array) -> Array:
    return np.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True), dtype=np.float64)


def _between(a: Array, b: Array, share: Array) -> Array:
    """Rotations (F, 4) between neighbouring samples: straight lines in the quaternions, put back to unit length.

    Signs are chosen so that a·b >= 0; the length before is at least √½ then.
    """
    b = np.where((a * b).sum(axis=1, keepdims=True) < 0, -b, b)
    return _unit(a + share[:, None] * (b - a))
