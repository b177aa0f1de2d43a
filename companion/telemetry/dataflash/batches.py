"""Batches of every sample of one sensor for a second or so (ISBH, ISBD): they show vibration; nothing to integrate.

Sources: ArduPilot `AP_InertialSensor/BatchSampler.cpp` (type 0 is the accelerometer, 1 the gyro), `mavfft_isb.py`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from companion.logs import Records
from companion.model import Array
from companion.telemetry.quantities import RawSeries, raw_series

NUMBERS: Mapping[str, tuple[str, ...]] = {
    "ISBH": ("N", "type", "instance", "mul", "smp_cnt", "SampleUS", "smp_rate"),
    "ISBD": ("N", "seqno"),
}
"""Columns that these records must have."""

_KINDS = (("accel_batch", "accelerometer", "mps2"), ("gyro_batch", "gyro", "radps"))
_AXES = "xyz"


def batches(records: Mapping[str, Records], notes: list[str]) -> Iterator[RawSeries | None]:
    """The samples of each sensor as a series, rad/s or m/s², at the sensor's rate with holes between the batches."""
    if not {"ISBH", "ISBD"} <= records.keys():
        return
    heads, data = records["ISBH"], records["ISBD"]
    if any(data.layout.kind(axis) != "V" for axis in _AXES):
        notes.append(f"ISBD: {len(data)} records left out: the log declares their columns otherwise than ArduPilot")
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
            fields = {f"{axis}_{unit}": (axis, "") for axis in _AXES}
            column = {axis: values[:, i] for i, axis in enumerate(_AXES)}.get
            yield raw_series(name, f"ISBD[{sensor} {instance}]", t, fields, column, instance=instance)


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
