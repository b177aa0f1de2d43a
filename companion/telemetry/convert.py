"""Message columns → tracks: SI units, FRD and NED, boot time. The one place where units are converted.

Factors come from the units that the dialect states. What each message really carries, and in which frame, is
ArduPilot's `GCS_MAVLink/GCS_Common.cpp` and PX4's `modules/mavlink/streams/`; docs/messages.md has the details.

Also here: a boot's MAVLink messages → the series of its sensors, by the rows of `sources`; and the estimates that
ArduPilot sends beside the one that flies: AHRS2, DCM while an EKF flies, and AHRS3.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import TypeVar

import numpy as np

from companion.mavlink import Messages
from companion.model import (
    IMU_MESSAGES,
    STANDARD_GRAVITY,
    Array,
    AttitudeTrack,
    BiasTrack,
    BoolArray,
    EstimatorLane,
    ImuTrack,
    Origin,
    ParameterChange,
    PositionTrack,
    Series,
    Vehicle,
    from_euler,
    median,
    ned_from_geodetic,
    of_kind,
)
from companion.telemetry import samples
from companion.telemetry.parameters import known_ranges, out_of_range, possible, with_facts
from companion.telemetry.sources import (
    MESSAGE_SOURCES,
    SI,
    VIBRATION_PX4,
    Raw,
    RawSeries,
    Source,
    raw_series,
    series_of,
)

SENSOR_MESSAGES = frozenset(row.name for row in MESSAGE_SOURCES)
"""Messages that become series."""


_NO_CELL = 65535  # BATTERY_STATUS.voltages
_MOST_SENSORS = 64  # of a message, that are looked at: 65,536 ids can be made up
_UNITS_ARDUPILOT = {"raw_press": "Pa"}  # AIRSPEED: get_differential_pressure() as it is (`send_airspeed`)


def message_sensors(messages: Mapping[str, Messages], notes: list[str], *, px4: bool) -> Mapping[str, Series]:
    """The series in a boot's messages, at their boot times. px4: the autopilot is one.

    What is left out is added to the notes.
    """
    rows = (replace(row, fields=VIBRATION_PX4) if px4 and row.kind == "vibration" else row for row in MESSAGE_SOURCES)
    units = {} if px4 else _UNITS_ARDUPILOT
    return series_of(
        one for row in rows if row.name in messages for one in _of_messages(row, messages[row.name], units, notes)
    )


def _of_messages(
    row: Source, messages: Messages, units: Mapping[str, str], notes: list[str]
) -> Iterator[RawSeries | None]:
    """Of each sensor that the message tells apart, or of those with the most messages; see `_MOST_SENSORS`."""
    if not row.by or not len(messages):
        yield _raw_series(row, messages, None, units, notes)
        return
    ids = np.column_stack([messages[name] for name in row.by])
    _, which, counts = np.unique(ids, axis=0, return_inverse=True, return_counts=True)
    which = which.ravel()
    if (left_out := len(counts) - _MOST_SENSORS) > 0:
        notes.append(f"{messages.name} speaks of {len(counts)} sensors: the {left_out} with the fewest are left out")
    kept = np.sort(np.argsort(-counts, kind="stable")[:_MOST_SENSORS])
    for number, own in enumerate(kept.tolist()):
        several = number if len(kept) > 1 else None
        yield _raw_series(row, messages.select(np.asarray(which == own)), several, units, notes)


def _raw_series(
    row: Source, messages: Messages, number: int | None, units: Mapping[str, str], notes: list[str]
) -> RawSeries | None:
    """units: of fields that are sent in others than the dialect states."""

    def column(field: str) -> Raw | None:
        name, _, place = field.partition("[")
        if name not in messages.layout.fields:
            return None
        if place == "]":  # of cells in series, those that are there: all together
            return np.asarray(np.where(messages[name] == _NO_CELL, 0.0, messages[name]).sum(axis=1))
        return messages[name][:, int(place[:-1])] if place else messages[name]

    name = messages.name if number is None else f"{messages.name}[{number}]"
    instance = row.instance + (number or 0)
    units = {**messages.layout.units, **units}
    return raw_series(row, name, messages.t, column, units, instance=instance, notes=notes)


def imu(
    messages: Messages,
    vehicle: Vehicle,
    parameters: Mapping[str, float],
    turns: Turns,
    notes: list[str],
    *,
    dequantise: bool = False,
) -> ImuTrack | None:
    """Samples of an IMU message in the frame of the attitude. What is left out is noted.

    Integer readings are cut towards zero by the autopilot, so a reading k stands for [k, k+1) steps: `dequantise` adds
    half a step away from zero to readings that are not zero. None for a stream that is zero throughout: ArduPilot sends
    SCALED_IMU2/3 so for an instance that has only a compass.
    """
    name = messages.name
    gyro, gyro_step = _vector(messages, ("xgyro", "ygyro", "zgyro"), "mrad/s", dequantise)
    accel, accel_step = _vector(messages, ("xacc", "yacc", "zacc"), "mG", dequantise)
    if not gyro.any() and not accel.any():
        notes.append(f"{name} is zero throughout: the vehicle has no such IMU")
        return None
    good, instance = np.ones(len(messages), np.bool_), IMU_MESSAGES[name].instance
    if name == "HIGHRES_IMU":
        ids = messages["id"]
        instance = samples.commonest(ids)
        if not (mine := ids == instance).all():
            good &= mine
            notes.append(f"{name} speaks of IMUs {np.unique(ids).tolist()}: only IMU {instance} is used")
    # 16 bits of mrad/s and mG hold nothing that a part cannot read
    ranges = None if gyro_step else known_ranges(vehicle, parameters, instance)
    track = replace(
        samples.imu_track(name, messages.t, gyro, accel, good, notes, ranges),
        gyro_step=gyro_step,
        accel_step=accel_step,
        instance=instance,
        t_step=1e-3 if "time_boot_ms" in messages.layout.fields else 0.0,
    )
    if len(track):
        some = track.accel[:: max(1, len(track) // 1000)]
        weight = math.sqrt(median(np.einsum("ij,ij->i", some, some))) / STANDARD_GRAVITY
        if not 0.5 < weight < 2.0:
            notes.append(f"{name}: the median specific force is {weight:.2f} g; its scale is not what the message says")
    return turned(with_facts(track, vehicle, parameters), turns)


Turns = tuple[tuple[float, Array | None], ...]
"""From when on (s), and the rotation (3, 3) from then on; None for none. In order of time, the first from -inf."""

UNTURNED: Turns = ((-np.inf, None),)
_TRIM = ("AHRS_TRIM_X", "AHRS_TRIM_Y")


def trim(parameters: Mapping[str, float]) -> tuple[float, float] | None:
    """Roll and pitch of AHRS_TRIM, rad; None where there is none."""
    roll, pitch = (parameters.get(name, 0.0) for name in _TRIM)
    return (roll, pitch) if np.isfinite([roll, pitch]).all() and (roll or pitch) else None


Trims = tuple[tuple[float, tuple[float, float] | None], ...]
"""From when on (s), and roll and pitch of AHRS_TRIM, rad, from then on; None for none. The first from -inf."""


def trims(parameters: Mapping[str, float], changes: Iterable[ParameterChange] = ()) -> Trims:
    """parameters: at the beginning. A trim that is set in flight holds from then on."""
    known = dict(parameters)
    several = [(-np.inf, trim(known))]
    for change in changes if not known.keys().isdisjoint(_TRIM) else ():  # they are not looked for in vain
        if change.name in _TRIM:
            known[change.name] = change.value
            several.append((change.t, trim(known)))
    return tuple(several)


def turns(parameters: Mapping[str, float], notes: list[str], changes: Iterable[ParameterChange] = ()) -> Turns:
    """The rotations of an IMU into the frame that ATTITUDE speaks of, noted; parameters: at the beginning.

    ArduPilot subtracts AHRS_TRIM from the attitude that it sends, but not from the IMU: both gyro and accelerometer are
    turned by R = from_euler(AHRS_TRIM_X, AHRS_TRIM_Y, 0). With a trim of 0.05/-0.06 rad: 39 m after 10 s without it,
    1.2 m with it. A trim that is set in flight holds from then on.
    """
    several = trims(parameters, changes)
    for t, (roll, pitch) in ((t, one) for t, one in several if one is not None):
        since = f" from {t:.1f} s on" if t > -np.inf else ""
        notes.append(f"AHRS_TRIM ({roll:+.4f}, {pitch:+.4f}) rad applied to the IMUs{since}")
    return tuple((t, None if one is None else euler_matrix(*one, 0.0)) for t, one in several)


def euler_matrix(roll: float, pitch: float, yaw: float) -> Array:
    """(3, 3) by Euler angles, rad, yaw last."""
    (cr, cp, cy), (sr, sp, sy) = (of([roll, pitch, yaw]) for of in (np.cos, np.sin))
    return np.array([
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ])  # fmt: skip


Sensed = TypeVar("Sensed", ImuTrack, BiasTrack)


def turned(track: Sensed, turns: Turns) -> Sensed:
    """The track with every sample turned by the rotation of its time."""
    if all(turn is None for _, turn in turns):
        return track
    gyro, accel = (turned_vectors(track.t, vectors, turns) for vectors in (track.gyro, track.accel))
    return replace(track, gyro=gyro, accel=accel)


def turned_vectors(t: Array, vectors: Array, turns: Turns) -> Array:
    """Vectors (N, 3) at times (N,), each turned by the rotation of its time."""
    if len(turns) == 1:
        return vectors if turns[0][1] is None else np.asarray(vectors @ turns[0][1].T)
    out = vectors.copy()
    for now, turn in in_force(t, turns):
        if turn is not None:
            out[now] = vectors[now] @ turn.T
    return out


Setting = TypeVar("Setting")


def in_force(t: Array, settings: Sequence[tuple[float, Setting]]) -> Iterator[tuple[BoolArray, Setting]]:
    """Which of times t (N,) s each of several settings holds at, where it does; from when on and what, in order."""
    ends = (*(begin for begin, _ in settings[1:]), np.inf)
    for (begin, setting), end in zip(settings, ends, strict=False):  # of none there is no end
        now = (t >= begin) & (t < end)
        if now.any():
            yield now, setting


_PITCH_TRIMS = {"PTCH_TRIM_DEG": SI["deg"], "TRIM_PITCH_CD": SI["cdeg"]}  # since ArduPlane 4.5, and before
_TRIM_NOT_TAKEN_OFF = 1 << 8  # FLIGHT_OPTIONS: GCS_REMOVE_TRIM_PITCH


def pitch_trim(vehicle: Vehicle, parameters: Mapping[str, float]) -> float:
    """rad, by which the pitch in ATTITUDE is less than the plane's (ArduPlane `GCS_Mavlink.cpp`, send_attitude).

    That of a plane that takes off vertically is not in its vertical modes, and so is taken as it is.
    """
    vertical = parameters.get("Q_ENABLE", 0.0) != 0.0
    if vehicle.autopilot != "ARDUPILOTMEGA" or vehicle.type != "FIXED_WING" or vertical:
        return 0.0
    known = [parameters[name] * unit for name, unit in _PITCH_TRIMS.items() if name in parameters]
    kept = int(parameters.get("FLIGHT_OPTIONS", 0.0)) & _TRIM_NOT_TAKEN_OFF
    return known[0] if known and not kept else 0.0


def attitude(messages: Messages, notes: list[str], trim_off: float = 0.0) -> AttitudeTrack | None:
    """ATTITUDE (Euler angles, rad) or ATTITUDE_QUATERNION as quaternions, with bias-corrected body rates.

    trim_off: the `pitch_trim`, which only the angles are without.
    """
    if "roll" in (messages.rows.dtype.names or ()):
        roll, pitch, yaw = messages.columns("roll", "pitch", "yaw").T
        if trim_off:
            lack = f"{np.degrees(trim_off):+.2f}°"
            notes.append(f"{messages.name}: its pitch lacks the trim of {lack} (PTCH_TRIM_DEG), which is added")
        q = from_euler(roll, pitch + trim_off, yaw)
    else:
        q = messages.columns("q1", "q2", "q3", "q4")
    keep, t, q = samples.attitudes(messages.t, q)
    rates = np.nan_to_num(messages.columns("rollspeed", "pitchspeed", "yawspeed")[keep])
    return samples.attitude_track(messages.name, t, q, rates, notes)


def position(messages: Messages, notes: list[str]) -> PositionTrack | None:
    """LOCAL_POSITION_NED as it is, or GLOBAL_POSITION_INT as NED about its first fix on the WGS-84 ellipsoid."""
    velocity, _ = _vector(messages, ("vx", "vy", "vz"), "m/s", dequantise=False)
    if messages.name == "LOCAL_POSITION_NED":
        return samples.position_track(messages.name, messages.t, messages.columns("x", "y", "z"), velocity, True, notes)
    good = (messages["lat"] != 0) | (messages["lon"] != 0)  # 0, 0 is "no fix" on every autopilot
    lat, lon, height = np.radians(messages["lat"] * 1e-7), np.radians(messages["lon"] * 1e-7), messages["alt"] * 1e-3
    first = int(np.argmax(good))
    ned = ned_from_geodetic(lat, lon, height, (float(lat[first]), float(lon[first]), float(height[first])))
    return samples.position_track(messages.name, messages.t, ned, velocity, good, notes)


_FIX_3D = 3
_GPS_HEIGHT_M = 50.0  # no receiver with a fix is off by more
_SAME_HEIGHT_M = 10.0  # of the zero of the positions, which an estimator may mend in flight by the barometer's drift


def _is_measured(messages: Messages, beside: Mapping[str, Messages]) -> BoolArray:
    """(N,) which places were: without a fix a receiver tells any; before its estimate has an origin ArduPilot does too.

    Then the height is not the receiver's, or that of the zero of LOCAL_POSITION_NED is not what it is later.
    """
    if messages.name == "GPS_RAW_INT":
        return np.asarray(messages["fix_type"] >= _FIX_3D)
    known = np.ones(len(messages), np.bool_)
    if messages.name != "GLOBAL_POSITION_INT" or (local := beside.get("LOCAL_POSITION_NED")) is None:
        return known
    height = messages["alt"] * 1e-3
    if (gps := beside.get("GPS_RAW_INT")) is not None and (fixed := gps["fix_type"] >= _FIX_3D).any():
        known = np.abs(height - np.interp(messages.t, gps.t[fixed], gps["alt"][fixed] * 1e-3)) < _GPS_HEIGHT_M
    if not known.any():
        return known
    zero = height + np.interp(messages.t, local.t, local["z"])
    return np.asarray(known & (np.abs(zero - zero[known][-1]) < _SAME_HEIGHT_M))


def origin(messages: Messages, beside: Mapping[str, Messages] = MappingProxyType({})) -> Origin | None:
    """Where GLOBAL_POSITION_INT, GPS_RAW_INT or GPS_GLOBAL_ORIGIN first says it was.

    None without a fix. GPS_GLOBAL_ORIGIN is where LOCAL_POSITION_NED is zero, wherever the vehicle is by then.
    """
    is_zero = messages.name == "GPS_GLOBAL_ORIGIN"
    names = ("latitude", "longitude", "altitude") if is_zero else ("lat", "lon", "alt")
    latitude, longitude, height = (messages[n] for n in names)
    fixed = np.flatnonzero(((latitude != 0) | (longitude != 0)) & _is_measured(messages, beside))
    if not len(fixed):
        return None
    i = fixed[0]
    return samples.place(
        latitude[i] * 1e-7, longitude[i] * 1e-7, height[i] * 1e-3, None if is_zero else float(messages.t[i])
    )


def home(messages: Messages) -> Origin:
    """Where the last HOME_POSITION is: home is set again where the vehicle arms."""
    latitude, longitude, height = (float(messages[n][-1]) for n in ("latitude", "longitude", "altitude"))
    return samples.place(latitude * 1e-7, longitude * 1e-7, height * 1e-3)


def ned_between(a: Origin, b: Origin) -> Array:
    """Where `b` lies seen from `a`: NED (3,), m."""
    return np.asarray(samples.ned_about(a, *np.array([[b.latitude], [b.longitude], [b.height]]))[0])


def parameter_values(messages: Messages, notes: list[str], *, bytewise: bool) -> Array:
    """What each PARAM_VALUE says, (N,); NaN for one that its type or its parameter cannot have, of which there is a
    note.

    `bytewise` (PX4): integers are sent as their bytes in the float.
    """
    values = messages["param_value"].astype(np.float64)
    if bytewise:
        integer = (messages["param_type"] >= 1) & (messages["param_type"] <= 6)  # MAV_PARAM_TYPE_UINT8 ... INT32
        raw = np.ascontiguousarray(messages["param_value"]).view(np.int32)
        values = np.where(integer, raw, values)
    known = possible(messages["param_id"].tolist(), values, notes)
    return np.where(out_of_range(values, messages["param_type"]), np.nan, known)


def _vector(messages: Messages, names: tuple[str, str, str], unit: str, dequantise: bool) -> tuple[Array, float]:
    """Three fields as SI (N, 3), and the quantisation step in SI (0 for floats). `unit` where the dialect has none."""
    factor = SI[messages.layout.units.get(names[0]) or unit]
    whole = np.issubdtype(messages[names[0]].dtype, np.integer)
    values = messages.columns(*names)
    if whole and dequantise:
        values += 0.5 * np.sign(values)
    values *= factor
    return values, factor if whole else 0.0


_NAMES = {"AHRS2": "second estimate", "AHRS3": "third estimate"}
"""Since ArduPilot 3.5 AHRS2 is DCM while an EKF flies (`AP_AHRS.cpp`, _get_secondary_EKF_type); before, another EKF."""


def message_lanes(series: Mapping[str, Series]) -> tuple[EstimatorLane, ...]:
    """Their attitudes: they have no velocity, and a position of latitude and longitude alone."""
    made = []
    for one in of_kind(series, "attitude"):
        if one.source in _NAMES:
            _, t, q = samples.attitudes(one.t, from_euler(one["roll_rad"], one["pitch_rad"], one["yaw_rad"]))
            unknown = np.full((len(t), 3), np.nan)
            made.append(EstimatorLane(t, q, unknown, unknown, _NAMES[one.source], None, one.source))
    return tuple(lane for lane in made if len(lane) > 1)
