"""The compass: which one is read, and the field that it should read, at the time that it was read.

With C = C(q_ned_frd) at the keyframe, m the Earth's field in NED, h the hard and S the soft iron and τ_m the latency:

    z = (I + S) C(t - τ_m)ᵀ m + h
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from companion.constants import healthy, num
from companion.estimation.readings import AidingSensor, Intake, Kinematics, Prediction, Readings, three_samples, through
from companion.model import Array, ImuTrack, interpolated
from companion.strapdown import quaternion, skew


def read_compass(sensor: AidingSensor, intake: Intake) -> Readings | None:
    """The compass that goes with the IMU, else the first that reads something."""
    compasses, track = intake.flight.compasses, intake.imu
    usable = [one for one in compasses if len(one) > 10 and _plausible(one.field)]
    if not usable:
        if compasses:
            intake.notes.append("no compass is used: its readings are constant, or no field of the Earth")
        return None
    one = next((c for c in usable if c.source == track.source), usable[0])
    when, field = one.t, one.field
    good = np.isfinite(field).all(axis=1) & (np.linalg.norm(field, axis=1) > 5e-6)
    if not good.all():
        when, field = when[good], field[good]
    spacing = intake.spacing if intake.gps is not None else max(intake.spacing, num.NO_GPS_SPACING_S)
    readings = sensor.at_keyframes(when, field, intake.t, spacing)
    readings = _averaged(readings, when, field, _hardly_turned(track, readings.t))
    sample = np.clip(np.searchsorted(track.t, readings.t), 0, len(track) - 1).astype(np.intp)
    sample = three_samples(track, sample, num.FIELD_SAMPLES_S, before=2)
    return replace(readings, value=readings.value * num.MICROTESLA, sample=sample)


def _averaged(one: Readings, when: Array, value: Array, half_s: Array) -> Readings:
    """Readings (M, d) that are each the mean of those at times `when` (N,) within half_s (M,) of it, either way alike.

    What scatters from one to the next is less by the root of their number; what changes evenly meanwhile cancels.
    """
    i = np.searchsorted(when, one.t)
    n = np.minimum(i - np.searchsorted(when, one.t - half_s), np.searchsorted(when, one.t + half_s, "right") - 1 - i)
    sums = np.concatenate([np.zeros((1, 1 + value.shape[1])), np.cumsum(np.column_stack([when, value]), axis=0)])
    mean = (sums[i + n + 1] - sums[i - n]) / (2 * n + 1)[:, None]
    return replace(one, t=mean[:, 0], value=mean[:, 1:])


def _hardly_turned(track: ImuTrack, t: Array) -> Array:
    """(M,) s, for how long before and after times t (M,) a mean of directions is as good as one that is turned back."""
    turned = np.cumsum(track.gyro[1:] * np.diff(track.t)[:, None], axis=0)
    reach = healthy.FIELD_MEAN_S
    before, after = (interpolated(t + apart, track.t[1:], turned) for apart in (-reach, reach))
    angle = 0.5 * np.linalg.norm(after - before, axis=1)
    return np.asarray(healthy.FIELD_MEAN_S * num.FIELD_MEAN_RAD / np.maximum(angle, num.FIELD_MEAN_RAD))


def _plausible(field: Array) -> bool:
    """Whether most readings have the size of a field on Earth (22 to 67 µT, with room for iron)."""
    size = np.linalg.norm(field[np.isfinite(field).all(axis=1)], axis=1)
    return bool(len(size) > 10 and 10e-6 < np.median(size) < 150e-6 and np.ptp(field, axis=0).max() > 0)


def predict_field(one: Readings, at: Kinematics) -> Prediction:
    """The field when the reading was taken: the IMU turns the keyframe's attitude until then, and says how fast."""
    states, path = at.states, at.path
    start, samples = path.row(at.index[one.keyframe]), path.row(one.sample)
    turned = quaternion.log(quaternion.multiply(quaternion.conjugate(path.q[start])[:, None], path.q[samples]))
    when = path.t[samples]
    across_gap = when[:, 2] - when[:, 0] > num.GAP_S
    turned[across_gap] = turned[across_gap, 2:]
    angle, rate = through(when, turned, one.t - states.constant("compass_latency"))
    q = quaternion.multiply(states.q_ned_frd[one.keyframe], quaternion.exp(angle))
    matrix = quaternion.to_matrix(q).swapaxes(-1, -2)
    field = states.constant("earth_field")
    iron = np.eye(3) + states.constant("soft_iron").reshape(3, 3)
    in_body = matrix @ field
    across = quaternion.cross(angle, rate)
    rate = rate - quaternion.cross(angle, rate - across / 3.0) / 2.0  # of the body, not of the rotation vector
    derivatives = {
        "attitude": iron @ matrix @ skew(field),
        "earth_field": iron @ matrix,
        "hard_iron": np.eye(3),
        "soft_iron": np.einsum("ij,mk->mijk", np.eye(3), in_body).reshape(-1, 3, 9),
        "compass_latency": iron @ quaternion.cross(rate, in_body)[..., None],
    }
    return Prediction(np.asarray(in_body @ iron.T + states.constant("hard_iron")), derivatives)
