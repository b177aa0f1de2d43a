"""What an estimator takes off an IMU, from two messages that speak of the same sensor with and without it.

PX4: SCALED_IMU is the sensor, HIGHRES_IMU the selected sensor minus the EKF's biases. ArduPilot: the rates of ATTITUDE
are the gyro that the EKF uses minus its gyro bias (AP_AHRS_NavEKF). Each block of some seconds gives one value.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from companion.model import IMU_MESSAGES, Array, AttitudeTrack, BiasTrack, ImuTrack, SensorInUse, nearest
from companion.telemetry.convert import Turns, turned_vectors

_TOGETHER_S = 0.02  # samples of two messages that belong together: sent in one go, or within a period
_BLOCK_S = 5.0
_FEWEST = 5  # pairs in a block
_SAME_S, _FEWEST_ALIKE = 0.5e-3, 20  # stamps of one instant, and how many readings of it tell
_MOST_DELAY_MS = 10.0  # of a reading until it is published: the period of the slowest IMU_INTEG_RATE
_SCALED = tuple(name for name, one in IMU_MESSAGES.items() if one.numbered)
_SAME_STEPS = 1.2  # the readings of one sensor differ by less than a step when the bias is taken out
_MOVES_STEPS = 5.0  # a reading that moves less is met by another sensor's by chance


def selected_imu(
    imus: Mapping[str, ImuTrack], parameters: Mapping[str, float], notes: list[str]
) -> tuple[str | None, int | None]:
    """Which SCALED_IMUn is the sensor that PX4 has selected, which HIGHRES_IMU speaks of; and its instance.

    By their readings; where no two of them are of one instant, by the number of gyros that the parameters know. None
    where nothing tells. A sensor that no SCALED_IMUn speaks of is taken for the first that the log has none of.
    """
    if "HIGHRES_IMU" not in imus:
        return None, None
    others = []
    for name in (name for name in _SCALED if name in imus):
        same = same_sensor(imus[name], imus["HIGHRES_IMU"])
        if same or (same is None and name == "SCALED_IMU" and parameters.get("CAL_GYRO1_ID") == 0):
            return name, imus[name].instance
        if same is False:
            others.append(name)
    if not others or len(others) < sum(name in imus for name in _SCALED):
        return None, None
    instance = next(i for i in range(len(_SCALED) + 1) if all(imus[name].instance != i for name in others))
    notes.append(f"HIGHRES_IMU is of another sensor than {' and '.join(others)}: IMU {instance}, it seems")
    return None, instance


def same_sensor(one: ImuTrack, other: ImuTrack) -> bool | None:
    """Whether two messages have the same readings but for a bias that changes slowly; None where that does not show.

    PX4 stamps SCALED_IMU when a reading is published and HIGHRES_IMU when it was sampled (streams/SCALED_IMU.hpp,
    HIGHRES_IMU.hpp): the two stamps of one reading differ by a delay that the processor's load sets, and equal stamps
    may be of two readings. So every delay is tried; that the sensors differ shows only where each has pairs enough.
    """
    stamps = np.unique(np.round(np.concatenate([one.t, other.t]) * 1e3))
    if len(stamps) < _FEWEST_ALIKE:
        return None
    step_ms = float(np.diff(stamps).min())  # a simulator samples at whole multiples of some ms
    alike = [_alike(one, other, 1e-3 * delay) for delay in np.arange(0.0, _MOST_DELAY_MS + 0.5, step_ms)]
    return True if True in alike else None if None in alike else False


def _alike(one: ImuTrack, other: ImuTrack, delay: float) -> bool | None:
    """Whether readings stamped `delay` s apart are the same, where they move by more than chance would meet.

    The noise of two sensors differs from sample to sample; that of one is the same to the step to which it is cut.
    """
    mine, theirs = _pairs(one.t - delay, other.t, _SAME_S)
    tells = False
    for a, b, step in (
        (one.gyro, other.gyro, max(one.gyro_step, other.gyro_step, 1e-6)),
        (one.accel, other.accel, max(one.accel_step, other.accel_step, 1e-6)),
    ):
        jitter, moved = np.diff(a[mine] - b[theirs], axis=0), np.abs(np.diff(a[mine], axis=0)) > _MOVES_STEPS * step
        if np.count_nonzero(moved) < _FEWEST_ALIKE:
            continue
        if np.median(np.abs(jitter[moved])) > _SAME_STEPS * step:
            return False
        tells = True
    return True if tells else None


def px4_biases(
    imus: Mapping[str, ImuTrack], selected: str | None, *, dequantised: bool = False
) -> tuple[BiasTrack, ...]:
    """SCALED_IMUn minus HIGHRES_IMU for the one n that is the same sensor; empty where none is."""
    if selected is None:
        return ()
    track, without = imus[selected], imus["HIGHRES_IMU"]
    mine, theirs = _pairs(track.t, without.t, _TOGETHER_S)
    gyro, accel = track.gyro[mine], track.accel[mine]
    difference = np.hstack([gyro - without.gyro[theirs], accel - without.accel[theirs]])
    if not dequantised:
        difference += np.hstack([_half_steps(gyro, track.gyro_step), _half_steps(accel, track.accel_step)])
    return _track(track.t[mine], difference, f"{selected} - HIGHRES_IMU", track.instance)


def ardupilot_biases(
    imus: Mapping[str, ImuTrack],
    attitude: AttitudeTrack | None,
    used: SensorInUse | None,
    turns: Turns,
    *,
    dequantised: bool = False,
) -> tuple[BiasTrack, ...]:
    """Gyro minus the rates of ATTITUDE, for each IMU while the EKF used it (IMU 0 where the log does not tell).

    imus: turned by `turns`, the trim, which the rates are not.
    """
    if attitude is None or attitude.source != "ATTITUDE":
        return ()
    biases: list[BiasTrack] = []
    for instance in sorted({track.instance for track in imus.values()}):
        candidates = [track for track in imus.values() if track.instance == instance]
        track = min(candidates, key=lambda one: (len(one) < 0.9 * max(map(len, candidates)), one.gyro_step))
        mine, theirs = _pairs(track.t, attitude.t, _TOGETHER_S)
        in_use = np.zeros(len(mine)) if used is None else used.at(track.t[mine])
        mine, theirs = mine[in_use == instance], theirs[in_use == instance]
        rates = turned_vectors(attitude.t, attitude.rates, turns)
        read = track.gyro[mine]
        difference = np.full((len(mine), 6), np.nan)  # of the accelerometer nothing is known
        difference[:, :3] = read - rates[theirs]
        if not dequantised:
            difference[:, :3] += _half_steps(read, track.gyro_step)
        biases += _track(track.t[mine], difference, f"{track.source} - ATTITUDE", instance)
    return tuple(biases)


def _track(t: Array, difference: Array, source: str, instance: int) -> tuple[BiasTrack, ...]:
    """The medians of blocks of (N, 6), with the standard error of each."""
    if not len(t):
        return ()
    block = np.floor((t - t[0]) / _BLOCK_S).astype(np.int64)
    edges = np.flatnonzero(np.diff(block, prepend=-1, append=block[-1] + 1))
    rows = []
    for first, last in pairwise(edges.tolist()):
        if last - first >= _FEWEST:
            piece = difference[first:last]
            middle = np.median(piece, axis=0)
            error = 1.4826 * np.median(np.abs(piece - middle), axis=0) * np.sqrt(np.pi / 2 / (last - first))
            rows.append(np.concatenate([[t[first:last].mean()], middle, error]))
    if not rows:
        return ()
    table = np.array(rows)
    gyro, accel, gyro_sigma, accel_sigma = (table[:, i : i + 3] for i in (1, 4, 7, 10))
    return (BiasTrack(table[:, 0], gyro, accel, gyro_sigma, accel_sigma, source, 0, instance),)


def _half_steps(readings: Array, step: float) -> Array:
    """What readings (N, 3) lack on average that are cut towards zero to whole steps."""
    return np.asarray(0.5 * step * np.sign(readings))


def _pairs(t: Array, other: Array, within: float) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Indices of the samples that have one of the other track beside them, and of those."""
    if len(other) < 2:
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    beside = nearest(other, t)
    near = np.abs(other[beside] - t) < within
    return np.flatnonzero(near), beside[near]
