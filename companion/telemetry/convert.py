"""Message columns → tracks: SI units, FRD and NED, boot time. The one place where units are converted.

Factors come from the units that the dialect states. What each message really carries, and in which frame, is
ArduPilot's `GCS_MAVLink/GCS_Common.cpp` and PX4's `modules/mavlink/streams/`; docs/messages.md has the details.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from companion.mavlink import Messages
from companion.model import (
    IMU_MESSAGES,
    STANDARD_GRAVITY,
    Array,
    AttitudeTrack,
    ImuTrack,
    Origin,
    ParameterChange,
    PositionTrack,
    counted,
    from_euler,
    median,
    ned_from_geodetic,
)
from companion.telemetry.outliers import Ranges, finite_rows, lone, lone_turns, readable, uncontradicted
from companion.telemetry.parameters import out_of_range, possible
from companion.telemetry.sanitize import words

SI = {
    "": 1.0,
    "mG": STANDARD_GRAVITY * 1e-3,
    "mrad/s": 1e-3,
    "m/s/s": 1.0,
    "rad/s": 1.0,
    "rad": 1.0,
    "m": 1.0,
    "m/s": 1.0,
    "cm/s": 1e-2,
    "cm": 1e-2,
    "mm": 1e-3,
    "mm/s": 1e-3,
    "Pa": 1.0,
    "hPa": 100.0,
    "degC": 1.0,  # temperatures stay in °C, as every data sheet has them
    "cdegC": 1e-2,
    "deg": float(np.radians(1.0)),
    "deglatitude": float(np.radians(1.0)),
    "deglongitude": float(np.radians(1.0)),
    "cdeg": float(np.radians(1e-2)),
    "degE7": float(np.radians(1e-7)),
    "gauss": 1e-4,  # tesla
    "Gauss": 1e-4,
    "mgauss": 1e-7,
    "hundredths": 1e-2,
}
"""Unit of MAVLink's dialects, of DataFlash's UNIT records or of PX4's topics → factor."""


_BLOCK = 8192  # samples


def imu_track(
    messages: Messages, t: Array, *, dequantise: bool = False, ranges: Ranges = (None, None)
) -> tuple[ImuTrack | None, list[str]]:
    """Samples of an IMU message at boot times t (N,) s, in its own body frame, and what had to be left out.

    Integer readings are cut towards zero by the autopilot, so a reading k stands for [k, k+1) steps: `dequantise` adds
    half a step away from zero to readings that are not zero. None for a stream that is zero throughout: ArduPilot sends
    SCALED_IMU2/3 so for an instance that has only a compass.
    """
    name, notes = messages.layout.name, []
    gyro, gyro_step = _vector(messages, ("xgyro", "ygyro", "zgyro"), "mrad/s", dequantise)
    accel, accel_step = _vector(messages, ("xacc", "yacc", "zacc"), "mG", dequantise)
    if not gyro.any() and not accel.any():
        return None, [f"{name} is zero throughout: the vehicle has no such IMU"]
    good = np.isfinite(t)
    if not gyro_step:  # 16 bits of mrad/s and mG hold nothing else
        good &= readable(gyro, accel, ranges)
    instance = IMU_MESSAGES[name].instance
    if name == "HIGHRES_IMU":
        ids = messages["id"]
        instance = int(ids[0])
        if (ids != instance).any():
            several, counts = np.unique(ids, return_counts=True)
            instance = int(several[np.argmax(counts)])
            good &= ids == instance
            notes.append(f"{name} speaks of IMUs {several.tolist()}: only IMU {instance} is used")
    keep = increasing(t, good)
    if dropped := int((~good).sum()):
        notes.append(f"{name}: {counted(dropped, 'sample')} left out as no reading or of another IMU")
    track = ImuTrack(
        t[keep],
        gyro[keep],
        accel[keep],
        source=name,
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
    return track, notes


_TRIM = ("AHRS_TRIM_X", "AHRS_TRIM_Y")

Turns = tuple[tuple[float, Array | None], ...]
"""From when on (s), and the rotation (3, 3) from then on; None for none. In order of time, the first from -inf."""

UNTURNED: Turns = ((-np.inf, None),)


def turns(parameters: Mapping[str, float], changes: Iterable[ParameterChange]) -> tuple[Turns, list[str]]:
    """The rotations of an IMU into the frame that ATTITUDE speaks of, and notes; parameters: at the beginning.

    ArduPilot subtracts AHRS_TRIM from the attitude that it sends, but not from the IMU: both gyro and accelerometer are
    turned by R = from_euler(AHRS_TRIM_X, AHRS_TRIM_Y, 0). With a trim of 0.05/-0.06 rad: 39 m after 10 s without it,
    1.2 m with it. A trim that is set in flight holds from then on.
    """
    known = dict(parameters)
    trims = [(-np.inf, trim(known))]
    for change in changes if not known.keys().isdisjoint(_TRIM) else ():  # they are not looked for in vain
        if change.name in _TRIM:
            known[change.name] = change.value
            trims.append((change.t, trim(known)))
    notes = [f"{one[1]}{f' from {t:.1f} s on' if t > -np.inf else ''}" for t, one in trims if one is not None]
    return tuple((t, None if one is None else one[0]) for t, one in trims), notes


def trim(parameters: Mapping[str, float]) -> tuple[Array, str] | None:
    """The rotation (3, 3) of one trim, and a note; None where there is none."""
    roll, pitch = parameters.get("AHRS_TRIM_X", 0.0), parameters.get("AHRS_TRIM_Y", 0.0)
    if not np.isfinite([roll, pitch]).all() or (roll == 0.0 and pitch == 0.0):
        return None
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    turn = np.array([[cp, sp * sr, sp * cr], [0.0, cr, -sr], [-sp, cp * sr, cp * cr]])
    return turn, f"AHRS_TRIM ({roll:+.4f}, {pitch:+.4f}) rad applied to the IMUs"


def turned(track: ImuTrack, turn: Array) -> ImuTrack:
    """The track in a frame that is turned by (3, 3)."""
    return replace(track, gyro=track.gyro @ turn.T, accel=track.accel @ turn.T)


def turned_in_time(track: ImuTrack, turns: Turns) -> ImuTrack:
    """The track with every sample turned by the rotation of its time."""
    if all(turn is None for _, turn in turns):
        return track
    gyro, accel = (turned_vectors(track.t, vectors, turns) for vectors in (track.gyro, track.accel))
    return replace(track, gyro=gyro, accel=accel)


def turned_vectors(t: Array, vectors: Array, turns: Turns) -> Array:
    """Vectors (N, 3) at times (N,), each turned by the rotation of its time."""
    if all(turn is None for _, turn in turns):
        return vectors
    if len(turns) == 1 and turns[0][1] is not None:
        return np.asarray(vectors @ turns[0][1].T)
    out = vectors.copy()
    for (begin, turn), (end, _) in pairwise((*turns, (np.inf, None))):
        now = (t >= begin) & (t < end)
        if turn is not None:
            out[now] = vectors[now] @ turn.T
    return out


def attitude_track(messages: Messages, t: Array) -> tuple[AttitudeTrack, list[str]]:
    """ATTITUDE (Euler angles, rad) or ATTITUDE_QUATERNION as quaternions, with bias-corrected body rates; and notes."""
    if "roll" in (messages.rows.dtype.names or ()):
        q = q_from_euler(*(np.asarray(messages[n], np.float64) for n in ("roll", "pitch", "yaw")))
    else:
        q = _columns(messages, "q1", "q2", "q3", "q4")
    norm = np.sqrt(np.einsum("ij,ij->i", q, q))
    rates = _columns(messages, "rollspeed", "pitchspeed", "yawspeed")
    good = np.isfinite(t) & (np.abs(norm - 1.0) < 0.1)  # which no NaN is
    keep = increasing(t, good)
    t, q, rates = t[keep], continuous(q[keep], norm[keep]), rates[keep]
    if not np.isfinite(rates).all():
        rates = np.nan_to_num(rates)
    notes: list[str] = []
    kept = uncontradicted(messages.name, notes, lone_turns(t, q, rates))
    if notes:
        t, q, rates = t[kept], continuous(q[kept]), rates[kept]
    return AttitudeTrack(t, q, rates, source=messages.layout.name), notes


def position_track(messages: Messages, t: Array) -> tuple[PositionTrack, list[str]]:
    """LOCAL_POSITION_NED as it is, or GLOBAL_POSITION_INT as NED about its first fix on the WGS-84 ellipsoid; notes."""
    if messages.layout.name == "LOCAL_POSITION_NED":
        position = _columns(messages, "x", "y", "z")
        good = np.ones(len(t), np.bool_)
    else:
        lat, lon = (np.radians(messages[n] * 1e-7) for n in ("lat", "lon"))
        good = (messages["lat"] != 0) | (messages["lon"] != 0)  # 0, 0 is "no fix" on every autopilot
        first = int(np.argmax(good))
        height = messages["alt"] * 1e-3
        position = ned_from_geodetic(lat, lon, height, (float(lat[first]), float(lon[first]), float(height[first])))
    velocity, _ = _vector(messages, ("vx", "vy", "vz"), "m/s", dequantise=False)
    good &= finite_rows(position, velocity) & np.isfinite(t)
    keep = increasing(t, good)
    t, position, velocity = t[keep], position[keep], velocity[keep]
    notes: list[str] = []
    kept = uncontradicted(messages.name, notes, lone(position), lone(velocity))
    if notes:
        t, position, velocity = t[kept], position[kept], velocity[kept]
    return PositionTrack(t, position, velocity, source=messages.name), notes


def origin(messages: Messages, t: Array) -> Origin | None:
    """Where GLOBAL_POSITION_INT, GPS_RAW_INT or GPS_GLOBAL_ORIGIN, at times t (N,), first says it was.

    None without a fix. GPS_GLOBAL_ORIGIN is where LOCAL_POSITION_NED is zero, wherever the vehicle is by then.
    """
    is_zero = messages.layout.name == "GPS_GLOBAL_ORIGIN"
    names = ("latitude", "longitude", "altitude") if is_zero else ("lat", "lon", "alt")
    latitude, longitude, height = (messages[n] for n in names)
    fixed = np.flatnonzero((latitude != 0) | (longitude != 0))
    if not len(fixed):
        return None
    i = fixed[0]
    return Origin(
        float(np.radians(latitude[i] * 1e-7)),
        float(np.radians(longitude[i] * 1e-7)),
        float(height[i] * 1e-3),
        None if is_zero else float(t[i]),
    )


def home(messages: Messages) -> Origin:
    """Where the last HOME_POSITION is: home is set again where the vehicle arms."""
    latitude, longitude, height = (float(messages[n][-1]) for n in ("latitude", "longitude", "altitude"))
    return Origin(float(np.radians(latitude * 1e-7)), float(np.radians(longitude * 1e-7)), height * 1e-3)


def ned_between(a: Origin, b: Origin) -> Array:
    """Where `b` lies seen from `a`: NED (3,), m."""
    there = (np.array([b.latitude]), np.array([b.longitude]), np.array([b.height]))
    return np.asarray(ned_from_geodetic(*there, (a.latitude, a.longitude, a.height))[0])


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
    told = possible(messages["param_id"].tolist(), values, notes)
    return np.where(out_of_range(values, messages["param_type"]), np.nan, told)


def parameters(messages: Messages, values: Array, *, first: bool = False) -> dict[str, float]:
    """The last value of every parameter that has one, or the first; values: (N,) of `parameter_values`."""
    told = np.flatnonzero(~np.isnan(values))[:: -1 if first else 1]
    last = dict(zip(messages["param_id"][told].tolist(), told.tolist(), strict=True))  # sent many times: decoded once
    return {words(name): float(values[i]) for name, i in sorted(last.items(), key=lambda item: item[1])}


def increasing(t: Array, good: npt.NDArray[np.bool_]) -> npt.NDArray[np.int64] | slice:
    """The good samples in order of device time, the first of those that share one: echoes fall out.

    Indices, or where nothing is to be done a slice, so that nothing is copied.
    """
    if good.all() and (t[1:] > t[:-1]).all():
        return slice(None)
    index = np.flatnonzero(good)
    order = index[np.argsort(t[index], kind="stable")]
    return order[np.diff(t[order], prepend=-np.inf) > 0]


def continuous(q: Array, norm: Array | None = None) -> Array:
    """Quaternions (N, 4) of about unit length, made so, with the sign that follows on: q and -q are one attitude.

    norm: (N,) the lengths, where they are known.
    """
    q = q / (np.sqrt(np.einsum("ij,ij->i", q, q)) if norm is None else norm)[:, None]
    turned_over = np.einsum("ij,ij->i", q[1:], q[:-1]) < 0
    if turned_over.any():
        q[1:] *= np.where(np.cumsum(turned_over) % 2, -1.0, 1.0)[:, None]
    return np.asarray(q)


def _columns(messages: Messages, *names: str) -> Array:
    """Fields side by side, (N, k)."""
    side_by_side = np.empty((len(messages), len(names)))
    for i, name in enumerate(names):
        side_by_side[:, i] = messages[name]
    return side_by_side


def _vector(messages: Messages, names: tuple[str, str, str], unit: str, dequantise: bool) -> tuple[Array, float]:
    """Three fields as SI (N, 3), and the quantisation step in SI (0 for floats). `unit` where the dialect has none."""
    factor = SI[messages.layout.units.get(names[0]) or unit]
    whole = np.issubdtype(messages[names[0]].dtype, np.integer)
    values = _columns(messages, *names)
    if whole and dequantise:
        values += 0.5 * np.sign(values)
    values *= factor
    return values, factor if whole else 0.0


def q_from_euler(roll: Array, pitch: Array, yaw: Array) -> Array:
    """Aerospace Euler angles (yaw, then pitch, then roll) to q_ned_frd, wxyz. Never used inside: messages only."""
    q = np.empty((len(roll), 4))
    for begin in range(0, len(roll), _BLOCK):  # what lies in between stays in cache
        block = slice(begin, begin + _BLOCK)
        q[block] = from_euler(roll[block], pitch[block], yaw[block])
    return q
