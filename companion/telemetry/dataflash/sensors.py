"""An ArduPilot log's records → its IMUs, and the series of its sensors and estimators by the rows of `sources`.

IMUs: IMU (filtered, at the logger's rate), and ACC and GYR (unfiltered, every sample). Batches of every sample of one
sensor for a second or so (ISBH, ISBD) show vibration; there is nothing to integrate. And what all records share:
several sensors of a kind, the time of a sample, and whether it is sound.
Sources: ArduPilot `AP_Logger/LogStructure.h`, and its tags before 4.0 for the names of old; `BatchSampler.cpp` (type 0
is the accelerometer, 1 the gyro), `mavfft_isb.py`; `AP_InertialSensor_Logging.cpp`, `AP_InertialSensor_Backend.cpp`
(log_gyro_raw).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from companion.logs import Records
from companion.model import Array, ImuTrack, Series, Vehicle, counted, interpolated
from companion.telemetry.clock import LONGEST_WAIT_S, ON_BOARD, left_out, off_course
from companion.telemetry.dataflash.cores import Ekf
from companion.telemetry.parameters import known_ranges, with_facts
from companion.telemetry.samples import BoolArray, imu_track, increasing
from companion.telemetry.sources import (
    GPS_ACCURACY,
    RECORD_SOURCES,
    Fields,
    Raw,
    RawSeries,
    Source,
    raw_series,
    series_of,
)

_FIX_3D = 3
_HAPPENINGS = ("PARM", "EV", "ERR", "MODE", "MSG")  # hold from then on: whatever the time, it counts


def sources(records: Mapping[str, Records], names: tuple[str, ...]) -> Iterator[tuple[int, str, Records]]:
    """Instance, what viewers call it ("GPS[1]"), and its records: by an instance column, in older logs by the name."""
    for number, name in enumerate(names):
        if name in records:
            for instance in records[name].instances or (number,):
                yield int(instance), f"{names[0]}[{instance}]", records[name].instance(instance)


def _sample_time(one: Records, field: str) -> Array:
    """(N,) s: when each sample was taken, by a column of whole ms or µs; where that is absurd, when it was logged.

    Both count in a uint32 that wraps.
    """
    if not one.layout.has_numbers(field):
        return one.t
    unit = 1e-6 if field == "S" else 1e-3
    wrap = 2.0**32 * unit
    age = np.mod(one.t - one[field].astype(np.float64) * unit, wrap)
    age = np.where(age > wrap / 2, age - wrap, age)
    return np.where((np.abs(age) < LONGEST_WAIT_S) & (one[field] != 0), one.t - age, one.t)


def _sound(one: Records) -> BoolArray:
    """(N,) whether the driver vouches for a sample; older logs do not say."""
    flag = next((name for name in ("Health", "H") if one.layout.has_numbers(name)), None)
    return np.ones(len(one), np.bool_) if flag is None else np.asarray(one[flag] != 0)


def with_times(records: Mapping[str, Records]) -> tuple[dict[str, Records], list[str]]:
    """The same, each with its times, without those that leave the flight's course; and notes on these.

    Before 2015 PARM, EV, ERR, MODE and MSG have no time, and get that of their neighbours; until ArduCopter 3.1 no
    record has one, and the GPS's own is taken. Nothing is left where it has none either.
    """
    if not any(one.layout.clock for one in records.values()):
        return _by_gps(records)
    times = {name: one.t for name, one in records.items() if one.layout.clock}
    apart = off_course(times, ON_BOARD)
    notes = left_out(times, apart)
    timed = {
        name: replace(records[name], sender_s=t) if name not in apart else records[name].select(~apart[name])
        for name, t in times.items()
    }
    timed = {name: one for name, one in timed.items() if len(one)}
    if not timed:
        return {}, notes
    clock = max(timed.values(), key=len)
    timed |= {
        name: replace(one, sender_s=np.interp(one.offset, clock.offset, clock.t))
        for name, one in records.items()
        if not one.layout.clock and one.rows.dtype.names
    }
    return {name: timed[name] for name in records if name in timed}, notes


def _by_gps(records: Mapping[str, Records]) -> tuple[dict[str, Records], list[str]]:
    """Records on the clock of the GPS from its first fix on, and a note: samples between the first fix and the last."""
    gps = records.get("GPS")
    if gps is None or not gps.layout.has_numbers("Time", "Status"):
        return {}, []
    t, fixed = gps["Time"] * 1e-3, gps["Status"] >= _FIX_3D
    gps = gps.select(fixed & (t >= np.maximum.accumulate(np.where(fixed, t, -np.inf))))
    if len(gps) < 2:
        return {}, []
    since = (gps["Time"] - gps["Time"][0]) * 1e-3

    def timed(one: Records) -> Records:
        inside = (one.offset >= gps.offset[0]) & (one.offset <= gps.offset[-1])
        one = one.select(inside | (one.name in _HAPPENINGS))
        return replace(one, sender_s=np.interp(one.offset, gps.offset, since))

    within = {name: timed(one) for name, one in records.items() if one.rows.dtype.names}
    return within, ["no record has a time (ArduCopter 3.1 and older): that is the GPS's, in s since its first fix"]


_BLENDED = 2  # instance of GPS: the mean of the receivers, made by ArduPilot
_ACCURACY = {field for ways in GPS_ACCURACY.values() for field, _ in ways}
_OF_CORES = frozenset({"estimator", "innovation"})

NEEDED = frozenset(name for row in RECORD_SOURCES for name in row.names) | {
    "GPA", "GPA2", "ISBH", "ISBD", "XKF8", "XKF9", "NKF8", "NKF9",
}  # fmt: skip
"""Records that become series."""


def record_sensors(ekf: Ekf, core: int, notes: list[str]) -> Mapping[str, Series]:
    """The series of an ArduPilot log; of the cores of the EKF that flew that one first."""
    parts: list[RawSeries | None] = []
    for row in RECORD_SOURCES:
        parts += _of_ekf(ekf, row, core) if row.kind in _OF_CORES else _of_sensors(ekf.records, row, notes)
    return series_of([*parts, *_batches(ekf.records, notes)])


def _of_ekf(ekf: Ekf, row: Source, core: int) -> Iterator[RawSeries | None]:
    for name in (name for name in row.names if name.startswith(ekf.prefix)):
        cores = ekf.of_cores(name.removeprefix(ekf.prefix))
        for number in sorted(cores, key=lambda number: (number != core, number)):
            yield _raw_series(cores[number], f"{name}[{number}]", row, number, [])


def _of_sensors(records: Mapping[str, Records], row: Source, notes: list[str]) -> Iterator[RawSeries | None]:
    for number, name, one in sources(records, row.names):
        if row.kind == "gps":
            if number < _BLENDED:
                yield _gps(records, one, name, row, number, notes)
            continue
        whole = one
        if row.sampled and not (good := _sound(one)).all():
            whole = one.select(good)
            notes.append(
                f"{name}: {len(one) - len(whole)} of {len(one)} left out, as the driver called itself unhealthy"
            )
        yield _raw_series(whole, name, row, number, notes)


def _raw_series(one: Records, name: str, row: Source, number: int, notes: list[str]) -> RawSeries | None:
    if "Clip" in one.layout.fields:  # counts for this IMU alone; older logs have Clip0, Clip1 and Clip2
        row = replace(row, fields=row.fields | {f"clips_{number}": (("Clip", ""),)})
    if row.name == "CURR" and one.layout.has_numbers("Volt") and one["Volt"].dtype.kind == "i":  # until ArduPilot 3.2
        hundredths: Fields = {column: ((field, "hundredths"),) for column, ((field, _),) in row.fields.items()}
        row = replace(row, fields=hundredths)
    t = _sample_time(one, row.sampled) if row.sampled else one.t
    return raw_series(row, name, t, lambda field: _column(one, field), one.layout.units, instance=number, notes=notes)


def _column(one: Records, field: str) -> Raw | None:
    if not one.layout.has_numbers(field):  # where damage made a text of it too
        return None
    if field in one.layout.multipliers:
        return one.in_unit(field)
    values = one[field]
    return values.astype(np.float64) if values.dtype.kind == "f" else values


def _gps(
    records: Mapping[str, Records], one: Records, name: str, row: Source, number: int, notes: list[str]
) -> RawSeries | None:
    """A receiver with what GPA says of the same fix. The time is that of its sample, which GPA has as well."""
    t = one.t
    accuracy = next((own for instance, _, own in sources(records, ("GPA", "GPA2")) if instance == number), None)
    if accuracy is None or not len(accuracy):
        return _raw_series(one, name, row, number, notes)
    beside = np.minimum(np.searchsorted(accuracy.t, t), len(accuracy) - 1)
    paired = accuracy.t[beside] == t  # they are written together, at the same microsecond

    def column(field: str) -> Raw | None:
        values = _column(accuracy if field in _ACCURACY else one, field)
        if values is not None and field in _ACCURACY:
            return np.where(paired, values[beside], np.nan)
        if values is not None and field == "VZ" and accuracy.layout.has_numbers("VV"):
            return np.where(paired & (accuracy["VV"][beside] == 0), np.nan, values)  # the receiver gives no climb
        return values

    sampled: Array = np.where(paired, _sample_time(accuracy, "SMS")[beside], t)
    units = {**one.layout.units, **accuracy.layout.units}
    return raw_series(row, name, sampled, column, units, instance=number, notes=notes)


_KINDS = (("accel_batch", "accelerometer", "mps2"), ("gyro_batch", "gyro", "radps"))
_AXES = "xyz"


def _batches(records: Mapping[str, Records], notes: list[str]) -> Iterator[RawSeries]:
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
            columns = {f"{axis}_{unit}": (values[:, i], 1.0) for i, axis in enumerate(_AXES)}
            yield RawSeries(name, f"ISBD[{sensor} {instance}]", t, columns, instance)


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


_VECTORS = tuple(f"{kind}{axis}" for kind in ("Gyr", "Acc") for axis in "XYZ")
_IMU = ("IMU", "IMU2", "IMU3")
_RAW = {"Gyr": ("GYR", "GYR1", "GYR2", "GYR3"), "Acc": ("ACC", "ACC1", "ACC2", "ACC3")}
"""Before 2020 each IMU has a record type of its own, counted from 1."""

IMU_NUMBERS: Mapping[str, tuple[str, ...]] = {
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
