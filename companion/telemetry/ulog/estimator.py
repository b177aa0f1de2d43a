"""What PX4's EKF2 believes of its IMU, which IMU it uses, the jumps that it announces, and which instance of it flew.

Source: PX4 `src/modules/ekf2/EKF2Selector.cpp`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from companion.mavlink import Index
from companion.model import Array, BiasTrack, EstimatorReset, ResetKind, SensorInUse
from companion.telemetry.events import lane_changes
from companion.telemetry.samples import commonest, finite_rows, in_use, increasing
from companion.telemetry.ulog.topics import Topic, Topics, instances, sampled

Version = tuple[int, int]
"""Major and minor of PX4's release; (0, 0) where the log does not tell it."""

_GYRO, _ACCEL = 10, 13  # in EKF2's state vector: after attitude (4), velocity (3) and position (3)
_ERROR_STATE = (1, 15)
_GYROS = (("vehicle_imu", "gyro_device_id"), ("vehicle_imu_status", "gyro_device_id"), ("sensor_gyro", "device_id"))
_SELECTOR, _INVALID_INSTANCE = "estimator_selector_status", 255
_RATES = (1, 15)  # since then the states are rates; before, delta angles and velocities over one filter interval


def imu_instances(topics: Topics) -> dict[int, int]:
    """Device id of a gyro → its instance, as vehicle_imu numbers them."""
    by_device: dict[int, int] = {}
    for name, field in _GYROS:
        for instance, _, topic in instances(topics, name):
            for device in np.unique(topic.ids(field)).tolist():
                if device:
                    by_device.setdefault(device, instance)
    return by_device


def imu_in_use(topics: Topics, by_device: Mapping[int, int]) -> SensorInUse | None:
    """The gyro that sensor_selection names, or where it is not there estimator_selector_status; None without both."""
    for name in ("sensor_selection", _SELECTOR):
        if name not in topics:
            continue
        t, devices = topics[name].seconds(), topics[name].ids("gyro_device_id")
        instance = np.array([by_device.get(device, -1) for device in devices.tolist()], np.int64)
        if (used := in_use(name, t, instance, instance >= 0)) is not None:
            return used
    return None


def bias_tracks(topics: Topics, version: Version, by_device: Mapping[int, int]) -> tuple[BiasTrack, ...]:
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


def lane_in_use(topics: Topics) -> SensorInUse | None:
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
    tracks = []
    for device in dict.fromkeys(devices[known].tolist()):
        keep = increasing(t, known & (devices == device))
        tracks.append(
            BiasTrack(
                t[keep], gyro[keep], accel[keep], gyro_sigma[keep], accel_sigma[keep],
                source=name, core=core, imu_instance=by_device.get(device),
            )
        )  # fmt: skip
    return tracks


def _state_biases(topic: Topic, name: str, core: int, version: Version, by_device: Mapping[int, int]) -> BiasTrack:
    """From the state vector; the IMU is known where the vehicle has one."""
    t, dt = sampled(topic), filter_interval(version)
    gyro, accel = (topic.array("states", range(at, at + 3)) / dt for at in (_GYRO, _ACCEL))
    less = 4 - attitude_elements(version)
    gyro_sigma, accel_sigma = (
        _sigma(topic.array("covariances", range(at - less, at - less + 3))) / dt for at in (_GYRO, _ACCEL)
    )
    keep = increasing(t, finite_rows(gyro, accel))
    only = next(iter(by_device.values())) if len(by_device) == 1 else (None if by_device else 0)
    return BiasTrack(
        t[keep], gyro[keep], accel[keep], gyro_sigma[keep], accel_sigma[keep], source=name, core=core, imu_instance=only
    )


def attitude_elements(version: Version) -> int:
    """Of EKF2's covariance: the quaternion's, or since PX4 1.15 those of the attitude's error."""
    return 3 if version >= _ERROR_STATE else 4


def filter_interval(version: Version) -> float:
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


def estimator_resets(topics: Topics) -> tuple[EstimatorReset, ...]:
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
    if "vehicle_attitude" not in topics:
        return
    topic = topics["vehicle_attitude"]
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
