"""GPS, compasses, barometers and a simulator's truth in a PX4 ULog.

`vehicle_*` is the sensor that PX4 has selected, calibrated and turned into the body frame; `sensor_*` is one driver's
own. A driver's topic is a witness of its own where its sensor is not the selected one. Sources: PX4 v1.6 to v1.16
`msg/SensorGps.msg`, `VehicleMagnetometer.msg`, `VehicleAirData.msg`, `SensorBaro.msg`, `SensorCombined.msg`.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from companion.model import (
    SEMI_MAJOR_AXIS,
    Array,
    BarometerTrack,
    CompassTrack,
    GpsTrack,
    Origin,
    TruthTrack,
    geodetic_from_ned,
    ned_from_geodetic,
)
from companion.telemetry.aiding import is_frozen, lone_air
from companion.telemetry.air_and_ground import is_constant
from companion.telemetry.convert import SI, continuous, increasing
from companion.telemetry.outliers import lone, lone_fields, uncontradicted
from companion.telemetry.quantities import POLE, pressure_altitude
from companion.telemetry.timestamps import LONGEST_WAIT_S
from companion.telemetry.ulog.topics import (
    Topic,
    Topics,
    column,
    columns,
    device_ids,
    finite,
    flag,
    instances,
    sampled,
    seconds,
    xyz,
)

_FIX_2D, _FIX_3D = 2, 3  # GPS_FIX_TYPE
_EXTRAPOLATED = 8  # of PX4: the receiver goes on from its last fix
_HECTOPASCAL = 2000.0  # below it a pressure is in hPa: no air weighs more or, in Pa, less
_TRUTH_GAP = 0.2  # s: across a longer one the truth is not interpolated


def gps_tracks(topics: Topics, notes: list[str]) -> tuple[GpsTrack, ...]:
    """Each receiver that ever had a fix; the selected one first. What is left out is added to the notes."""
    tracks = []
    for instance, name, topic in _sensors(topics, "vehicle_gps_position", "sensor_gps", "device_id", "device_id"):
        track = _gps(topic, name, instance, notes)
        if not len(track):
            notes.append(f"{name} left out: it never has a fix")
        elif not is_frozen(track, notes):
            tracks.append(track)
    return tuple(tracks)


def _gps(topic: Topic, name: str, instance: int, notes: list[str]) -> GpsTrack:
    """vehicle_gps_position and sensor_gps are one message. Before PX4 1.14 its position is in integers."""
    t = sampled(topic)
    if "latitude_deg" in topic:
        place = columns(topic, "latitude_deg", "longitude_deg", "altitude_msl_m")
        place[:, :2] *= SI["deg"]
    else:
        place = columns(topic, "lat", "lon", "alt") * (SI["degE7"], SI["degE7"], SI["mm"])
    fix = column(topic, "fix_type")
    fix[fix == _EXTRAPOLATED] = 1.0
    nowhere = ~(np.abs(place[:, 0]) < POLE) | ((place[:, 0] == 0.0) & (place[:, 1] == 0.0))
    place[nowhere | ~(fix >= _FIX_2D)] = np.nan
    place[~(fix >= _FIX_3D), 2] = np.nan
    velocity = columns(topic, "vel_n_m_s", "vel_e_m_s", "vel_d_m_s")
    flat = ~flag(topic, "vel_ned_valid")
    speed, course = column(topic, "vel_m_s")[flat], column(topic, "cog_rad")[flat]
    velocity[flat] = np.column_stack([speed * np.cos(course), speed * np.sin(course), np.full(len(speed), np.nan)])
    velocity[~(fix >= _FIX_2D)] = np.nan
    sigma = columns(topic, "eph", "epv", "s_variance_m_s")  # "variance" is what u-blox calls its 1σ accuracy
    sigma[~(sigma > 0.0)] = np.nan
    known = np.isfinite(fix) & (np.isfinite(velocity[:, :2]).all(axis=1) | np.isfinite(place[:, 0]) | (fix < _FIX_2D))
    keep = increasing(t, np.asarray(known & np.isfinite(place[:, 0]).any()))
    metres = np.column_stack([place[keep, 0], place[keep, 1] * np.cos(place[keep, 0])]) * SEMI_MAJOR_AXIS
    keep = np.arange(len(t))[keep][uncontradicted(name, notes, lone(metres), what="fix")]
    return GpsTrack(
        t[keep],
        latitude=place[keep, 0],
        longitude=place[keep, 1],
        height=place[keep, 2],
        velocity=velocity[keep],
        horizontal_sigma=sigma[keep, 0],
        vertical_sigma=sigma[keep, 1],
        speed_sigma=sigma[keep, 2],
        fix_type=fix[keep],
        satellites=column(topic, "satellites_used")[keep],
        source=name,
        instance=instance,
    )


def compass_tracks(topics: Topics, notes: list[str]) -> tuple[CompassTrack, ...]:
    """Each magnetometer; the selected one first. PX4 before 1.8 has it in sensor_combined."""
    tracks = []
    for instance, name, topic in _sensors(topics, "vehicle_magnetometer", "sensor_mag", "device_id", "device_id"):
        selected = "magnetometer_ga[0]" in topic
        field = xyz(topic, "magnetometer_ga") if selected else columns(topic, "x", "y", "z")
        tracks.append(_compass(sampled(topic), field, name, instance, notes, calibrated=selected))
    combined = topics.get("sensor_combined", {})
    if not tracks and "magnetometer_ga[0]" in combined and "magnetometer_timestamp_relative" in combined:
        t = _relative(combined, "magnetometer_timestamp_relative")
        tracks.append(_compass(t, xyz(combined, "magnetometer_ga"), "sensor_combined", 0, notes, calibrated=True))
    return tuple(track for track in tracks if not _is_silent(track, track.field, notes))


def _compass(t: Array, gauss: Array, name: str, instance: int, notes: list[str], *, calibrated: bool) -> CompassTrack:
    """Rows of zeros are no readings: the Earth's field is nowhere zero."""
    keep = increasing(t, np.isfinite(t) & np.isfinite(gauss).all(axis=1) & gauss.any(axis=1))
    t, field = t[keep], gauss[keep] * SI["gauss"]
    kept = uncontradicted(f"{name} (magnetometer)", notes, lone_fields(t, field))
    return CompassTrack(t[kept], field[kept], source=name, instance=instance, calibrated=calibrated)


def barometer_tracks(topics: Topics, notes: list[str]) -> tuple[BarometerTrack, ...]:
    """Each barometer; the selected one first. PX4 before 1.8 has its altitude in sensor_combined."""
    tracks = []
    for instance, name, topic in _sensors(topics, "vehicle_air_data", "sensor_baro", "baro_device_id", "device_id"):
        if "baro_pressure_pa" in topic:
            pressure, altitude = column(topic, "baro_pressure_pa"), column(topic, "baro_alt_meter")
            warm = column(topic, "ambient_temperature" if "ambient_temperature" in topic else "baro_temp_celcius")
        else:
            pressure, altitude, warm = (column(topic, of) for of in ("pressure", "altitude", "temperature"))
            if np.isfinite(pressure).any() and np.nanmedian(pressure) < _HECTOPASCAL:  # before PX4 1.14
                pressure *= SI["hPa"]
        tracks.append(_barometer(sampled(topic), pressure, altitude, warm, name, instance, notes))
    combined = topics.get("sensor_combined", {})
    if not tracks and "baro_alt_meter" in combined and "baro_timestamp_relative" in combined:
        altitude, warm = column(combined, "baro_alt_meter"), column(combined, "baro_temp_celcius")
        t = _relative(combined, "baro_timestamp_relative")
        tracks.append(_barometer(t, np.full(len(t), np.nan), altitude, warm, "sensor_combined", 0, notes))
    return tuple(track for track in tracks if not _is_silent(track, track.altitude, notes))


def _barometer(
    t: Array, pressure: Array, altitude: Array, warm: Array, name: str, instance: int, notes: list[str]
) -> BarometerTrack:
    """Rows without a pressure or, where no row has one, without an altitude are no readings."""
    pressure = np.where(pressure > 0.0, pressure, np.nan)
    if np.isnan(altitude).all():
        altitude = pressure_altitude(pressure)
    weighed = np.isfinite(pressure).any()
    good = np.isfinite(pressure if weighed else altitude) & np.isfinite(t)
    keep = increasing(t, good & bool(weighed or altitude.any()))
    t, pressure, altitude, warm = t[keep], pressure[keep], altitude[keep], warm[keep]
    kept = uncontradicted(f"{name} (barometer)", notes, *lone_air(pressure, altitude))
    return BarometerTrack(t[kept], pressure[kept], altitude[kept], warm[kept], source=name, instance=instance)


def _is_silent(track: CompassTrack | BarometerTrack, values: Array, notes: list[str]) -> bool:
    """No readings but zeros, or all the same: even at rest those of a sensor differ."""
    if not len(track):
        notes.append(f"{track.source} left out: it has no readings, or zeros only")
        return True
    return is_constant(track.source, values, notes)


def truth(topics: Topics, origin: Origin | None) -> TruthTrack | None:
    """The simulator's attitude, with its velocity and position interpolated to the attitude's times.

    Position by the cubic of position and velocity, about `origin` where both know their place on Earth; NaN where the
    log does not tell it.
    """
    if "vehicle_attitude_groundtruth" not in topics:
        return None
    topic = topics["vehicle_attitude_groundtruth"]
    t, q = sampled(topic), columns(topic, *(f"q[{i}]" for i in range(4)))
    keep = increasing(t, np.isfinite(q).all(axis=1) & (np.abs(np.linalg.norm(q, axis=1) - 1.0) < 0.1))
    t, q = t[keep], q[keep]
    velocity, position = np.full((len(t), 3), np.nan), np.full((len(t), 3), np.nan)
    place = topics.get("vehicle_local_position_groundtruth")
    if place is not None and len(t):
        velocity, position = _moved(t, place, origin)
    if not len(t):
        return None
    return TruthTrack(t, continuous(q), velocity, position, "vehicle_attitude_groundtruth", _faults(topics))


def _faults(topics: Topics) -> tuple[float, ...]:
    """When RflyMAD's simulator switched a fault on: `id` of rfly_ctrl_lxl is 0 without one (arXiv 2311.11340)."""
    topic = topics.get("rfly_ctrl_lxl")
    if topic is None or "id" not in topic:
        return ()
    on = np.flatnonzero(np.diff((column(topic, "id") != 0.0).astype(np.int8), prepend=0) > 0)
    return tuple(seconds(topic)[on].tolist())


def _moved(t: Array, topic: Topic, origin: Origin | None) -> tuple[Array, Array]:
    """Velocity and position (N, 3) at times t (N,)."""
    own, at = sampled(topic), columns(topic, "x", "y", "z")
    speed = columns(topic, "vx", "vy", "vz")
    zero = columns(topic, "ref_lat", "ref_lon", "ref_alt")
    known = np.flatnonzero(np.isfinite(zero).all(axis=1) & zero[:, :2].any(axis=1))
    if origin is not None and len(known):
        latitude, longitude, height = zero[known[0]]
        there = geodetic_from_ned(at, (np.radians(latitude), np.radians(longitude), height))
        at = ned_from_geodetic(
            there[:, 0], there[:, 1], there[:, 2], (origin.latitude, origin.longitude, origin.height)
        )
    keep = increasing(own, finite(at, speed))
    own, at, speed = own[keep], at[keep], speed[keep]
    if len(own) < 2:
        return np.full((len(t), 3), np.nan), np.full((len(t), 3), np.nan)
    i = np.clip(np.searchsorted(own, t) - 1, 0, len(own) - 2)
    h = (own[i + 1] - own[i])[:, None]
    u = (t[:, None] - own[i][:, None]) / h
    gap = (u < 0.0) | (u > 1.0) | (h > _TRUTH_GAP)
    velocity = speed[i] + u * (speed[i + 1] - speed[i])
    position = (
        (1 + 2 * u) * (1 - u) ** 2 * at[i] + u * (1 - u) ** 2 * h * speed[i]
        + u * u * (3 - 2 * u) * at[i + 1] + u * u * (u - 1) * h * speed[i + 1]
    )  # fmt: skip
    return np.where(gap, np.nan, velocity), np.where(gap, np.nan, position)


def _sensors(
    topics: Topics, selected: str, driver: str, selected_id: str, driver_id: str
) -> Iterator[tuple[int, str, Topic]]:
    """The selected sensors, then drivers' topics of others: of a device that no selected topic speaks of."""
    devices: set[int] = set()
    any_selected = False
    for instance, name, topic in instances(topics, selected):
        any_selected = True
        devices |= set(np.unique(device_ids(topic, selected_id)).tolist())
        yield instance, name, topic
    for instance, name, topic in instances(topics, driver):
        own = set(np.unique(device_ids(topic, driver_id)).tolist())
        told = 0 not in devices | own  # without ids the driver may be the selected one
        if not any_selected or (told and not own & devices):
            yield instance, name, topic


def _relative(topic: Topic, field: str) -> Array:
    """Times that sensor_combined tells as an offset from its own; NaN where there is no reading (2³¹ - 1 µs)."""
    offset = np.asarray(topic[field], np.float64) * 1e-6
    return np.where(np.abs(offset) < LONGEST_WAIT_S, seconds(topic) + offset, np.nan)
