"""The IMUs of a PX4 ULog.

`vehicle_imu` is what PX4 integrates of each IMU at its full rate: a rotation vector (coning included) and ∫f dt in body
axes over intervals that join, calibrated and in the body frame, without the EKF's biases. `sensor_combined` is the same
of the selected IMU. Both are means over `interval`, at its middle, and not low-passed. The topics of the drivers are in
`drivers`. Sources: PX4 `msg/VehicleImu.msg`, `msg/SensorCombined.msg`, `modules/sensors/vehicle_imu/VehicleIMU.cpp`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from companion.model import Array, ImuTrack, SensorInUse, interpolated
from companion.telemetry.outliers import Ranges
from companion.telemetry.parts import part_ranges
from companion.telemetry.samples import commonest, imu_track, increasing
from companion.telemetry.timestamps import LONGEST_WAIT_S
from companion.telemetry.ulog.drivers import driver_tracks
from companion.telemetry.ulog.topics import (
    Topic,
    Topics,
    column,
    device_ids,
    finite,
    instances,
    sampled,
    seconds,
    xyz,
)


def imu_tracks(
    topics: Topics, used: SensorInUse | None, parameters: Mapping[str, float], notes: list[str]
) -> dict[str, ImuTrack]:
    """Every instance of vehicle_imu, sensor_combined and what the drivers logged at higher rates, by topic."""
    tracks = [*_integrated(topics, notes)]
    if "sensor_combined" in topics:
        combined = _combined(topics["sensor_combined"], notes)
        shares = np.zeros(0) if used is None else np.bincount(used.at(combined.t)) / max(len(combined), 1)
        instance = int(np.argmax(shares)) if len(shares) else 0
        same = next((track for track in tracks if track.instance == instance), None)
        if same is not None:
            combined = replace(
                combined, device_id=same.device_id, gyro_range=same.gyro_range, accel_range=same.accel_range
            )
        if np.count_nonzero(shares) > 1:
            notes.append(
                f"sensor_combined changes between IMUs {np.flatnonzero(shares).tolist()}; IMU {instance} has "
                f"{100 * shares[instance]:.0f} % of it"
            )
        tracks.append(replace(combined, instance=instance))
    tracks += driver_tracks(topics, tracks, parameters, notes)
    if not any(len(track) > 1 for track in tracks):
        tracks += _filtered(topics, parameters, notes)
    notes += [f"{track.source} left out: it has no readings, or zeros only" for track in tracks if not len(track)]
    return {track.source: track for track in tracks if len(track)}


def _integrated(topics: Topics, notes: list[str]) -> Iterator[ImuTrack]:
    """vehicle_imu: increments over dt, of which the means are kept."""
    for instance, name, topic in instances(topics, "vehicle_imu"):
        gyro_dt, accel_dt = (column(topic, f"{of}_dt") * 1e-6 for of in ("delta_angle", "delta_velocity"))
        whole = (gyro_dt > 0) & (accel_dt > 0) & (gyro_dt < LONGEST_WAIT_S)
        gyro = xyz(topic, "delta_angle") / np.where(whole, gyro_dt, 1.0)[:, None]
        accel = xyz(topic, "delta_velocity") / np.where(whole, accel_dt, 1.0)[:, None]
        device, other = (_device(topic, f"{of}_device_id") for of in ("gyro", "accel"))
        ranges = part_ranges("PX4", device, other)
        track = _track(name, sampled(topic) - gyro_dt / 2, gyro, accel, gyro_dt, whole, notes, ranges)
        yield replace(track, instance=instance, device_id=device or None)


def _combined(topic: Topic, notes: list[str]) -> ImuTrack:
    """sensor_combined is stamped at the end of the gyro's interval; before PX4 1.7 some releases tell it in s."""
    own = column(topic, "gyro_integral_dt")
    own *= 1.0 if np.nanmax(own, initial=0.0) < 1.0 else 1e-6
    t = seconds(topic) - own / 2
    good = (own >= 0.0) & (own < LONGEST_WAIT_S)
    return _track("sensor_combined", t, xyz(topic, "gyro_rad"), xyz(topic, "accelerometer_m_s2"), own, good, notes)


def _filtered(topics: Topics, parameters: Mapping[str, float], notes: list[str]) -> Iterator[ImuTrack]:
    """Where nothing else is logged: what the controllers use, low-passed and without the EKF's biases."""
    if not {"vehicle_angular_velocity", "vehicle_acceleration"} <= topics.keys():
        return
    turning, pushed = topics["vehicle_angular_velocity"], topics["vehicle_acceleration"]
    own, rate = sampled(turning), xyz(turning, "xyz")
    keep = increasing(own, finite(rate))
    own, rate, t = own[keep], rate[keep], sampled(pushed)
    within = (t >= own[0]) & (t <= own[-1]) if len(own) else np.zeros(len(t), np.bool_)
    if within.any():
        gyro = interpolated(t, own, rate)
        track = _track("vehicle_angular_velocity", t, gyro, xyz(pushed, "xyz"), np.zeros(len(t)), within, notes)
        gyro_hz, accel_hz = (parameters.get(name) for name in ("IMU_GYRO_CUTOFF", "IMU_ACCEL_CUTOFF"))
        yield replace(track, interval=None, bias_removed=True, gyro_low_pass_hz=gyro_hz, accel_low_pass_hz=accel_hz)


def _track(
    source: str,
    t: Array,
    gyro: Array,
    accel: Array,
    interval: Array,
    whole: npt.NDArray[np.bool_],
    notes: list[str],
    ranges: Ranges = (None, None),
) -> ImuTrack:
    """whole: rows that say for which interval they are. Rows of zeros are no readings."""
    good = whole & (gyro.any(axis=1) | accel.any(axis=1))
    return imu_track(source, t, gyro, accel, good, notes, ranges, interval)


def _device(topic: Topic, field: str) -> int:
    """The device that most rows are of; 0 where none is told."""
    devices = device_ids(topic, field)
    return commonest(devices[devices != 0])
