"""The topics of a PX4 ULog that tracks are made of; what is damaged or not of the boot clock is left out and noted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from companion.logs import Ulog, UlogTopic
from companion.model import Array, counted
from companion.telemetry.texts import words
from companion.telemetry.timestamps import LONGEST_WAIT_S, ON_BOARD, left_out, off_course

Topic = UlogTopic

Topics = Mapping[str, Topic]
"""Topic by the name that PX4's tools give it: vehicle_imu, vehicle_imu_1, ..."""

_DATED, _SAMPLED = "timestamp", "timestamp_sample"
_XYZ = ("[0]", "[1]", "[2]")
_Q = ("q[0]", "q[1]", "q[2]", "q[3]")
NEEDED: Mapping[str, tuple[str, ...]] = {
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

_INSTANCES = 16  # the most that a flight controller publishes of one topic


def topics_of(log: Ulog, read: list[UlogTopic]) -> tuple[dict[str, Topic], dict[str, Array], list[str]]:
    """The topics by name, without those whose declaration lacks what is read of them; their times (N,) s; and notes.

    read: the log's topics; the list is empty afterwards. Rows whose time is not of the clock of the others (UNIX time,
    damage) are left out: see `timestamps`.
    """
    whole: dict[str, UlogTopic] = {}
    notes = [
        f"{words(name) or 'data of no topic'}: {counted(count, 'message')} left out: the log's declaration of them is "
        "damaged or missing"
        for name, count in log.undecoded.items()
    ]
    while read:
        one = read.pop(0)
        name = _name(one.name, one.instance)
        lacks = [field for field in (_DATED, *NEEDED.get(one.name, ())) if field not in one]
        if not name.isidentifier():
            notes.append(f"a topic is left out: its name is damaged ({words(name)})")
        elif lacks:
            notes.append(f"{name} is left out: the log declares it without {', '.join(lacks)}")
        else:
            whole[name] = one
    times = {name: topic.seconds() for name, topic in whole.items()}
    apart = off_course(times, ON_BOARD)
    notes += left_out(times, apart)
    for name, mask in apart.items():
        whole[name], times[name] = whole[name].select(~mask), times[name][~mask]
    topics = {name: topic for name, topic in whole.items() if topic.count}
    notes += _published({name: topic for name, topic in whole.items() if topic.count and topic.fields_read})
    return topics, {name: times[name] for name in topics}, notes


def _name(topic: str, instance: int) -> str:
    return f"{topic}_{instance}" if instance else topic


def let_go(topics: dict[str, Topic], *kinds: str) -> None:
    """Forget the topics of these kinds, and with them their rows."""
    for name in [name for kind in kinds for _, name, _ in instances(topics, kind)]:
        del topics[name]


def instance_names(topic: str) -> list[str]:
    """The names that the instances of a topic may have: vehicle_imu, vehicle_imu_1, ..."""
    return [_name(topic, instance) for instance in range(_INSTANCES)]


def instances(topics: Topics, topic: str) -> Iterator[tuple[int, str, Topic]]:
    """(instance, name, columns) of each instance of a topic that is in the log."""
    for instance, name in enumerate(instance_names(topic)):
        if name in topics:
            yield instance, name, topics[name]


def sampled(topic: Topic) -> Array:
    """When it was measured; where that is not logged (before PX4 1.11 often, or zero), when it was published."""
    t = topic.seconds()
    if _SAMPLED not in topic:
        return t
    measured = topic.seconds(_SAMPLED)
    return np.where(np.abs(measured - t) < LONGEST_WAIT_S, measured, t)


def _published(topics: Topics) -> Iterator[str]:
    """A note for each topic of which some samples are taken at the time of their publication: see `sampled`.

    Where most times are so far off, as in estimator_event_flags, the field means another thing.
    """
    for name, topic in topics.items():
        if _SAMPLED in topic:
            measured = topic.seconds(_SAMPLED)
            off = (measured > 0) & (np.abs(measured - topic.seconds()) >= LONGEST_WAIT_S)
            if 0 < off.sum() <= len(off) / 2:
                yield (
                    f"{name}: {int(off.sum())} of {len(off)} taken at the time of their publication: that of the "
                    f"sample is {LONGEST_WAIT_S:g} s and more off it"
                )
