"""PX4's ULog → its flight.

The topics are read by `topics`; `imu`, `pose` and `estimator` make tracks of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import partial

import numpy as np

from companion.logs import Ulog, UlogTopic
from companion.mavlink import px4_nav_state_name
from companion.model import Array, Event, Flight, ParameterChange, StatusText, Vehicle, counted
from companion.telemetry.aiding import aiding_tracks
from companion.telemetry.events import changes, in_order, turns
from companion.telemetry.flights import arrival
from companion.telemetry.parameters import UNKNOWN, identity, possible, px4_vehicle, release, setting_names, words
from companion.telemetry.quantities import Lazy, series_of
from companion.telemetry.sources import DRIVER_SOURCES, TOPIC_SOURCES
from companion.telemetry.ulog import estimator, pose
from companion.telemetry.ulog.imu import imu_tracks
from companion.telemetry.ulog.topics import (
    NEEDED,
    SELECTED_KINDS,
    Topics,
    aiding_series,
    instance_names,
    let_go,
    topic_series,
    topics_of,
)

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
    parameters, changed = _parameters(log, notes)
    notes += _damage(log)
    begin, end = _span(times.values(), log.begun * 1e-6)
    code = log.infos.get("ver_sw_release")
    code = code if isinstance(code, int) else 0  # where damage met its type
    version = code >> 24, code >> 16 & 255
    actuators, control = pose.actuator_track(topics), pose.control_track(topics)
    let_go(topics, "actuator_motors", "actuator_outputs", "vehicle_attitude_setpoint")
    zero, by_device = pose.origin(topics), estimator.imu_instances(topics)
    used = estimator.imu_in_use(topics, by_device)
    imus = imu_tracks(topics, used, parameters, notes)
    let_go(topics, "vehicle_imu", "sensor_gyro", "sensor_accel", "sensor_gyro_fifo", "sensor_accel_fifo")
    let_go(topics, "vehicle_acceleration")
    resets = estimator.estimator_resets(topics)
    attitude = pose.attitude_track(topics, notes)
    let_go(topics, "vehicle_angular_velocity", "vehicle_attitude")
    position = pose.position_track(topics, notes)
    let_go(topics, "vehicle_local_position")
    series = topic_series(topics, estimator.attitude_elements(version), notes)
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
        biases=estimator.bias_tracks(topics, version, by_device),
        truth=pose.truth(topics, zero),
        control=control,
        actuators=actuators,
        imu_in_use=used,
        lanes=pose.lanes(topics, zero, by_device),
        lane_in_use=estimator.lane_in_use(topics),
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


def _parameters(log: Ulog, notes: list[str]) -> tuple[dict[str, float], tuple[ParameterChange, ...]]:
    """The last value of each, and the changes while the log ran. What is left out is added to the notes."""
    set_values = [(-np.inf, name, value) for name, value in log.parameters.items()]
    set_values += [(at * 1e-6, name, value) for at, name, value in log.parameter_changes]
    numbers = [(t, words(name), float(value)) for t, name, value in set_values if isinstance(value, int | float)]
    if left_out := len(set_values) - len(numbers):
        notes.append(f"{counted(left_out, 'parameter')} of a damaged type left out")
    values = possible([name for _, name, _ in numbers], np.array([value for *_, value in numbers]), notes).tolist()
    known = [(t, name, value) for (t, name, _), value in zip(numbers, values, strict=True) if np.isfinite(value)]
    changed = tuple(ParameterChange(t, name, value) for t, name, value in known if t > -np.inf)
    return {name: value for _, name, value in known}, changed


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
    if "vehicle_status" not in topics:
        return ()
    topic = topics["vehicle_status"]
    t = topic.seconds("timestamp")
    events = list(changes(t, np.asarray(topic["arming_state"]) == _ARMED, topic["nav_state"], px4_nav_state_name))
    failsafe = np.asarray(topic["failsafe"] if "failsafe" in topic else np.zeros(len(t)), np.bool_)
    named = (("event", "failsafe over"), ("error", "failsafe"))
    events += [Event(float(t[i]), *named[int(failsafe[i])]) for i in turns(failsafe)]
    return in_order(events)
