"""The IMUs of a PX4 ULog.

`vehicle_imu` is what PX4 integrates of each IMU at its full rate: a rotation vector (coning included) and ∫f dt in body
axes over intervals that join, calibrated and in the body frame, without the EKF's biases. `sensor_combined` is the same
of the selected IMU. Both are means over `interval`, at its middle, and not low-passed.

The topics of the drivers, sensor_gyro with sensor_accel and the FIFOs behind them, are the readings of the board's
axes; calibration (CAL_GYROn_*, CAL_ACCn_*) and rotation (SENS_BOARD_*, or the sensor's own where it is external) are
applied here, as PX4 does for vehicle_imu; until PX4 1.10 the drivers themselves did the first (see `_calibrated`).
Thermal compensation (TC_*) is not. Only a track with more samples than vehicle_imu or sensor_combined have of the same
IMU tells more than they do: logs at default rates have one of these samples a second. Sources: PX4
`msg/VehicleImu.msg`, `msg/SensorCombined.msg`, `msg/SensorGyroFifo.msg`, `modules/sensors/vehicle_imu/VehicleIMU.cpp`,
`lib/drivers/gyroscope/PX4Gyroscope.cpp`, of PX4 1.10 too (UpdateCalibration), `lib/sensor_calibration/`,
`lib/conversion/rotation.h`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.model import ORIENTATIONS, Array, ImuTrack, ParameterChange, SensorInUse, interpolated
from companion.telemetry.clock import LONGEST_WAIT_S
from companion.telemetry.convert import euler_matrix, in_force
from companion.telemetry.parameters import part_ranges
from companion.telemetry.samples import finite_rows, imu_track, increasing, not_zero
from companion.telemetry.ulog.topics import Topic, Topics, commonest_device, instances, sampled


def imu_tracks(
    topics: Topics,
    used: SensorInUse | None,
    settings: Calibrations,
    parameters: Mapping[str, float],
    notes: list[str],
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
        several = np.count_nonzero(shares) > 1
        if several:
            notes.append(
                f"sensor_combined changes between IMUs {np.flatnonzero(shares).tolist()}; IMU {instance} has "
                f"{100 * shares[instance]:.0f} % of it"
            )
        tracks.append(replace(combined, instance=instance, switches=used if several else None))
    tracks += driver_tracks(topics, tracks, settings, notes)
    if not any(len(track) > 1 for track in tracks):
        tracks += _filtered(topics, parameters, notes)
    notes += [f"{track.source} left out: it has no readings, or zeros only" for track in tracks if not len(track)]
    return {track.source: track for track in tracks if len(track)}


def _integrated(topics: Topics, notes: list[str]) -> Iterator[ImuTrack]:
    """vehicle_imu: increments over dt, of which the means are kept."""
    for instance, name, topic in instances(topics, "vehicle_imu"):
        gyro_dt, accel_dt = (topic.column(f"{of}_dt") * 1e-6 for of in ("delta_angle", "delta_velocity"))
        whole = (gyro_dt > 0) & (accel_dt > 0) & (gyro_dt < LONGEST_WAIT_S)
        gyro = topic.array("delta_angle") / np.where(whole, gyro_dt, 1.0)[:, None]
        accel = topic.array("delta_velocity") / np.where(whole, accel_dt, 1.0)[:, None]
        device, other = (commonest_device(topic, f"{of}_device_id") for of in ("gyro", "accel"))
        ranges, good = part_ranges("PX4", device, other), whole & not_zero(gyro, accel)
        track = imu_track(name, sampled(topic) - gyro_dt / 2, gyro, accel, good, notes, ranges, gyro_dt)
        yield replace(track, instance=instance, device_id=device or None)


def _combined(topic: Topic, notes: list[str]) -> ImuTrack:
    """sensor_combined is stamped at the end of the gyro's interval; before PX4 1.7 some releases tell it in s."""
    own = topic.column("gyro_integral_dt")
    known = own[np.isfinite(own)]
    own *= 1e-6 if len(known) and np.median(known) >= 1.0 else 1.0  # one may be damaged
    gyro, accel = topic.array("gyro_rad"), topic.array("accelerometer_m_s2")
    good = (own >= 0.0) & (own < LONGEST_WAIT_S) & not_zero(gyro, accel)
    return imu_track("sensor_combined", topic.seconds() - own / 2, gyro, accel, good, notes, interval=own)


def _filtered(topics: Topics, parameters: Mapping[str, float], notes: list[str]) -> Iterator[ImuTrack]:
    """Where nothing else is logged: what the controllers use, low-passed and without the EKF's biases."""
    if not {"vehicle_angular_velocity", "vehicle_acceleration"} <= topics.keys():
        return
    turning, pushed = topics["vehicle_angular_velocity"], topics["vehicle_acceleration"]
    own, rate = sampled(turning), turning.array("xyz")
    keep = increasing(own, finite_rows(rate))
    own, rate, t = own[keep], rate[keep], sampled(pushed)
    within = (t >= own[0]) & (t <= own[-1]) if len(own) else np.zeros(len(t), np.bool_)
    if within.any():
        gyro, accel = interpolated(t, own, rate), pushed.array("xyz")
        track = imu_track("vehicle_angular_velocity", t, gyro, accel, within & not_zero(gyro, accel), notes)
        gyro_hz, accel_hz = (parameters.get(name) for name in ("IMU_GYRO_CUTOFF", "IMU_ACCEL_CUTOFF"))
        yield replace(track, bias_removed=True, gyro_low_pass_hz=gyro_hz, accel_low_pass_hz=accel_hz)


Calibrations = tuple[tuple[float, Mapping[str, float]], ...]
"""From when on (s), and the parameters from then on. In order of time, the first from -inf."""


_CALIBRATING = ("CAL_", "SENS_BOARD_")


def calibrations(at_first: Mapping[str, float], changes: Iterable[ParameterChange]) -> Calibrations:
    """What turns and calibrates the drivers' readings: PX4 learns it anew after a landing, in the same log."""
    known = {name: value for name, value in at_first.items() if name.startswith(_CALIBRATING)}
    several = [(-np.inf, dict(known))]
    for change in changes:
        if change.name.startswith(_CALIBRATING) and known.get(change.name) != change.value:
            known[change.name] = change.value
            if several[-1][0] == change.t:
                several.pop()
            several.append((change.t, dict(known)))
    return tuple(several)


_FIFO_MOST = 32  # samples in a message
_FULL_SCALE = 32768.0  # of the FIFO's 16 bits
_CALIBRATIONS = 4  # CAL_GYRO0_* to CAL_GYRO3_*
_AXES = "XYZ"


@dataclass(frozen=True, slots=True, eq=False)
class _Readings:
    """One sensor's, calibrated, in the body frame."""

    name: str
    t: Array  # (N,) s
    values: Array  # (N, 3)
    interval: Array | None  # (N,) s, where a sample is a mean
    device_id: int
    most: float | None  # where it saturates, as the topic tells


def driver_tracks(
    topics: Topics, known: Sequence[ImuTrack], settings: Calibrations, notes: list[str]
) -> list[ImuTrack]:
    """A track of each IMU that has more samples than any of those known has of it, at the gyro's times."""
    tracks: list[ImuTrack] = []
    for of in ("sensor_gyro_fifo", "sensor_gyro"):
        gyros = list(_sensors(topics, of, "GYRO", settings))
        accels = list(_sensors(topics, of.replace("gyro", "accel"), "ACC", settings))
        for number, gyro in enumerate(gyros):
            instance = next((one.instance for one in known if one.device_id == gyro.device_id), number)
            more = max((len(one) for one in [*known, *tracks] if one.instance == instance), default=0)
            partner = _partner(topics, gyro, accels, instance)
            if partner is not None and len(gyro.t) > more and (track := _joined(gyro, partner, notes)) is not None:
                tracks.append(replace(track, instance=instance))
    return tracks


def _partner(topics: Topics, gyro: _Readings, accels: list[_Readings], instance: int) -> _Readings | None:
    """The accelerometer of the same chip; where that has another id, the one that vehicle_imu pairs with the gyro."""
    device_ids = {gyro.device_id}
    for number, _, topic in instances(topics, "vehicle_imu"):
        if number == instance:
            device_ids |= set(topic.ids("accel_device_id").tolist())
    return next((one for one in accels if one.device_id in device_ids and len(one.t) > 1), None)


def _joined(gyro: _Readings, accel: _Readings, notes: list[str]) -> ImuTrack | None:
    """Both at the gyro's times: the accelerometer's on the line between its own."""
    usual = part_ranges("PX4", gyro.device_id, accel.device_id)
    within = (gyro.t >= accel.t[0]) & (gyro.t <= accel.t[-1])
    force = interpolated(gyro.t, accel.t, accel.values)
    ranges = gyro.most or usual[0], accel.most or usual[1]
    track = imu_track(gyro.name, gyro.t, gyro.values, force, within, notes, ranges, gyro.interval)
    return replace(track, device_id=gyro.device_id or None) if len(track) > 1 else None


def _sensors(topics: Topics, of: str, kind: str, settings: Calibrations) -> Iterator[_Readings]:
    for _, name, topic in instances(topics, of):
        devices = topic.ids("device_id")
        device = int(devices[-1]) if len(devices) else 0
        t, values, interval, most = _fifo(topic) if of.endswith("fifo") else _driver(topic)
        keep = increasing(t, np.isfinite(t) & finite_rows(values))
        own = None if interval is None else interval[keep]
        t, values = t[keep], values[keep]
        by_driver = "integral_dt" in topic  # until PX4 1.10
        for now, parameters in in_force(t, settings):
            values[now] = _calibrated(values[now], kind, device, parameters, by_driver=by_driver)
        yield _Readings(name, t, values, own, device, most)


def _driver(topic: Topic) -> tuple[Array, Array, Array | None, float | None]:
    """Times, readings, intervals and range of sensor_gyro or sensor_accel.

    A sample made of several of the FIFO is their mean since the last message, and stamped with the last of them.
    """
    t, samples = sampled(topic), topic.column("samples")
    interval = None
    if len(t) > 1 and np.nanmedian(np.append(samples, 1.0)) > 1:
        interval = np.diff(t, prepend=2 * t[0] - t[1])
        interval = np.where((interval > 0) & (interval < 3 * np.median(interval)), interval, np.median(interval))
        t = t - interval / 2
    return t, topic.columns("x", "y", "z"), interval, None


def _fifo(topic: Topic) -> tuple[Array, Array, Array | None, float | None]:
    """The same of a FIFO: every sample an instant, the last of a message at timestamp_sample, dt (µs) between them."""
    count = np.clip(np.nan_to_num(topic.column("samples")), 0, _FIFO_MOST).astype(np.intp)
    dt, scale = topic.column("dt") * 1e-6, topic.column("scale")
    row = np.repeat(np.arange(len(count)), count)
    place = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    dt = np.where((dt >= 0.0) & (dt * _FIFO_MOST < LONGEST_WAIT_S), dt, np.nan)
    t = sampled(topic)[row] - (count[row] - 1 - place) * dt[row]
    raw = [topic.array(axis, range(_FIFO_MOST))[row, place] for axis in "xyz"]
    most = float(np.nanmedian(scale)) * _FULL_SCALE if np.isfinite(scale).any() else None
    return t, np.column_stack(raw) * scale[row, None], None, most


def _calibrated(
    values: Array, kind: str, device: int, parameters: Mapping[str, float], *, by_driver: bool = False
) -> Array:
    """In the body frame, without offset and with the right scale; as they are where the log has no calibration.

    by_driver: they are calibrated already, as also where CAL_GYROn_EN, a parameter of those drivers, is known.
    """
    number = next((n for n in range(_CALIBRATIONS) if device and parameters.get(f"CAL_{kind}{n}_ID") == device), None)
    rotation = parameters.get("SENS_BOARD_ROT", 0.0)
    if number is not None:
        of = f"CAL_{kind}{number}_"
        offset = [parameters.get(f"{of}{axis}OFF", 0.0) for axis in _AXES]
        scale = [parameters.get(f"{of}{axis}SCALE", 1.0) for axis in _AXES]
        if not by_driver and f"{of}EN" not in parameters:
            values = (values - offset) * scale
        own = parameters.get(f"{of}ROT", -1.0)
        rotation = own if own >= 0 else rotation  # of an external sensor
    degrees = ORIENTATIONS[int(rotation) if 0 <= rotation < len(ORIENTATIONS) else 0]
    level = [parameters.get(f"SENS_BOARD_{axis}_OFF", 0.0) for axis in _AXES]
    turn = euler_matrix(*np.radians(level)) @ euler_matrix(*np.radians(degrees))
    return np.asarray(values @ turn.T)
