"""APE and RPE: the metrics of trajectory evaluation (evo, TUM RGB-D benchmark), of a replay's two trajectories.

Drift (`companion.analysis.drift`) is what the verdict stands on. These are here so that a result can be held against
other tools: the same definitions, no alignment, no scale. docs/trajectories.md says how the three differ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.analysis.comparison import IntArray
from companion.analysis.navigation_error import attitude_error, length
from companion.analysis.replay import Replay
from companion.model import Array
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
    reckoning counts since its last anchor. Raises ValueError when the replay has no such sample.

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
    Raises ValueError when `step` is not positive or the replay is shorter.
    """
    if step < 1:
        raise ValueError(f"the step must be one sample or more, got {step}")
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
        raise ValueError("no samples at which both poses are known")
    return PoseError(len(angle), _spread(position) if shown.has_position else None, _spread(np.degrees(angle)))


def _spread(values: Array) -> Spread:
    return Spread(
        rmse=float(np.sqrt(np.mean(values**2))),
        mean=float(values.mean()),
        median=float(np.median(values)),
        std=float(values.std()),
        min=float(values.min()),
        max=float(values.max()),
    )
