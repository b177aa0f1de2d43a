"""The topics of a PX4 ULog as columns, by pyulog; what is damaged or not of the boot clock is left out and noted.

Format: https://docs.px4.io/main/en/dev_log/ulog_file_format.html. A definition may name another as a field, and that a
third: eight lines stand for 200^8 fields. A message of the log has 65,535 bytes at most, and every field at least one.
"""

from __future__ import annotations

import contextlib
import io
import re
import struct
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.model import Array, InputError
from companion.telemetry.sanitize import words
from companion.telemetry.timestamps import LONGEST_WAIT_S, ON_BOARD, left_out, off_course

_MOST_BYTES = 65_535
_MOST_DEEP = 32
_SIZES = {
    "int8_t": 1, "uint8_t": 1, "bool": 1, "char": 1, "int16_t": 2, "uint16_t": 2, "int32_t": 4, "uint32_t": 4,
    "float": 4, "int64_t": 8, "uint64_t": 8, "double": 8,
}  # fmt: skip
_FIELD = re.compile(r"(\w+)(?:\[(\d{1,9})\])?\s+\w+")


def check_formats(path: Path, contents: bytes) -> None:
    """Raises InputError when a definition is larger than any message can be, or has itself as a part."""
    formats = _formats(contents)
    sizes: dict[str, int] = {}
    for name in formats:
        if _size(name, formats, sizes, 0) > _MOST_BYTES:
            raise InputError(
                f"{path} begins like a PX4 ULog, but declares {name!r} with more bytes than a message can have: its "
                "definitions are damaged. Copy it again."
            )


def _size(name: str, formats: dict[str, str], sizes: dict[str, int], depth: int) -> int:
    """Bytes of a type; more than a message can have for one that is too large, too deep or a part of itself."""
    if name in _SIZES:
        return _SIZES[name]
    if depth > _MOST_DEEP:
        return _MOST_BYTES + 1
    if name not in sizes:
        total = 0
        for kind, count in _FIELD.findall(formats.get(name, "")):
            total += _size(kind, formats, sizes, depth + 1) * int(count or 1)
            if total > _MOST_BYTES:
                break
        sizes[name] = min(total, _MOST_BYTES + 1)
    return sizes[name]


def _formats(contents: bytes) -> dict[str, str]:
    """Name → fields, of the definitions at the head of the file."""
    formats: dict[str, str] = {}
    at = _HEADER_BYTES
    while at + 3 <= len(contents):
        size, kind = int.from_bytes(contents[at : at + 2], "little"), contents[at + 2 : at + 3]
        if kind in (b"A", b"L"):  # the data begins
            break
        if kind == b"F":
            name, _, fields = contents[at + 3 : at + 3 + size].decode("utf-8", "replace").partition(":")
            formats[name] = fields
        at += 3 + size
    return formats


Topic = Mapping[str, Any]
"""Field → column (N,); elements of arrays are fields of their own: `q[0]`."""

Topics = Mapping[str, Topic]
"""Topic by the name that PX4's tools give it: vehicle_imu, vehicle_imu_1, ..."""

_DATED, _SAMPLED = "timestamp", "timestamp_sample"
_XYZ = ("[0]", "[1]", "[2]")
_Q = ("q[0]", "q[1]", "q[2]", "q[3]")
_NEEDED: Mapping[str, tuple[str, ...]] = {
    "vehicle_imu": ("timestamp_sample", "delta_angle_dt", "delta_velocity_dt")
    + tuple(f"delta_{of}{i}" for of in ("angle", "velocity") for i in _XYZ),
    "sensor_combined": ("gyro_integral_dt", *(f"{of}{i}" for of in ("gyro_rad", "accelerometer_m_s2") for i in _XYZ)),
    "vehicle_attitude": _Q,
    "vehicle_angular_velocity": ("xyz[0]", "xyz[1]", "xyz[2]"),
    "vehicle_local_position": (
        "x", "y", "z", "vx", "vy", "vz", "xy_valid", "z_valid", "v_xy_valid", "v_z_valid", "ref_lat", "ref_lon",
        "ref_alt",
    ),
    "home_position": ("lat", "lon", "alt"),
    "vehicle_status": ("arming_state", "nav_state"),
    "vehicle_magnetometer": tuple(f"magnetometer_ga{i}" for i in _XYZ),
    "sensor_mag": ("x", "y", "z"),
    "vehicle_air_data": ("baro_pressure_pa", "baro_alt_meter"),
    "sensor_baro": ("pressure",),
    "vehicle_gps_position": ("fix_type",),
    "sensor_gps": ("fix_type",),
    "estimator_sensor_bias": tuple(f"{of}_bias{i}" for of in ("gyro", "accel") for i in _XYZ),
    "sensor_selection": ("gyro_device_id",),
    "vehicle_attitude_groundtruth": _Q,
    "vehicle_local_position_groundtruth": ("x", "y", "z", "vx", "vy", "vz"),
}  # fmt: skip
"""What is read of a topic without asking whether it is there."""

_HEADER_BYTES = 16
_SYNC = bytes.fromhex("2F731320250CBB12")  # in the log again and again, so that damage does not spread
_INSTANCES = 16  # the most that a flight controller publishes of one topic


def read_ulog(path: Path, contents: bytes) -> Any:
    """pyulog's ULog of these contents.

    Raises InputError when pyulog cannot read the file.
    """
    from pyulog import ULog  # noqa: PLC0415  (needed for these files alone)
    from pyulog.core import ULogException  # noqa: PLC0415

    check_formats(path, contents)
    try:
        with contextlib.redirect_stdout(sys.stderr):  # it prints what it thinks of a file
            log = ULog(_Whole(contents), disable_str_exceptions=True)
    except (ULogException, ValueError, LookupError, TypeError, RecursionError, struct.error) as error:
        raise InputError(f"{path} begins like a PX4 ULog, but cannot be read: {error!r}.") from error
    if not log.data_list:
        raise InputError(
            f"{path} begins like a PX4 ULog, but no data can be read from it: it was cut off, or its definitions are "
            "damaged. Copy it again."
        )
    return log


class _Whole(io.BytesIO):
    """The bytes of a file, for pyulog: after a size that leads beyond their end it goes back by that size.

    It would go round for ever from there, so what could not be read is not gone back either.
    """

    _missing = 0

    def read(self, size: int | None = -1) -> bytes:
        data = super().read(size)
        self._missing = max((size or 0) - len(data), 0)
        return data

    def seek(self, offset: int, whence: int = 0) -> int:
        if whence == io.SEEK_CUR and offset < 0:
            offset += self._missing
        self._missing = 0
        return super().seek(offset, whence)


def topics_of(log: Any) -> tuple[dict[str, Topic], list[str]]:
    """The topics by name, without those whose declaration lacks what is read of them; and a note of each of these.

    Rows whose time is not of the clock of the others (UNIX time, damage) are left out: see `timestamps`.
    """
    topics: dict[str, Topic] = {}
    notes = []
    for one in log.data_list:
        name = _name(one.name, one.multi_id)
        lacks = [field for field in (_DATED, *_NEEDED.get(one.name, ())) if field not in one.data]
        if not name.isidentifier():
            notes.append(f"a topic is left out: its name is damaged ({words(name)})")
            continue
        if lacks:
            notes.append(f"{name} is left out: the log declares it without {', '.join(lacks)}")
            continue
        topics[name] = one.data
    times = {name: seconds(topic) for name, topic in topics.items()}
    apart = off_course(times, ON_BOARD)
    for name, mask in apart.items():
        topics[name] = {field: values[~mask] for field, values in topics[name].items()}
    topics = {name: topic for name, topic in topics.items() if len(topic[_DATED])}
    return topics, [*notes, *left_out(times, apart), *_published(topics)]


def unfinished(contents: bytes, *, appended: bool) -> int:
    """Bytes of a message at the end that is not all there. appended: data of a crash follows, which has another end."""
    at = contents.rfind(_SYNC) + len(_SYNC) if _SYNC in contents else _HEADER_BYTES
    while at + 3 <= len(contents) and not appended:
        size = 3 + int.from_bytes(contents[at : at + 2], "little")
        if at + size > len(contents):
            break
        at += size
    return 0 if appended else len(contents) - at


def _name(topic: str, instance: int) -> str:
    return f"{topic}_{instance}" if instance else topic


def instances(topics: Topics, topic: str) -> Iterator[tuple[int, str, Topic]]:
    """(instance, name, columns) of each instance of a topic that is in the log."""
    for instance in range(_INSTANCES):
        name = _name(topic, instance)
        if name in topics:
            yield instance, name, topics[name]


def seconds(topic: Topic, field: str = _DATED) -> Array:
    """A time field, µs of the boot clock, in s."""
    return np.asarray(topic[field], np.float64) * 1e-6


def sampled(topic: Topic) -> Array:
    """When it was measured; where that is not told (before PX4 1.11 often, or zero), when it was published."""
    t = seconds(topic)
    if _SAMPLED not in topic:
        return t
    measured = seconds(topic, _SAMPLED)
    return np.where(np.abs(measured - t) < LONGEST_WAIT_S, measured, t)


def _published(topics: Topics) -> Iterator[str]:
    """A note for each topic of which some samples are taken at the time of their publication: see `sampled`.

    Where most times are so far off, as in estimator_event_flags, the field means another thing.
    """
    for name, topic in topics.items():
        if _SAMPLED in topic:
            measured = seconds(topic, _SAMPLED)
            off = (measured > 0) & (np.abs(measured - seconds(topic)) >= LONGEST_WAIT_S)
            if 0 < off.sum() <= len(off) / 2:
                yield (
                    f"{name}: {int(off.sum())} of {len(off)} taken at the time of their publication: that of the "
                    f"sample is {LONGEST_WAIT_S:g} s and more off it"
                )


def columns(topic: Topic, *fields: str) -> Array:
    """Fields side by side, (N, len(fields)), NaN for a field that is not there or not finite."""
    values = np.full((len(topic[_DATED]), len(fields)), np.nan)
    with np.errstate(invalid="ignore"):  # damage makes NaNs that signal
        for i, field in enumerate(fields):
            if field in topic:
                values[:, i] = topic[field]
    values[~np.isfinite(values)] = np.nan
    return values


def column(topic: Topic, field: str) -> Array:
    """One field, (N,), NaN where it is not there or not finite."""
    return np.asarray(columns(topic, field)[:, 0])


def xyz(topic: Topic, field: str) -> Array:
    """The three elements of a vector field, (N, 3)."""
    return columns(topic, *(f"{field}[{i}]" for i in range(3)))


def finite(*arrays: Array) -> npt.NDArray[np.bool_]:
    """Rows (N,) in which every one of the arrays (N, k) is finite."""
    return np.asarray(np.isfinite(np.hstack(arrays)).all(axis=1))


def flag(topic: Topic, field: str) -> npt.NDArray[np.bool_]:
    """A field of truth values, (N,); true where the topic has none."""
    values = topic.get(field)
    return np.ones(len(topic[_DATED]), np.bool_) if values is None else np.asarray(values, np.bool_)


def device_ids(topic: Topic, field: str) -> npt.NDArray[np.int64]:
    """Ids of the sensor behind each row, (N,); 0 where they are not told."""
    ids = topic.get(field)
    return np.zeros(len(topic[_DATED]), np.int64) if ids is None else np.asarray(ids).astype(np.int64)
