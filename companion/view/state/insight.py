"""What the analysis says of a reckoning, made ready for charts and tables. It comes later than the picture."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from companion.analysis import Assessment, Expectation, ImuNoise, RedundantImu, Replay, WindowErrors
from companion.model import Array, words
from companion.view.state.marks import Mark

MOST = 1e12
"""A figure that diverged is finite here and infinite as the float32 that the browser gets: it is cut off."""


@dataclass(frozen=True, slots=True, eq=False)
class Insight:
    """The analysis of the IMU that is shown, integrated and corrected as it is shown."""

    assessment: Assessment
    trailing: WindowErrors  # the error over the chosen horizon, of a window that ends at every sample
    horizon_s: float
    redundant_imus: tuple[RedundantImu, ...] = ()
    expected: Expectation | None = None  # over the replay; None where it cannot be said
    noise: ImuNoise | None = None  # of that IMU as it was read; None where the log is too short to tell

    @property
    def marks(self) -> tuple[Mark, ...]:
        """The findings as marks of the timeline, in the order of the verdict."""
        return tuple(
            Mark(f.start_s, f"{words(f.kind)}: {f.evidence}", "finding") for f in self.assessment.verdict.findings
        )


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """How far both are apart, in the units people read."""

    t: Array  # (N,) s, boot clock
    tilt_deg: Array  # (N,) size of the horizontal part of the attitude error
    heading_deg: Array  # (N,) its vertical part: positive when the autopilot points clockwise of the IMU, from above
    velocity_mps: Array  # (N,)
    position_m: Array  # (N,)

    def at(self, t: float, column: str) -> float:
        """The value at the last sample up to `t`, s; of the first before it."""
        i = max(int(np.searchsorted(self.t, t, side="right")) - 1, 0)
        return float(getattr(self, column)[i])


def errors_of(t: Array, attitude: Array, velocity: Array, position: Array) -> Errors:
    """Errors (N, 3) as analysis has them (rad, m/s, m, NED) in degrees and as lengths; finite."""
    degrees = _bounded(np.degrees(attitude))

    def length(vectors: Array) -> Array:
        return np.asarray(np.linalg.norm(_bounded(vectors), axis=1))

    return Errors(t, length(degrees[:, :2]), degrees[:, 2].copy(), length(velocity), length(position))


def _bounded(values: Array) -> Array:
    if np.abs(values).max(initial=0.0) <= MOST:  # which NaN is not
        return values
    return np.clip(np.nan_to_num(values), -MOST, MOST)


@dataclass(frozen=True, slots=True, eq=False)
class Envelope:
    """How far apart both are expected to be: one standard deviation of each error's length, over time."""

    t: Array  # (M,) s, boot clock, increasing
    attitude_deg: Array  # (M,)
    velocity_mps: Array  # (M,)
    position_m: Array  # (M,)
    covariance: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))  # (M, 3, 3) of the position, NED, m²

    def at(self, t: float) -> tuple[float, float, float]:
        """Attitude °, velocity m/s, position m at `t`, s."""
        attitude, velocity, position = (
            float(np.interp(t, self.t, line)) for line in (self.attitude_deg, self.velocity_mps, self.position_m)
        )
        return attitude, velocity, position

    def ellipsoid(self, t: float) -> Array:
        """Covariance of the position (3, 3) at `t`, s: on a straight line between those that are known."""
        if not len(self.covariance):
            return np.zeros((3, 3))
        i = int(np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2))
        share = float(np.clip((t - self.t[i]) / (self.t[i + 1] - self.t[i]), 0.0, 1.0))
        return np.asarray((1 - share) * self.covariance[i] + share * self.covariance[i + 1])


def envelope_of(expected: Expectation) -> Envelope:
    """The lengths and the position's covariance of an expectation, finite."""
    attitude, velocity, position = (np.clip(np.nan_to_num(line, posinf=MOST), 0.0, MOST) for line in expected.lengths)
    covariance = np.nan_to_num(expected.covariance[:, 6:9, 6:9], posinf=MOST**2)
    return Envelope(expected.t, attitude, velocity, position, np.clip(covariance, -(MOST**2), MOST**2))


@dataclass(frozen=True, slots=True)
class Worst:
    """The stretch of a replay that ends farthest apart."""

    start_s: float  # boot clock: where the reckoning last started from the autopilot
    end_s: float  # where they are farthest apart
    apart_m: float


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
