"""Series of any format → typed tracks of the sensors that aid an IMU.

What the fields of a format mean, their units and what stands for "not known" is settled in the series
(`companion.telemetry.sources`): a row there with these columns is all that a format needs to have the track.

Also here: what an estimator itself says that it knows: its position counts where it calls it valid.

ESTIMATOR_STATUS_FLAGS and EKF_STATUS_FLAGS (MAVLink common.xml, ardupilotmega.xml) and the solution status of
ArduPilot's records (nav_filter_status in `AP_NavEKF/AP_Nav_Common.h`) have the same bits. PX4 sends LOCAL_POSITION_NED
all the same, and ArduPilot until it stops aiding, 8 s after it has lost its position.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np

from companion.model import (
    PITCH_270,
    AirspeedTrack,
    Array,
    BarometerTrack,
    CompassTrack,
    FlowTrack,
    GpsTrack,
    PositionTrack,
    RangeTrack,
    Series,
    counted,
    of_kind,
    rows,
)
from companion.telemetry.convert import UNTURNED, Turns, turned_vectors
from companion.telemetry.samples import HEIGHT, BoolArray, lone, lone_fields, uncontradicted
from companion.telemetry.sources import ANGLES_OF_FLOW, COLUMNS, SIGMAS, Lazy, LazyTuple, pressure_altitude

_POSITION = 0b11000  # horizontal position, relative or absolute


def has_position(t: Array, reported: Array, flags: Array) -> BoolArray:
    """(N,) whether the horizontal position is valid at times t (N,) s, by flags (M,) reported at times (M,).

    The flags hold until the next; the first also before. Flags that are not known say nothing.
    """
    known = np.isfinite(reported) & np.isfinite(flags)
    reported, flags = reported[known], flags[known]
    if not len(reported):
        return np.ones(len(t), np.bool_)
    last = np.maximum(np.searchsorted(reported, t, side="right") - 1, 0)
    return np.asarray((flags[last].astype(np.int64) & _POSITION) != 0)


def valid_position(track: PositionTrack | None, status: Series | None, notes: list[str]) -> PositionTrack | None:
    """The position where the estimator's status calls it valid; None where it does for fewer than two samples."""
    if track is None or status is None or "flags" not in status.columns:
        return track
    valid = has_position(track.t, status.t, status["flags"])
    if valid.all():
        return track
    lost = f"{np.count_nonzero(~valid)} of {len(track)}"
    notes.append(f"{track.source}: {lost} samples left out: {status.source} says that the position is not valid")
    kept = rows(track, valid)
    return kept if len(kept) > 1 else None


_Track = GpsTrack | CompassTrack | BarometerTrack | AirspeedTrack | RangeTrack | FlowTrack
_Maker = Callable[[Series, list[str]], _Track | None]

_EARTH_M = 6.4e6
_CONSTANT = 20  # readings that are all the same are those of no sensor: even at rest they differ by a step
_GOOD = 4.0  # RFND.Stat: RangeFinder::Status::Good
_GUST = 30.0  # m/s: an airspeed that is off by as much for one sample is damage
_CENTIMETRE = 0.01  # m, to which DISTANCE_SENSOR is cut: a reading at the end of the range is within it


def aiding_tracks(
    series: Mapping[str, Series], notes: Iterable[str], turns: Turns = UNTURNED, apart: Collection[str] = ()
) -> dict[str, Any]:
    """The fields of a `Flight` that its series tell: tracks in order of instance, and the notes with what is left out.

    gps: every receiver that ever had a fix; airspeeds: one that tells pressure alone where no other message tells the
    speed; compasses, barometers, ranges, flows: every one. Each kind is made when it or the notes are first looked
    into. turns: into the frame of the IMU tracks, where that is not the compass's. apart: kinds of which every series
    is of a sensor of its own, whatever its instance.
    """
    makers: dict[str, tuple[str, _Maker]] = {
        "gps": ("gps", _gps_track),
        "compasses": ("magnetometer", partial(_compass_track, turns=turns)),
        "barometers": ("barometer", _barometer_track),
        "airspeeds": ("airspeed", _airspeed_track),
        "ranges": ("range", _range_track),
        "flows": ("flow", _flow_track),
    }
    made = Lazy({
        name: partial(_made, of_kind(series, kind), make, apart=kind in apart) for name, (kind, make) in makers.items()
    })  # fmt: skip
    before = tuple(notes)
    tracks = {name: LazyTuple(lambda name=name: made[name][0]) for name in makers}  # type: ignore[misc]
    return {**tracks, "notes": LazyTuple(lambda: (*before, *(note for _, own in made.values() for note in own)))}


def _made(several: Iterable[Series], make: _Maker, *, apart: bool) -> tuple[tuple[_Track, ...], list[str]]:
    """One track per instance, the best sampled of it: RAW_IMU and HIGHRES_IMU speak of the same compass; and notes."""
    notes: list[str] = []
    tracks = [track for one in several if (track := make(one, notes)) is not None and len(track)]
    if apart:
        return tuple(tracks), notes
    measuring = [one for one in tracks if not isinstance(one, AirspeedTrack) or np.isfinite(one.airspeed).any()]
    best: dict[int, _Track] = {}
    for track in measuring or tracks:
        if len(track) > len(best.get(track.instance, ())):
            best[track.instance] = track
    return tuple(best[instance] for instance in sorted(best)), notes


def _compass_track(one: Series, notes: list[str], *, turns: Turns) -> CompassTrack | None:
    if _is_constant(one, one.values, notes):
        return None
    nonzero = np.asarray(one.values.any(axis=1))
    if zeros := int((~nonzero).sum()):  # the Earth's field is nowhere zero
        notes.append(f"{one.source}: {counted(zeros, 'sample')} left out as magnetometer: all axes are zero")
        one = rows(one, nonzero)
    field = turned_vectors(one.t, one.values, turns)
    calibrated = not one.source.startswith("sensor_mag")  # of PX4: that is the driver's
    track = CompassTrack(one.t, field, one.source, one.instance, calibrated)
    return rows(track, uncontradicted(f"{one.source} (magnetometer)", notes, lone_fields(one.t, field)))


def _barometer_track(one: Series, notes: list[str]) -> BarometerTrack | None:
    column = "pressure_pa" if np.isfinite(one["pressure_pa"]).any() else "altitude_m"
    if _is_constant(one, one[column], notes):
        return None
    one = rows(one, ~(one["pressure_pa"] <= 0.0))
    heights = pressure_altitude(one["pressure_pa"]), one["altitude_m"]
    one = rows(one, uncontradicted(one.source, notes, *(lone(height[:, None], HEIGHT) for height in heights)))
    if not len(one):
        notes.append(f"{one.source} left out: its pressure is never above zero")
        return None
    pressure, altitude, warm = _copies(one, *COLUMNS["barometer"])
    return BarometerTrack(one.t, pressure, altitude, warm, one.source, one.instance)


def _gps_track(gps: Series, notes: list[str]) -> GpsTrack | None:
    if np.isnan(gps["lat_rad"]).all():
        notes.append(f"{gps.source} left out: it never has a fix")
        return None
    metres = np.column_stack([gps["lat_rad"], gps["lon_rad"] * np.cos(gps["lat_rad"])]) * _EARTH_M
    gps = rows(gps, uncontradicted(gps.source, notes, lone(metres), what="fix"))
    velocity = np.column_stack([gps[name] for name in ("vn_mps", "ve_mps", "vd_mps")])
    flat = np.isnan(velocity[:, :2]).any(axis=1)  # speed over ground and course: nothing about up and down
    speed, course = gps["speed_mps"][flat], gps["course_rad"][flat]
    velocity[flat, :2] = np.column_stack([speed * np.cos(course), speed * np.sin(course)])
    lat, lon, height, horizontal, vertical, speed, fix, satellites = _copies(
        gps, "lat_rad", "lon_rad", "height_m", *SIGMAS, "fix_type", "satellites"
    )
    fixes = np.column_stack([lat, lon, height, velocity, horizontal, vertical, speed])[np.isfinite(lat)]
    if len(fixes) >= _CONSTANT and bool(((fixes == fixes[:1]) | np.isnan(fixes)).all()):
        notes.append(f"{gps.source} left out: all of its {len(fixes)} fixes are the same")
        return None
    return GpsTrack(
        gps.t, lat, lon, height, velocity, horizontal, vertical, speed, fix, satellites, gps.source, gps.instance
    )


def _copies(one: Series, *names: str) -> list[Array]:
    """Columns (N,), NaN where the source has no such column."""
    return [one[name].copy() if name in one.columns else np.full(len(one), np.nan) for name in names]


def _is_constant(one: Series, values: Array, notes: list[str]) -> bool:
    """Whether all readings (N,) or (N, k) of a source are the same: even at rest those of a sensor differ."""
    constant = len(values) >= _CONSTANT and bool((values == values[:1]).all())
    if constant:
        notes.append(f"{one.source} left out: all of its {len(values)} readings are the same")
    return constant


def _airspeed_track(one: Series, notes: list[str]) -> AirspeedTrack | None:
    """None for one that never measures."""
    indicated, true, pressure, warm = _copies(one, *COLUMNS["airspeed"])
    measured = indicated if np.isfinite(indicated).any() else pressure
    if _is_constant(one, measured, notes):
        return None
    kept = uncontradicted(one.source, notes, lone(indicated[:, None], _GUST), what="airspeed")
    track = AirspeedTrack(one.t, indicated, true, pressure, warm, one.source, one.instance)
    return rows(track, np.asarray(kept & np.isfinite(measured)))


def _range_track(one: Series, notes: list[str]) -> RangeTrack | None:
    """None for one that never has a reading within its range, or where all are the same."""
    distance, least, most, variance, status, orientation, percent = _copies(one, *COLUMNS["range"])
    shortest, longest, direction = _usual(least), _usual(most), _usual(orientation)
    if one.source == "RANGEFINDER":  # says no direction: the one that looks down (GCS_Common.cpp, send_rangefinder)
        direction = PITCH_270
    distance[~(distance > 0.0) | (np.isfinite(status) & (status != _GOOD)) | (percent == 0.0)] = np.nan
    if shortest is not None and longest is not None and shortest < longest:
        distance[(distance < shortest - _CENTIMETRE) | (distance > longest + _CENTIMETRE)] = np.nan
    known = distance[np.isfinite(distance)]
    if not len(known):
        notes.append(f"{one.source} left out: it never has a reading within its range")
    if not len(known) or _is_constant(one, known, notes):
        return None
    return RangeTrack(
        one.t,
        distance,
        sigma=np.sqrt(np.where(variance > 0.0, variance, np.nan)),
        quality=np.where(percent >= 0.0, 0.01 * percent, np.nan),
        orientation=None if direction is None else int(direction),
        least=shortest,
        most=longest,
        source=one.source,
        instance=one.instance,
    )


def _flow_track(one: Series, notes: list[str]) -> FlowTrack | None:
    """From rates, or from angles over an interval; None where all are the same."""
    if "x_rad" in one.columns:
        interval = _copies(one, "interval_us")[0] * 1e-6
        interval = np.where(interval > 0.0, interval, np.nan)
        x, y, *turned = (angle / interval for angle in _copies(one, *ANGLES_OF_FLOW))
    else:
        interval = np.full(len(one), np.nan)
        x, y, *turned = _copies(one, "x_radps", "y_radps", "body_x_radps", "body_y_radps", "body_z_radps")
    flow, gyro = np.column_stack([x, y]), np.column_stack(turned)
    good = np.asarray(np.isfinite(flow).all(axis=1))
    if not good.any():
        notes.append(f"{one.source} left out: it never tells a flow")
    if not good.any() or _is_constant(one, flow[good], notes):
        return None
    quality, distance = _copies(one, "quality", "range_m")
    distance = np.where(distance > 0.0, distance, np.nan)  # negative or zero is "not known"
    return rows(FlowTrack(one.t, flow, gyro, interval, quality, distance, one.source, one.instance), good)


def _usual(values: Array) -> float | None:
    """The value that most of (N,) have; None where none is reported."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None
