"""How far a replay's two trajectories are apart, by the metrics of trajectory evaluation, and how far they should be.

APE and RPE (evo, TUM RGB-D benchmark) are here so that a result can be held against other tools: the same definitions,
no alignment, no scale. What the verdict stands on is the drift (`companion.comparison.drift`); docs/trajectories.md
says how the three differ. What they should be is the budget from each anchor on, as a line over time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from companion.comparison.budget import ATTITUDE, POSITION, VELOCITY, budget, expected_over, mean_square
from companion.comparison.imu_spec import ImuSpec, ReferenceSpec
from companion.comparison.reference import attitude_error, length
from companion.comparison.replay import Replay
from companion.comparison.windows import Comparison, Windows, windows
from companion.constants import num
from companion.model import Array, DataError, IntArray, SettingsError, nearest
from companion.strapdown import quaternion


@dataclass(frozen=True, slots=True)
class Spread:
    """Statistics of an error, under the names that evo gives them."""

    rmse: float
    mean: float
    median: float
    std: float
    min: float
    max: float


@dataclass(frozen=True, slots=True)
class PoseError:
    """Position and attitude error of a trajectory; None for position when the flight has none."""

    samples: int
    position_m: Spread | None
    attitude_deg: Spread


def ape(shown: Replay) -> PoseError:
    """Absolute pose error at every sample where the autopilot's state is known.

    Position: |p_ref - p_imu| (evo's translation part). Attitude: the angle of q_ref⁻¹ ⊗ q_imu (evo's angle_deg). The
    dead reckoning counts since its last anchor. Raises DataError when the replay has no such sample.

    >>> import companion as c
    >>> found = c.ape(c.replay(c.open_log("tlogs/copter-demo-100hz.tlog")[0]))
    >>> f"{found.position_m.rmse:.4f} m, {found.attitude_deg.rmse:.4f}°"
    '0.7497 m, 0.4482°'
    """
    known = shown.reference_valid
    return _pose_error(shown, length(shown.position_error[known]), length(shown.attitude_error[known]))


def rpe(shown: Replay, step: int) -> PoseError:
    """Relative pose error from sample to the `step`-th after it, end to end (evo_rpe --delta STEP --delta_unit f).

    How the motion between the two samples differs: E = (Q_i⁻¹ Q_j)⁻¹ (P_i⁻¹ P_j), Q the autopilot's poses, P the IMU's;
    position is the length of E's translation, attitude the angle of its rotation (Sturm et al. 2012, equation 1).
    Raises SettingsError when `step` is not positive, DataError when the replay is shorter.
    """
    if not isinstance(step, int | np.integer) or step < 1:
        raise SettingsError(f"the step must be one sample or more, got {step!r}")
    known = np.flatnonzero(shown.reference_valid)[::step]
    start, end = known[:-1], known[1:]
    turn_ref, move_ref = _motion(shown.q_ref, shown.position_ref, start, end)
    turn_imu, move_imu = _motion(shown.q_imu, shown.position_imu, start, end)
    return _pose_error(shown, length(move_imu - move_ref), length(attitude_error(turn_ref, turn_imu)))


def _motion(q: Array, position: Array, start: IntArray, end: IntArray) -> tuple[Array, Array]:
    """Rotation (N, 4) and translation (N, 3) from pose to pose, in the body's axes at the start."""
    back = quaternion.conjugate(q[start])
    return quaternion.multiply(back, q[end]), quaternion.rotate(back, position[end] - position[start])


def _pose_error(shown: Replay, position: Array, angle: Array) -> PoseError:
    if not len(angle):
        raise DataError("no samples at which both poses are known")
    return PoseError(len(angle), _spread(position) if shown.has_position else None, _spread(np.degrees(angle)))


def _spread(values: Array) -> Spread:
    rmse, middle = np.sqrt(np.mean(values**2)), (values.mean(), np.median(values))
    return Spread(*map(float, (rmse, *middle, values.std(), values.min(), values.max())))


@dataclass(frozen=True, slots=True, eq=False)
class Expectation:
    """The expected error of a replay, at times of its own. At an anchor it steps: just before it, and at it."""

    t: Array  # (M,) s, boot clock, increasing strictly
    covariance: Array  # (M, 9, 9) of rotation vector rad, velocity m/s and position m, NED, autopilot minus IMU

    @property
    def lengths(self) -> tuple[Array, Array, Array]:
        """1σ (root mean square) of the error's length, each (M,): attitude °, velocity m/s, position m."""
        squares = (mean_square(self.covariance[:, b, b]) for b in (ATTITUDE, VELOCITY, POSITION))
        attitude, velocity, position = (np.sqrt(np.maximum(square, 0.0)) for square in squares)
        return np.degrees(attitude), velocity, position


def expected_since_anchor(
    comparison: Comparison, imu_spec: ImuSpec, autopilot: ReferenceSpec, shown: Replay
) -> Expectation | None:
    """What the budget allows `shown` to be off by: a replay of the track that is compared, integrated alike.

    None where it runs on for longer than two minutes from an anchor, has more anchors than can be worked out, or began
    from rest: the budget is of windows that begin from the autopilot's state.
    """
    if shown.from_rest:
        return None
    ends = np.append(shown.anchors[1:], shown.t[-1])
    if np.max(ends - shown.anchors) > num.POSE_MAX_S or 3 * len(shown.anchors) > num.POSE_POINTS:
        return None
    t = comparison.track.t
    steps = np.linspace(0.0, 1.0, num.POSE_POINTS // len(shown.anchors)) ** 1.5
    times = shown.anchors[:, None] + steps * (ends - shown.anchors)[:, None]
    start = np.repeat(nearest(t, shown.anchors), len(steps))
    end = np.maximum(nearest(t, times.ravel()), start)
    allowed = budget(comparison, Windows(0.0, start, end, {}), imu_spec, autopilot)
    times = t[end].reshape(times.shape).copy()
    times[:-1, -1] -= 1e-6  # the last before the next anchor
    times, first = np.unique(times.ravel(), return_index=True)
    return Expectation(times, allowed.total[first])


def expected_by_age(
    comparison: Comparison, imu_spec: ImuSpec, autopilot: ReferenceSpec, ages_s: Sequence[float]
) -> Array:
    """What the budget allows so long after an anchor, (A, 4): s, and 1σ of the error's length: °, m/s, m.

    The median over the windows of each length; lengths without a window are left out, and what the flight has no
    position for is 0.
    """
    every = ((age, expected_over(comparison, windows(comparison, age), imu_spec, autopilot)) for age in ages_s)
    known = ((age, one) for age, one in every if one is not None)
    rows = [(age, one.attitude_deg, one.velocity_mps or 0.0, one.position_m or 0.0) for age, one in known]
    return np.array(rows, dtype=np.float64).reshape(-1, 4)
