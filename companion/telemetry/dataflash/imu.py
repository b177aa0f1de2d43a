"""The IMUs of an ArduPilot log: IMU (filtered, at the logger's rate), and ACC and GYR (unfiltered, every sample).

Batches of every sample of one sensor for a second or so (ISBH, ISBD) show vibration; there is nothing to integrate.
Sources: ArduPilot `AP_InertialSensor_Logging.cpp`, `AP_InertialSensor_Backend.cpp` (log_gyro_raw), `BatchSampler.cpp`
(type 0 is the accelerometer, 1 the gyro), `mavfft_isb.py`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from companion.logs import Records
from companion.model import Array, ImuTrack, Vehicle, counted, interpolated
from companion.telemetry.dataflash.rows import sources
from companion.telemetry.parameters import known_ranges, with_facts
from companion.telemetry.quantities import RawSeries
from companion.telemetry.samples import imu_track, increasing
from companion.telemetry.timestamps import LONGEST_WAIT_S

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


_KINDS = (("accel_batch", "accelerometer", "mps2"), ("gyro_batch", "gyro", "radps"))
_AXES = "xyz"


def batches(records: Mapping[str, Records], notes: list[str]) -> Iterator[RawSeries]:
    """The samples of each sensor as a series, rad/s or m/s², at the sensor's rate with gaps between the batches."""
    if not {"ISBH", "ISBD"} <= records.keys():
        return
    heads, data = records["ISBH"], records["ISBD"]
    if any(data.layout.kind(axis) != "V" for axis in _AXES):
        notes.append(
            f"ISBD: {counted(len(data), 'record')} left out: the log declares their columns otherwise than ArduPilot"
        )
        return
    head = np.searchsorted(heads.offset, data.offset) - 1
    mine = (head >= 0) & (heads["N"][head] == data["N"])
    if lost := int((~mine).sum()):
        notes.append(f"ISBD: {lost} of {len(data)} left out: the head of their batch is not in the log")
    sensors = np.column_stack([heads["type"], heads["instance"]])
    for kind, instance in np.unique(sensors, axis=0).tolist():
        rows = np.flatnonzero(mine & (sensors[head] == (kind, instance)).all(axis=1))
        if kind < len(_KINDS) and len(rows):
            name, sensor, unit = _KINDS[kind]
            t, values = _samples(heads.select(head[rows]), data.select(rows))
            columns = {f"{axis}_{unit}": values[:, i] for i, axis in enumerate(_AXES)}
            yield RawSeries(name, f"ISBD[{sensor} {instance}]", t, columns, dict.fromkeys(columns, 1.0), instance)


def _samples(heads: Records, data: Records) -> tuple[Array, Array]:
    """Times (N,) s and readings (N, 3) of records, each with the head of its batch."""
    raw = np.stack([data[axis].astype(np.float64) for axis in _AXES], axis=-1)
    count = raw.shape[1]
    place = data["seqno"].astype(np.float64)[:, None] * count + np.arange(count)
    rate, scale = heads["smp_rate"].astype(np.float64), heads["mul"].astype(np.float64)
    rate, scale = np.where(rate > 0, rate, np.nan), np.where(scale > 0, scale, np.nan)
    t = heads["SampleUS"].astype(np.float64)[:, None] * 1e-6 + place / rate[:, None]
    t[place >= heads["smp_cnt"].astype(np.float64)[:, None]] = np.nan  # the last record of a batch is filled up
    return t.ravel(), (raw / scale[:, None, None]).reshape(-1, 3)
