"""PX4's ULog → its flight, through pyulog (the extra `ulog`).

The topics are read by `topics`; `imu`, `pose`, `aiding` and `estimator` make tracks of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from companion.mavlink import px4_nav_state_name
from companion.model import Event, Flight, ParameterChange, StatusText, Vehicle, counted
from companion.telemetry.aiding import aiding_tracks
from companion.telemetry.arrival import arrival
from companion.telemetry.events import changes, in_order
from companion.telemetry.firmware import UNKNOWN
from companion.telemetry.parameters import identity, possible, setting_names
from companion.telemetry.sanitize import words
from companion.telemetry.ulog.aiding import barometer_tracks, compass_tracks, gps_tracks, truth
from companion.telemetry.ulog.control import actuator_track, control_track
from companion.telemetry.ulog.estimator import bias_tracks, estimator_resets, imu_in_use, imu_instances
from companion.telemetry.ulog.imu import imu_tracks
from companion.telemetry.ulog.pose import attitude_track, epoch, home, origin, position_track
from companion.telemetry.ulog.quantities import OF_SERIES, topic_series
from companion.telemetry.ulog.topics import Topics, read_ulog, seconds, topics_of, unfinished

_ARMED = 2  # vehicle_status.arming_state


def ulog_flight(path: Path, contents: bytes, vehicle_types: Mapping[int, str]) -> Flight:
    """The one flight of a .ulg of these contents; vehicle_types names the values of MAV_TYPE.

    Raises InputError when pyulog is not installed or cannot read the file.
    """
    log = read_ulog(path, contents)
    topics, notes = topics_of(log)
    parameters, changed = _parameters(log, notes)
    notes += _damage(log, contents)
    begin, end = _span(topics, log.start_timestamp * 1e-6)
    release = log.msg_info_dict.get("ver_sw_release")
    version = _version(release)
    zero, by_device = origin(topics), imu_instances(topics)
    used = imu_in_use(topics, by_device)
    imus = imu_tracks(topics, used, parameters, notes)
    selected = {
        "gps": gps_tracks(topics, notes),
        "compasses": compass_tracks(topics, notes),
        "barometers": barometer_tracks(topics, notes),
    }
    attitude, position = attitude_track(topics, notes), position_track(topics, notes)
    series = topic_series(topics, version, notes)
    others = {key: series[key] for key in series if key.partition(":")[0] in OF_SERIES}
    vehicle = _vehicle(parameters, topics, vehicle_types, release)
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
        epoch=epoch(topics),
        home=home(topics),
        series=series,
        events=_events(topics),
        parameters=parameters,
        texts=tuple(
            StatusText(m.timestamp * 1e-6, m.log_level - ord("0"), words(str(m.message))) for m in log.logged_messages
        ),
        messages={name: arrival(seconds(topic), 0) for name, topic in sorted(topics.items())},
        on_board=True,
        **aiding_tracks(others, notes) | selected,
        biases=bias_tracks(topics, version, by_device),
        truth=truth(topics, zero),
        control=control_track(topics),
        actuators=actuator_track(topics),
        imu_in_use=used,
        resets=estimator_resets(topics),
        parameter_changes=changed,
    )


def _vehicle(
    parameters: Mapping[str, float], topics: Topics, vehicle_types: Mapping[int, str], release: object
) -> Vehicle:
    kind = identity(parameters, "MAV_TYPE", otherwise=-1)
    if kind not in vehicle_types and "system_type" in (status := topics.get("vehicle_status", {})):
        kind = int(status["system_type"][-1])  # what the autopilot made of it
    return Vehicle(
        identity(parameters, "MAV_SYS_ID"),
        identity(parameters, "MAV_COMP_ID"),
        autopilot="PX4",
        type=vehicle_types.get(kind, UNKNOWN),
        firmware=_firmware(release),
    )


def _parameters(log: Any, notes: list[str]) -> tuple[dict[str, float], tuple[ParameterChange, ...]]:
    """The last value of each, and the changes while the log ran. What is left out is added to the notes."""
    said = [(-np.inf, name, value) for name, value in log.initial_parameters.items()]
    said += [(at * 1e-6, name, value) for at, name, value in log.changed_parameters]
    numbers = [(t, words(str(name)), float(value)) for t, name, value in said if isinstance(value, int | float)]
    if left_out := len(said) - len(numbers):
        notes.append(f"{counted(left_out, 'parameter')} of a damaged type left out")
    values = possible([name for _, name, _ in numbers], np.array([value for *_, value in numbers]), notes).tolist()
    known = [(t, name, value) for (t, name, _), value in zip(numbers, values, strict=True) if np.isfinite(value)]
    changed = tuple(ParameterChange(t, name, value) for t, name, value in known if t > -np.inf)
    return {name: value for _, name, value in known}, changed


def _damage(log: Any, contents: bytes) -> Iterator[str]:
    """What is missing from the file, in words."""
    if log.dropouts:
        yield f"{counted(len(log.dropouts), 'dropout')} of the logger, the longest {_longest(log.dropouts):.2f} s"
    if log.file_corruption:
        yield "the file is damaged: what could be read of it is used"
    if cut := unfinished(contents, appended=bool(log.has_data_appended)):
        yield f"the file ends in the middle of a message ({cut} bytes of one): it was cut off"


def _span(topics: Topics, begun: float) -> tuple[float, float]:
    """First and last time, s. `begun` is when the file says that it was begun, where that can be.

    What was said before then stands in the log as well.
    """
    edges = [(float(t.min()), float(t.max())) for topic in topics.values() if len(t := seconds(topic))]
    first, last = min((low for low, _ in edges), default=begun), max((high for _, high in edges), default=begun)
    return begun if first <= begun <= last else first, last


def _longest(dropouts: list[Any]) -> float:
    return float(max(d.duration for d in dropouts)) * 1e-3


def _firmware(release: object) -> str:
    """ver_sw_release is major, minor, patch, type, one byte each."""
    if not isinstance(release, int):  # where damage met its type
        return ""
    return f"{release >> 24}.{release >> 16 & 255}.{release >> 8 & 255}" if release else ""


def _version(release: object) -> tuple[int, int]:
    """Major and minor; (0, 0) where they are not told."""
    return (release >> 24, release >> 16 & 255) if isinstance(release, int) else (0, 0)


def _events(topics: Topics) -> tuple[Event, ...]:
    """Arming, modes and failsafes of vehicle_status."""
    if "vehicle_status" not in topics:
        return ()
    topic = topics["vehicle_status"]
    t = seconds(topic, "timestamp")
    events = list(changes(t, np.asarray(topic["arming_state"]) == _ARMED, topic["nav_state"], px4_nav_state_name))
    failsafe = np.asarray(topic.get("failsafe", np.zeros(len(t))), np.bool_)
    turns = (np.flatnonzero(np.diff(failsafe)) + 1).tolist()
    events += [
        Event(float(t[i]), *(("error", "failsafe") if failsafe[i] else ("event", "failsafe over"))) for i in turns
    ]
    return in_order(events)
