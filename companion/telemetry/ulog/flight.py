"""PX4's ULog → its flight, and what EKF2 believes of its IMU: which it uses, jumps announced, which instance flew.

The topics are read by `topics`; `imu` and `pose` make tracks of them.
Source: PX4 `src/modules/ekf2/EKF2Selector.cpp`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import partial

import numpy as np

from companion.logs import Ulog, UlogTopic
from companion.mavlink import Index, px4_nav_state_name
from companion.model import (
    Array,
    BiasTrack,
    EstimatorReset,
    Event,
    Flight,
    ParameterChange,
    ResetKind,
    SensorInUse,
    StatusText,
    Vehicle,
    counted,
)
from companion.telemetry.aiding import aiding_tracks
from companion.telemetry.events import changes, in_order, lane_changes, turns
from companion.telemetry.flights import arrival
from companion.telemetry.parameters import UNKNOWN, identity, possible, px4_vehicle, release, setting_names, words
from companion.telemetry.samples import bias_track, commonest, finite_rows, in_use
from companion.telemetry.sources import DRIVER_SOURCES, TOPIC_SOURCES, Lazy, series_of
from companion.telemetry.ulog import pose
from companion.telemetry.ulog.imu import calibrations, imu_tracks
from companion.telemetry.ulog.topics import (
    NEEDED,
    SELECTED_KINDS,
    Topic,
    Topics,
    aiding_series,
    instance_names,
    instances,
    let_go,
    sampled,
    topic_series,
    topics_of,
)

_Version = tuple[int, int]
"""Major and minor of PX4's release; (0, 0) where the log does not tell it."""

_GYRO, _ACCEL = 10, 13  # in EKF2's state vector: after attitude (4), velocity (3) and position (3)
_ERROR_STATE = (1, 15)
_GYROS = (("vehicle_imu", "gyro_device_id"), ("vehicle_imu_status", "gyro_device_id"), ("sensor_gyro", "device_id"))
_SELECTOR, _INVALID_INSTANCE = "estimator_selector_status", 255
_RATES = (1, 15)  # since then the states are rates; before, delta angles and velocities over one filter interval


def _imu_instances(topics: Topics) -> dict[int, int]:
    """Device id of a gyro → its instance, as vehicle_imu numbers them."""
    by_device: dict[int, int] = {}
    for name, field in _GYROS:
        for instance, _, topic in instances(topics, name):
            for device in np.unique(topic.ids(field)).tolist():
                if device:
                    by_device.setdefault(device, instance)
    return by_device


def _imu_in_use(topics: Topics, by_device: Mapping[int, int]) -> SensorInUse | None:
    """The gyro that sensor_selection names, or where it is not there estimator_selector_status; None without both."""
    for name in ("sensor_selection", _SELECTOR):
        if (topic := topics.get(name)) is None:
            continue
        t, devices = topic.seconds(), topic.ids("gyro_device_id")
        instance = np.array([by_device.get(device, -1) for device in devices.tolist()], np.int64)
        if (used := in_use(name, t, instance, instance >= 0)) is not None:
            return used
    return None


def _bias_tracks(topics: Topics, version: _Version, by_device: Mapping[int, int]) -> tuple[BiasTrack, ...]:
    """The in-run biases of each EKF2 instance, that of the one that flew longest first.

    From estimator_sensor_bias, which names the sensor; where that is not there from the state vector.
    """
    tracks = [
        track
        for core, name, topic in instances(topics, "estimator_sensor_bias")
        for track in _named_biases(topic, name, core, by_device)
    ]
    for states in ("estimator_states", "estimator_status"):
        if not tracks:
            tracks = [
                _state_biases(topic, name, core, version, by_device)
                for core, name, topic in instances(topics, states)
                if f"states[{_ACCEL + 2}]" in topic
            ]
    first = commonest(_primary(topics)[1])
    tracks = [track for track in tracks if len(track)]
    return tuple(sorted(tracks, key=lambda track: (track.core != first, track.core)))


def _primary(topics: Topics) -> tuple[Array, Index]:
    """Times (N,) s and which instance of EKF2 the selector lets fly, (N,); none where the log does not tell."""
    topic = topics.get(_SELECTOR)
    if topic is None or "primary_instance" not in topic:
        return np.empty(0), np.empty(0, np.int64)
    return topic.seconds(), np.asarray(topic["primary_instance"]).astype(np.int64)


def _lane_in_use(topics: Topics) -> SensorInUse | None:
    """The instance that flew, from each change on; None where the log has no selector."""
    t, instance = _primary(topics)
    return in_use(_SELECTOR, t, instance, instance < _INVALID_INSTANCE)


def _named_biases(topic: Topic, name: str, core: int, by_device: Mapping[int, int]) -> list[BiasTrack]:
    """One track for each gyro that the instance has used."""
    t = sampled(topic)
    gyros, accels = topic.ids("gyro_device_id"), topic.ids("accel_device_id")
    gyro, accel = topic.array("gyro_bias"), topic.array("accel_bias")
    gyro_sigma, accel_sigma = _sigma(topic.array("gyro_bias_variance")), _sigma(topic.array("accel_bias_variance"))
    no_gyro = (gyros == 0) | ~topic.flag("gyro_bias_valid")
    no_accel = (accels == 0) | ~topic.flag("accel_bias_valid")
    gyro[no_gyro], gyro_sigma[no_gyro] = np.nan, np.nan
    accel[no_accel], accel_sigma[no_accel] = np.nan, np.nan
    known = np.isfinite(gyro).all(axis=1) | np.isfinite(accel).all(axis=1)
    devices = np.where(gyros != 0, gyros, accels)
    columns = gyro, accel, gyro_sigma, accel_sigma
    return [
        bias_track(name, t, columns, known & (devices == device), core, by_device.get(device))
        for device in dict.fromkeys(devices[known].tolist())
    ]


def _state_biases(topic: Topic, name: str, core: int, version: _Version, by_device: Mapping[int, int]) -> BiasTrack:
    """From the state vector; the IMU is known where the vehicle has one."""
    t, dt = sampled(topic), _filter_interval(version)
    gyro, accel = (topic.array("states", range(at, at + 3)) / dt for at in (_GYRO, _ACCEL))
    less = 4 - _attitude_elements(version)
    sigmas = (_sigma(topic.array("covariances", range(at - less, at - less + 3))) / dt for at in (_GYRO, _ACCEL))
    only = next(iter(by_device.values())) if len(by_device) == 1 else (None if by_device else 0)
    return bias_track(name, t, (gyro, accel, *sigmas), finite_rows(gyro, accel), core, only)


def _attitude_elements(version: _Version) -> int:
    """Of EKF2's covariance: the quaternion's, or since PX4 1.15 those of the attitude's error."""
    return 3 if version >= _ERROR_STATE else 4


def _filter_interval(version: _Version) -> float:
    """s by which the biases in EKF2's state vector are to be divided.

    It held a delta angle and a delta velocity over FILTER_UPDATE_PERIOD_MS (ecl `EKF/estimator_interface.h`): 12 ms in
    PX4 1.6, 8 ms from 1.7 to 1.10, 10 ms from 1.11 to 1.14. Since 1.15 it holds rates.
    """
    if version >= _RATES:
        return 1.0
    return 0.012 if version < (1, 7) else 0.008 if version < (1, 11) else 0.010


def _sigma(variance: Array) -> Array:
    """1σ; NaN where no variance is logged."""
    return np.sqrt(np.where(variance > 0.0, variance, np.nan))


_COUNTERS: tuple[tuple[str, str, ResetKind, tuple[str, ...], str], ...] = (
    ("vehicle_local_position", "xy_reset_counter", "position", ("delta_xy[0]", "delta_xy[1]"), "m"),
    ("vehicle_local_position", "z_reset_counter", "height", ("delta_z",), "m"),
    ("vehicle_local_position", "vxy_reset_counter", "velocity", ("delta_vxy[0]", "delta_vxy[1]"), "m/s"),
    ("vehicle_local_position", "vz_reset_counter", "velocity", ("delta_vz",), "m/s down"),
)
"""Topic, its counter, what it counts, the jump and its unit. Of the attitude: `_attitude_resets`."""

_WRAPS = 256  # the counters are uint8
_LEVEL = 0.1  # a jump whose tilt is a smaller share of it than this is one of the heading


def _estimator_resets(topics: Topics) -> tuple[EstimatorReset, ...]:
    """All of the instance that flies, in order of time: each at the first row that counts it."""
    switches = lane_changes(*_primary(topics), "EKF2 instance {before} → {core}")
    resets = [*_attitude_resets(topics), *switches]
    for name, counter, kind, jump, unit in _COUNTERS:
        if name in topics:
            for t, i, times in _counted(topics[name], counter):
                size = float(np.linalg.norm(np.nan_to_num(topics[name].columns(*jump)[i])))
                resets.append(EstimatorReset(t, kind, f"{kind} reset by {size:.2f} {unit}{_often(times)}"))
    return tuple(sorted(resets, key=lambda reset: reset.t))


def _attitude_resets(topics: Topics) -> Iterator[EstimatorReset]:
    """By vehicle_attitude's quat_reset_counter; delta_q_reset is the turn in NED."""
    if (topic := topics.get("vehicle_attitude")) is None:
        return
    turn = topic.array("delta_q_reset", range(4))
    for t, i, times in _counted(topic, "quat_reset_counter"):
        w, *axis = np.nan_to_num(turn[i])
        size = np.degrees(2.0 * np.arctan2(np.linalg.norm(axis), abs(w)))
        level = float(np.hypot(axis[0], axis[1])) <= _LEVEL * abs(axis[2])
        kind: ResetKind = "heading" if level else "attitude"
        yield EstimatorReset(t, kind, f"{kind} reset by {size:.1f}°{_often(times)}")


def _counted(topic: Topic, counter: str) -> Iterator[tuple[float, int, int]]:
    """(time, row, how often) of each row at which a counter went up."""
    if counter not in topic:
        return
    ups = np.mod(np.diff(np.asarray(topic[counter]).astype(np.int64)), _WRAPS)
    t = sampled(topic)
    for i in (np.flatnonzero(ups) + 1).tolist():
        yield float(t[i]), i, int(ups[i - 1])


def _often(times: int) -> str:
    return "" if times == 1 else f", the last of {times}"


_ARMED = 2  # vehicle_status.arming_state


_OTHERS = {
    "vehicle_imu_status", "sensor_gyro", "sensor_accel", "sensor_gyro_fifo", "sensor_accel_fifo",
    "vehicle_acceleration", "estimator_states", "estimator_status", "estimator_selector_status",
    "vehicle_attitude_setpoint", "actuator_motors", "actuator_outputs", "rfly_ctrl_lxl", "estimator_attitude",
    "estimator_local_position",
}  # fmt: skip

TOPICS = frozenset(
    name
    for topic in (*NEEDED, *(row.name for row in (*TOPIC_SOURCES, *DRIVER_SOURCES)), *_OTHERS)
    for name in instance_names(topic)
)
"""Topics whose fields a flight is made of. Some logs have the instance in the name of the topic."""


def ulog_flight(log: Ulog, read: list[UlogTopic], vehicle_types: Mapping[int, str]) -> Flight:
    """The one flight of a .ulg, of which TOPICS were read; vehicle_types names the values of MAV_TYPE.

    read: the log's topics. They are taken over: the list is empty afterwards, and their rows are let go when they have
    become tracks.
    """
    topics, times, notes = topics_of(log, read)
    parameters, at_first, changed = _parameters(log, notes)
    notes += _damage(log)
    begin, end = _span(times.values(), log.begun * 1e-6)
    code = log.infos.get("ver_sw_release")
    code = code if isinstance(code, int) else 0  # where damage met its type
    version = code >> 24, code >> 16 & 255
    actuators, control = pose.actuator_track(topics), pose.control_track(topics)
    let_go(topics, "actuator_motors", "actuator_outputs", "vehicle_attitude_setpoint")
    zero, by_device = pose.origin(topics), _imu_instances(topics)
    used = _imu_in_use(topics, by_device)
    imus = imu_tracks(topics, used, calibrations(at_first, changed), parameters, notes)
    let_go(topics, "vehicle_imu", "sensor_gyro", "sensor_accel", "sensor_gyro_fifo", "sensor_accel_fifo")
    let_go(topics, "vehicle_acceleration")
    resets = _estimator_resets(topics)
    attitude = pose.attitude_track(topics, notes)
    let_go(topics, "vehicle_angular_velocity", "vehicle_attitude")
    position = pose.position_track(topics, notes)
    let_go(topics, "vehicle_local_position")
    series = topic_series(topics, _attitude_elements(version), notes)
    vehicle = _vehicle(parameters, topics, vehicle_types, release(code))
    return Flight(
        vehicle=vehicle,
        settings=setting_names(vehicle.autopilot),
        boot=1,
        start=begin,
        duration=end - begin,
        imus=imus,
        attitude=attitude,
        position=position,
        origin=zero,
        epoch=pose.epoch(topics),
        home=pose.home(topics),
        series=series_of(series),
        events=_events(topics),
        parameters=parameters,
        texts=tuple(StatusText(m.stamp * 1e-6, m.level, words(m.text)) for m in log.texts),
        messages=Lazy({name: partial(arrival, times[name], 0) for name in sorted(times)}),
        on_board=True,
        **aiding_tracks(aiding_series(topics, series, notes), notes, apart=SELECTED_KINDS),
        biases=_bias_tracks(topics, version, by_device),
        truth=pose.truth(topics, zero),
        control=control,
        actuators=actuators,
        imu_in_use=used,
        lanes=pose.lanes(topics, zero, by_device),
        lane_in_use=_lane_in_use(topics),
        resets=resets,
        parameter_changes=changed,
    )


def _vehicle(
    parameters: Mapping[str, float], topics: Topics, vehicle_types: Mapping[int, str], firmware: str
) -> Vehicle:
    kind = identity(parameters, "MAV_TYPE", otherwise=-1)
    if kind not in vehicle_types and (status := topics.get("vehicle_status")) is not None and "system_type" in status:
        kind = int(status["system_type"][-1])  # what the autopilot made of it
    return px4_vehicle(parameters, vehicle_types.get(kind, UNKNOWN), firmware)


def _parameters(log: Ulog, notes: list[str]) -> tuple[dict[str, float], dict[str, float], tuple[ParameterChange, ...]]:
    """The last value of each, those at the beginning, and the changes while the log ran.

    What is left out is added to the notes.
    """
    set_values = [(-np.inf, name, value) for name, value in log.parameters.items()]
    set_values += [(at * 1e-6, name, value) for at, name, value in log.parameter_changes]
    numbers = [(t, words(name), float(value)) for t, name, value in set_values if isinstance(value, int | float)]
    if left_out := len(set_values) - len(numbers):
        notes.append(f"{counted(left_out, 'parameter')} of a damaged type left out")
    values = possible([name for _, name, _ in numbers], np.array([value for *_, value in numbers]), notes).tolist()
    known = [(t, name, value) for (t, name, _), value in zip(numbers, values, strict=True) if np.isfinite(value)]
    changed = tuple(ParameterChange(t, name, value) for t, name, value in known if t > -np.inf)
    at_first = {name: value for t, name, value in known if t == -np.inf}
    return {name: value for _, name, value in known}, at_first, changed


def _damage(log: Ulog) -> Iterator[str]:
    """What is missing from the file, in words."""
    if log.dropouts:
        longest = max(duration for _, duration in log.dropouts)
        yield f"{counted(len(log.dropouts), 'dropout')} of the logger, the longest {longest:.2f} s"
    if log.skipped_bytes:
        yield f"the file is damaged: {counted(log.skipped_bytes, 'byte')} of no message skipped"
    if log.unknown:
        yield f"{counted(log.unknown, 'message')} of an unknown type, or damaged, left out"
    if log.cut_bytes and not log.appended:
        yield f"the file ends in the middle of a message ({log.cut_bytes} bytes of one): it was cut off"


def _span(times: Iterable[Array], begun: float) -> tuple[float, float]:
    """First and last time, s. `begun` is when the file says that it was begun, where that can be.

    What was said before then stands in the log as well.
    """
    edges = [(float(t.min()), float(t.max())) for t in times]
    first, last = min((low for low, _ in edges), default=begun), max((high for _, high in edges), default=begun)
    return begun if first <= begun <= last else first, last


def _events(topics: Topics) -> tuple[Event, ...]:
    """Arming, modes and failsafes of vehicle_status."""
    if (topic := topics.get("vehicle_status")) is None:
        return ()
    t = topic.seconds("timestamp")
    events = list(changes(t, np.asarray(topic["arming_state"]) == _ARMED, topic["nav_state"], px4_nav_state_name))
    failsafe = np.asarray(topic["failsafe"] if "failsafe" in topic else np.zeros(len(t)), np.bool_)
    named = (("event", "failsafe over"), ("error", "failsafe"))
    events += [Event(float(t[i]), *named[int(failsafe[i])]) for i in turns(failsafe)]
    return in_order(events)
