"""PX4's ULog → its flight, through pyulog (the extra `ulog`).

`vehicle_imu` is the calibrated sensor, coning-corrected and averaged over its interval, without the EKF's biases: the
independent witness. `sensor_combined` is the IMU that the EKF uses. Sources: PX4 `msg/VehicleImu.msg`,
`msg/SensorCombined.msg`, `msg/VehicleLocalPosition.msg`, https://docs.px4.io/main/en/dev_log/ulog_file_format.html.
"""

from __future__ import annotations

import contextlib
import io
import struct
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from companion.errors import InputError
from companion.mavlink import px4_nav_state_name
from companion.series import Event
from companion.telemetry.arrival import arrival
from companion.telemetry.convert import continuous, increasing
from companion.telemetry.epoch import epoch_of
from companion.telemetry.events import changes, in_order
from companion.telemetry.sensors import topic_sensors
from companion.telemetry.words import words
from companion.tracks import Array, AttitudeTrack, Epoch, Flight, ImuTrack, Origin, PositionTrack, StatusText, Vehicle

Topic = Mapping[str, Any]  # field -> column

_ARMED = 2  # vehicle_status.arming_state
_DATED = "timestamp"
_XYZ = ("[0]", "[1]", "[2]")
_NEEDED: Mapping[str, tuple[str, ...]] = {
    "vehicle_imu": ("timestamp_sample", "delta_angle_dt", "delta_velocity_dt")
    + tuple(f"delta_{of}{i}" for of in ("angle", "velocity") for i in _XYZ),
    "sensor_combined": ("gyro_integral_dt", *(f"{of}{i}" for of in ("gyro_rad", "accelerometer_m_s2") for i in _XYZ)),
    "vehicle_attitude": ("q[0]", "q[1]", "q[2]", "q[3]"),
    "vehicle_angular_velocity": ("xyz[0]", "xyz[1]", "xyz[2]"),
    "vehicle_local_position": (
        "x", "y", "z", "vx", "vy", "vz", "xy_valid", "z_valid", "v_xy_valid", "v_z_valid", "ref_lat", "ref_lon",
        "ref_alt",
    ),
    "home_position": ("lat", "lon", "alt"),
    "vehicle_status": ("arming_state", "nav_state"),
}  # fmt: skip
"""What is read of a topic without asking whether it is there."""

_HEADER_BYTES = 16
_SYNC = bytes.fromhex("2F731320250CBB12")  # in the log again and again, so that damage does not spread


def ulog_flight(path: Path, contents: bytes, vehicle_types: Mapping[int, str]) -> Flight:
    """The one flight of a .ulg of these contents; vehicle_types names the values of MAV_TYPE.

    Raises InputError when pyulog is not installed or cannot read the file.
    """
    try:
        from pyulog import ULog  # noqa: PLC0415  (an extra: needed for these files alone)
        from pyulog.core import ULogException  # noqa: PLC0415
    except ImportError:
        raise InputError(
            f"{path} is a PX4 ULog, and reading it needs pyulog. Install it: pip install 'companion[ulog]'"
        ) from None
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
    topics, notes = _topics(log.data_list)
    said = [*log.initial_parameters.items(), *((name, value) for _, name, value in log.changed_parameters)]
    parameters = {words(str(name)): float(value) for name, value in said if isinstance(value, int | float)}
    if left_out := sum(not isinstance(value, int | float) for _, value in said):
        notes.append(f"{left_out} parameters left out: their types are damaged")
    begin, end = log.start_timestamp * 1e-6, log.last_timestamp * 1e-6
    if log.dropouts:
        notes.append(f"{len(log.dropouts)} dropouts of the logger, the longest {_longest(log.dropouts):.2f} s")
    if log.file_corruption:
        notes.append("the file is damaged: what could be read of it is used")
    if cut := _unfinished(contents, appended=bool(log.has_data_appended)):
        notes.append(f"the file ends in the middle of a message ({cut} bytes of one): it was cut off")
    return Flight(
        vehicle=Vehicle(
            int(parameters.get("MAV_SYS_ID", 1)),
            int(parameters.get("MAV_COMP_ID", 1)),
            autopilot="PX4",
            type=vehicle_types.get(int(parameters.get("MAV_TYPE", -1)), "UNKNOWN"),
            firmware=_firmware(log.msg_info_dict.get("ver_sw_release")),
        ),
        boot=1,
        start=begin,
        duration=end - begin,
        imus=_imus(topics),
        attitude=_attitude(topics),
        position=_position(topics),
        origin=_origin(topics),
        epoch=_epoch(topics),
        home=_home(topics),
        series=topic_sensors(topics),
        events=_events(topics),
        parameters=parameters,
        texts=tuple(
            StatusText(m.timestamp * 1e-6, m.log_level - ord("0"), words(str(m.message))) for m in log.logged_messages
        ),
        messages={name: arrival(_seconds(topic, "timestamp"), 0) for name, topic in sorted(topics.items())},
        notes=tuple(notes),
        on_board=True,
    )


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


def _topics(found: list[Any]) -> tuple[dict[str, Topic], list[str]]:
    """The topics by name, without those whose declaration lacks what is read of them; and a note of each of these."""
    topics: dict[str, Topic] = {}
    notes = []
    for one in found:
        name = _name(one.name, one.multi_id)
        lacks = [field for field in (_DATED, *_NEEDED.get(one.name, ())) if field not in one.data]
        if not name.isidentifier():
            notes.append(f"a topic is left out: its name is damaged ({words(name)})")
        elif lacks:
            notes.append(f"{name} is left out: the log declares it without {', '.join(lacks)}")
        else:
            topics[name] = one.data
    return topics, notes


def _unfinished(contents: bytes, *, appended: bool) -> int:
    """Bytes of a message at the end that is not all there. appended: data of a crash follows, which has another end."""
    at = contents.rfind(_SYNC) + len(_SYNC) if _SYNC in contents else _HEADER_BYTES
    while at + 3 <= len(contents) and not appended:
        size = 3 + int.from_bytes(contents[at : at + 2], "little")
        if at + size > len(contents):
            break
        at += size
    return 0 if appended else len(contents) - at


def _name(topic: str, instance: int) -> str:
    """As PX4's tools write it: vehicle_imu, vehicle_imu_1, ..."""
    return f"{topic}_{instance}" if instance else topic


def _longest(dropouts: list[Any]) -> float:
    return float(max(d.duration for d in dropouts)) * 1e-3


def _firmware(release: object) -> str:
    """ver_sw_release is major, minor, patch, type, one byte each."""
    if not isinstance(release, int):  # where damage met its type
        return ""
    return f"{release >> 24}.{release >> 16 & 255}.{release >> 8 & 255}" if release else ""


def _seconds(topic: Topic, field: str) -> Array:
    return np.asarray(topic[field], np.float64) * 1e-6


def _sampled(topic: Topic) -> Array:
    """When it was measured; before PX4 1.11 some topics know only when they were published."""
    return _seconds(topic, "timestamp_sample" if "timestamp_sample" in topic else _DATED)


def _columns(topic: Topic, *fields: str) -> Array:
    with np.errstate(invalid="ignore"):  # damage makes NaNs that signal
        return np.column_stack([np.asarray(topic[f], np.float64) for f in fields])


def _xyz(topic: Topic, field: str) -> Array:
    return _columns(topic, *(f"{field}[{i}]" for i in range(3)))


def _imus(topics: Mapping[str, Topic]) -> dict[str, ImuTrack]:
    """Every instance of vehicle_imu, and sensor_combined. A mean over an interval stands at its middle."""
    found: dict[str, ImuTrack] = {}
    for instance in range(4):
        name = _name("vehicle_imu", instance)
        if name not in topics:
            continue
        topic = topics[name]
        gyro_dt, accel_dt = (np.asarray(topic[f"{d}_dt"], np.float64) * 1e-6 for d in ("delta_angle", "delta_velocity"))
        whole = (gyro_dt > 0) & (accel_dt > 0)
        gyro = _xyz(topic, "delta_angle") / np.where(whole, gyro_dt, 1.0)[:, None]
        accel = _xyz(topic, "delta_velocity") / np.where(whole, accel_dt, 1.0)[:, None]
        found[name] = _imu(name, instance, _seconds(topic, "timestamp_sample") - gyro_dt / 2, gyro, accel, whole)
    if "sensor_combined" in topics:
        topic = topics["sensor_combined"]
        t = _seconds(topic, "timestamp") - _seconds(topic, "gyro_integral_dt") / 2
        gyro, accel = _xyz(topic, "gyro_rad"), _xyz(topic, "accelerometer_m_s2")
        found["sensor_combined"] = _imu("sensor_combined", 0, t, gyro, accel, np.ones(len(t), np.bool_))
    return {name: track for name, track in found.items() if len(track)}


def _imu(name: str, instance: int, t: Array, gyro: Array, accel: Array, good: Any) -> ImuTrack:
    finite = np.isfinite(gyro).all(axis=1) & np.isfinite(accel).all(axis=1)
    keep = increasing(t, good & finite)
    return ImuTrack(t[keep], gyro[keep], accel[keep], source=name, instance=instance)


def _attitude(topics: Mapping[str, Topic]) -> AttitudeTrack | None:
    """vehicle_attitude, with the bias-corrected rates of vehicle_angular_velocity."""
    if "vehicle_attitude" not in topics:
        return None
    topic = topics["vehicle_attitude"]
    t = _sampled(topic)
    q = _columns(topic, *(f"q[{i}]" for i in range(4)))
    keep = increasing(t, np.isfinite(q).all(axis=1) & (np.abs(np.linalg.norm(q, axis=1) - 1.0) < 0.1))
    t = t[keep]
    if len(t) < 2:
        return None
    rates = np.zeros((len(t), 3))
    if "vehicle_angular_velocity" in topics:
        body = topics["vehicle_angular_velocity"]
        turned = _xyz(body, "xyz")
        rates = np.column_stack([np.interp(t, _sampled(body), c) for c in turned.T])
    return AttitudeTrack(t, continuous(q[keep]), np.nan_to_num(rates), "vehicle_attitude")


def _origin(topics: Mapping[str, Topic]) -> Origin | None:
    """The reference point of vehicle_local_position, where it says that it is global."""
    topic = topics.get("vehicle_local_position", {})
    known = np.flatnonzero(np.asarray(topic.get("xy_global", ())))
    if not len(known):
        return None
    latitude, longitude, height = (float(topic[name][known[0]]) for name in ("ref_lat", "ref_lon", "ref_alt"))
    return Origin(float(np.radians(latitude)), float(np.radians(longitude)), height)


def _epoch(topics: Mapping[str, Topic]) -> Epoch | None:
    """By the receiver's UTC; zero where it does not know it yet."""
    for name in ("vehicle_gps_position", "sensor_gps"):
        if name in topics and "time_utc_usec" in topics[name]:
            return epoch_of(_seconds(topics[name], "time_utc_usec"), _seconds(topics[name], "timestamp"), "GPS")
    return None


def _home(topics: Mapping[str, Topic]) -> Origin | None:
    """The last home_position that calls itself valid."""
    topic = topics.get("home_position", {})
    known = np.flatnonzero(np.asarray(topic.get("valid_hpos", ())))
    if not len(known):
        return None
    latitude, longitude, height = (float(topic[name][known[-1]]) for name in ("lat", "lon", "alt"))
    return Origin(float(np.radians(latitude)), float(np.radians(longitude)), height)


def _events(topics: Mapping[str, Topic]) -> tuple[Event, ...]:
    """Arming, modes and failsafes of vehicle_status."""
    if "vehicle_status" not in topics:
        return ()
    topic = topics["vehicle_status"]
    t = _seconds(topic, "timestamp")
    found = list(changes(t, np.asarray(topic["arming_state"]) == _ARMED, topic["nav_state"], px4_nav_state_name))
    failsafe = np.asarray(topic.get("failsafe", np.zeros(len(t))), np.bool_)
    turns = (np.flatnonzero(np.diff(failsafe)) + 1).tolist()
    found += [
        Event(float(t[i]), *(("error", "failsafe") if failsafe[i] else ("event", "failsafe over"))) for i in turns
    ]
    return in_order(found)


def _position(topics: Mapping[str, Topic]) -> PositionTrack | None:
    """vehicle_local_position where it calls itself valid."""
    if "vehicle_local_position" not in topics:
        return None
    topic = topics["vehicle_local_position"]
    t = _sampled(topic)
    position, velocity = _columns(topic, "x", "y", "z"), _columns(topic, "vx", "vy", "vz")
    valid = np.asarray(np.isfinite(np.column_stack([position, velocity])).all(axis=1))
    for flag in ("xy_valid", "z_valid", "v_xy_valid", "v_z_valid"):
        valid &= np.asarray(topic[flag], np.bool_)
    keep = increasing(t, valid)
    track = PositionTrack(t[keep], position[keep], velocity[keep], "vehicle_local_position")
    return track if len(track) > 1 else None
