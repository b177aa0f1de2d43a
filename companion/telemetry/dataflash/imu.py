"""The IMUs of an ArduPilot log: IMU (filtered, at the logger's rate), and ACC and GYR (unfiltered, every sample).

Sources: ArduPilot `AP_InertialSensor_Logging.cpp`, `AP_InertialSensor_Backend.cpp` (log_gyro_raw), `BatchSampler.cpp`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from companion.logs import Records
from companion.model import Array, ImuTrack, Vehicle, interpolated
from companion.telemetry.clock import LONGEST_WAIT_S
from companion.telemetry.dataflash.sensors import sources
from companion.telemetry.parameters import known_ranges, with_facts
from companion.telemetry.samples import imu_track, increasing

_VECTORS = tuple(f"{kind}{axis}" for kind in ("Gyr", "Acc") for axis in "XYZ")
_IMU = ("IMU", "IMU2", "IMU3")
_RAW = {"Gyr": ("GYR", "GYR1", "GYR2", "GYR3"), "Acc": ("ACC", "ACC1", "ACC2", "ACC3")}
"""Before 2020 each IMU has a record type of its own, counted from 1."""

NUMBERS: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(_IMU, _VECTORS),
    **{name: ("SampleUS", *(f"{kind}{axis}" for axis in "XYZ")) for kind, names in _RAW.items() for name in names},
    "ISBH": ("N", "type", "instance", "mul", "smp_cnt", "SampleUS", "smp_rate"),
    "ISBD": ("N", "seqno"),
}
"""Columns that these records must have."""

_SPAN = 64  # samples over which the times of a FIFO are smoothed: it is read every 1-2 ms, 1-16 samples at once
_GAP = 8.0  # of the mean interval: samples are missing


def imu_tracks(
    records: dict[str, Records], vehicle: Vehicle, parameters: Mapping[str, float], notes: list[str]
) -> dict[str, ImuTrack]:
    """IMU[0], IMU[1], ... as log viewers call them, then GYR[0], ... where every sample was logged.

    Their records are let go: they are most of a log.
    """

    def made(key: str, number: int, t: Array, gyro: Array, accel: Array) -> ImuTrack:
        ranges = known_ranges(vehicle, parameters, number)
        track = imu_track(key, t, gyro, accel, np.ones(len(t), np.bool_), notes, ranges)
        return with_facts(replace(track, instance=number), vehicle, parameters)

    tracks: dict[str, ImuTrack] = {}
    for number, key, one in sources({name: records.pop(name) for name in _IMU if name in records}, _IMU):
        tracks[key] = made(key, number, one.t, _vector(one, "Gyr"), _vector(one, "Acc"))
    filtered = {track.instance for track in tracks.values()}
    gyros, accels = (_every_sample(records, kind) for kind in ("Gyr", "Acc"))
    for number, one in gyros.items():
        if filtered and number not in filtered:
            notes.append(f"GYR[{number}] left out: it is another gyro once more, behind its filters (INS_RAW_LOG_OPT)")
        elif number not in accels:
            notes.append(f"GYR[{number}] left out: the accelerometer of this IMU was not logged at its full rate")
        else:
            key = f"GYR[{number}]"
            for name, sensed in ((key, one), (f"ACC[{number}]", accels[number])):
                if far := int((~_near(sensed)).sum()):
                    notes.append(
                        f"{name}: {far} of {len(sensed)} left out: the time of the sample is {LONGEST_WAIT_S:g} s and "
                        "more off that of its record"
                    )
            track = made(key, number, *_paired(one, accels[number]))
            tracks[key] = replace(track, gyro_low_pass_hz=None, accel_low_pass_hz=None)
    if "ISBH" in records:
        notes.append(_batch_note(records["ISBH"]))
    return {key: track for key, track in tracks.items() if len(track)}


def _vector(one: Records, kind: str) -> Array:
    return np.column_stack([one.in_unit(f"{kind}{axis}") for axis in "XYZ"])


def _every_sample(records: dict[str, Records], kind: str) -> dict[int, Records]:
    """ACC or GYR of each IMU. Taken out of the records."""
    name, *older = _RAW[kind]
    own = {name: records.pop(name)} if name in records else {}
    by_number = {number: one for number, _, one in sources(own, (name,))}
    return by_number or {number: records.pop(old) for number, old in enumerate(older) if old in records}


def _paired(gyro: Records, accel: Records) -> tuple[Array, Array, Array]:
    """The gyro's samples at their times (N,) s, with the accelerometer's linearly interpolated to them.

    Both run freely, at about the same rate. Where either was not logged, nothing is made up.
    """
    (t, rate), (when, force) = _in_time(gyro, "Gyr"), _in_time(accel, "Acc")
    if len(t) < 2 or len(when) < 2:
        return t[:0], rate[:0], force[:0]
    after = np.searchsorted(when, t).clip(1, len(when) - 1)
    inside = (t >= when[0]) & (t <= when[-1]) & (when[after] - when[after - 1] < _GAP * _mean_step(when))
    t, rate = t[inside], rate[inside]
    return t, rate, interpolated(t, when, force)


def _in_time(one: Records, kind: str) -> tuple[Array, Array]:
    """Sample times (N,) s and readings (N, 3) in order of time.

    A FIFO's samples carry the time at which it was read, 1-16 of them nearly the same one: there the times are the
    running mean of those around, as the sensor samples evenly.
    """
    t, values = _sample_times(one), _vector(one, kind)
    good = np.isfinite(values).all(axis=1) & _near(one)
    keep = increasing(t, np.asarray(good))
    t, values = t[keep], values[keep]
    if len(t) > _SPAN and np.mean(np.diff(t) < 0.25 * _mean_step(t)) > 0.1:
        step = np.diff(t)
        edges = [0, *(np.flatnonzero(step > _longest_step(step)) + 1).tolist(), len(t)]
        t = np.concatenate([_even(_even(t[begin:end])) for begin, end in pairwise(edges)])
    return t, values


def _sample_times(one: Records) -> Array:
    """When each was measured, (N,) s."""
    return np.asarray(one["SampleUS"].astype(np.float64) * 1e-6)


def _near(one: Records) -> npt.NDArray[np.bool_]:
    """Which samples (N,) were measured about when their record was written."""
    return np.asarray(np.abs(_sample_times(one) - one.t) < LONGEST_WAIT_S)


def _even(t: Array) -> Array:
    """Bunched times (N,) s, increasing: each the mean of as many on either side of it as there are, up to a span."""
    sums = np.concatenate([[0.0], np.cumsum(t - t[0])])
    at = np.arange(len(t))
    half = np.minimum(np.minimum(at, len(t) - 1 - at), _SPAN // 2)
    return np.asarray(t[0] + (sums[at + half + 1] - sums[at - half]) / (2 * half + 1))


def _mean_step(t: Array) -> float:
    """s between samples, gaps not counted."""
    step = np.diff(t)
    return float(step[step <= _longest_step(step)].mean())


def _longest_step(step: Array) -> float:
    """s, what is longer is a gap: in each read of a FIFO one step is long, and gaps are seldom."""
    return 3.0 * float(np.percentile(step, 99))


def _batch_note(headers: Records) -> str:
    """What batch sampling left, in words: a second of one sensor at a time is nothing to integrate."""
    kinds = [("gyro" if row["type"] else "accelerometer") + f" {int(row['instance'])}" for row in headers.rows]
    counts = ", ".join(f"{kinds.count(kind)} of {kind}" for kind in sorted(set(kinds)))
    rate = float(np.median(headers["smp_rate"]))
    return (
        f"ISBH: batches of {int(np.median(headers['smp_cnt']))} samples at {rate:.0f} Hz ({counts}): they show "
        "vibration (series `gyro_batch`, `accel_batch`), but are too short and apart to be integrated"
    )
