"""Series of any format → typed tracks of the sensors that aid an IMU; what a simulator says of itself → its truth.

What the fields of a format mean, their units and what stands for "not known" is settled in the series
(`companion.telemetry.sources`): a row there with these columns is all that a format needs to have the track.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from companion.mavlink import Messages
from companion.model import (
    AirspeedTrack,
    Array,
    BarometerTrack,
    CompassTrack,
    FlowTrack,
    GpsTrack,
    Origin,
    PositionTrack,
    RangeTrack,
    Series,
    TruthTrack,
    counted,
    from_euler,
    ned_from_geodetic,
    of_kind,
)
from companion.telemetry.air_and_ground import CONSTANT, airspeed_track, flow_track, is_constant, range_track
from companion.telemetry.convert import UNTURNED, Turns, turned_vectors
from companion.telemetry.lazy import Lazy, LazyTuple
from companion.telemetry.outliers import HEIGHT, lone, lone_fields, uncontradicted
from companion.telemetry.quantities import pressure_altitude
from companion.telemetry.samples import attitudes
from companion.telemetry.sources import SI

_Track = GpsTrack | CompassTrack | BarometerTrack | AirspeedTrack | RangeTrack | FlowTrack
_Maker = Callable[[Series, list[str]], _Track | None]

_EARTH_M = 6.4e6


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
        "airspeeds": ("airspeed", airspeed_track),
        "ranges": ("range", range_track),
        "flows": ("flow", flow_track),
    }
    made = Lazy({
        name: partial(_made, of_kind(series, kind), make, apart=kind in apart) for name, (kind, make) in makers.items()
    })  # fmt: skip
    before = tuple(notes)

    def tracks(name: str) -> Sequence[Any]:
        return LazyTuple(lambda: made[name][0])

    def every_note() -> tuple[str, ...]:
        return (*before, *(note for _, own in made.values() for note in own))

    return {**{name: tracks(name) for name in makers}, "notes": LazyTuple(every_note)}


def _made(several: Iterable[Series], make: _Maker, *, apart: bool) -> tuple[tuple[_Track, ...], list[str]]:
    """One track per instance, the best sampled of it: RAW_IMU and HIGHRES_IMU speak of the same compass; and notes."""
    notes: list[str] = []
    tracks = [track for one in several if (track := make(one, notes)) is not None and len(track)]
    if apart:
        return tuple(tracks), notes
    told = [one for one in tracks if not isinstance(one, AirspeedTrack) or np.isfinite(one.airspeed).any()]
    best: dict[int, _Track] = {}
    for track in told or tracks:
        if len(track) > len(best.get(track.instance, ())):
            best[track.instance] = track
    return tuple(best[instance] for instance in sorted(best)), notes


def truth_track(
    source: str,
    t: Array,
    q_ned_frd: Array,
    velocity: Array,
    place: tuple[Array, Array, Array],
    origin: Origin | None,
    track: PositionTrack | None,
) -> TruthTrack | None:
    """A simulator's own poses at boot times t (N,) s, in any order; None without any.

    velocity: NED, m/s; place: latitude and longitude in rad, height in m; each (N,), NaN where it is not told. They
    become NED about the zero of `track`, the autopilot's position, which `origin` places on Earth.
    """
    keep, when, q = attitudes(t, q_ned_frd)
    if not len(when):
        return None
    position = np.full((len(t), 3), np.nan)
    if origin is not None:
        latitude, longitude, height = place
        unknown = np.isnan(height)
        position = ned_from_geodetic(
            latitude,
            longitude,
            np.where(unknown, origin.height, height),
            (origin.latitude, origin.longitude, origin.height),
        )
        position[unknown, 2] = np.nan
        if origin.t is not None and track is not None:
            position = position + [np.interp(origin.t, track.t, axis) for axis in track.position.T]
    return TruthTrack(when, q, velocity[keep], position[keep], source)


def _compass_track(one: Series, notes: list[str], *, turns: Turns) -> CompassTrack | None:
    if is_constant(one.source, one.values, notes):
        return None
    t, field = one.t, turned_vectors(one.t, one.values, turns)
    good = field.any(axis=1)  # the Earth's field is nowhere zero
    if not good.all():
        notes.append(
            f"{one.source}: {counted(int((~good).sum()), 'sample')} left out as magnetometer: all axes are zero"
        )
        t, field = t[good], field[good]
    kept = uncontradicted(f"{one.source} (magnetometer)", notes, lone_fields(t, field))
    if not kept.all():
        t, field = t[kept], field[kept]
    calibrated = not one.source.startswith("sensor_mag")  # of PX4: that is the driver's
    return CompassTrack(t, field, source=one.source, instance=one.instance, calibrated=calibrated)


def _barometer_track(one: Series, notes: list[str]) -> BarometerTrack | None:
    told = "pressure_pa" if np.isfinite(one["pressure_pa"]).any() else "altitude_m"
    if is_constant(one.source, one[told], notes):
        return None
    weighed = ~(one["pressure_pa"] <= 0.0)
    t, pressure, altitude = one.t[weighed], one["pressure_pa"][weighed], one["altitude_m"][weighed]
    good = uncontradicted(
        one.source, notes, lone(pressure_altitude(pressure)[:, None], HEIGHT), lone(altitude[:, None], HEIGHT)
    )
    t, pressure, altitude, temperature = t[good], pressure[good], altitude[good], one["temperature_degc"][weighed][good]
    track = BarometerTrack(t, pressure, altitude, temperature, one.source, one.instance)
    if not len(track):
        notes.append(f"{one.source} left out: its pressure is never above zero")
    return track


def _gps_track(gps: Series, notes: list[str]) -> GpsTrack | None:
    if np.isnan(gps["lat_rad"]).all():
        notes.append(f"{gps.source} left out: it never has a fix")
        return None
    place = np.column_stack([gps["lat_rad"], gps["lon_rad"] * np.cos(gps["lat_rad"])]) * _EARTH_M
    kept = uncontradicted(gps.source, notes, lone(place), what="fix")
    if not kept.all():
        gps = Series(gps.t[kept], gps.values[kept], gps.columns, gps.source, gps.instance)
    velocity = np.column_stack([gps[name] for name in ("vn_mps", "ve_mps", "vd_mps")])
    flat = np.isnan(velocity[:, :2]).any(axis=1)  # speed over ground and course: nothing about up and down
    speed, course = gps["speed_mps"][flat], gps["course_rad"][flat]
    velocity[flat, :2] = np.column_stack([speed * np.cos(course), speed * np.sin(course)])
    track = GpsTrack(
        t=gps.t,
        latitude=gps["lat_rad"],
        longitude=gps["lon_rad"],
        height=gps["height_m"],
        velocity=velocity,
        horizontal_sigma=gps["horizontal_sigma_m"],
        vertical_sigma=gps["vertical_sigma_m"],
        speed_sigma=gps["speed_sigma_mps"],
        fix_type=gps["fix_type"],
        satellites=gps["satellites"],
        source=gps.source,
        instance=gps.instance,
    )
    return None if _is_frozen(track, notes) else track


def _is_frozen(track: GpsTrack, notes: list[str]) -> bool:
    """Whether a receiver says the same throughout: even at rest a fix differs from the one before in some digit."""
    fixed = np.isfinite(track.latitude)
    told = np.column_stack([
        track.latitude, track.longitude, track.height, track.velocity, track.horizontal_sigma, track.vertical_sigma,
        track.speed_sigma,
    ])[fixed]  # fmt: skip
    frozen = len(told) >= CONSTANT and bool(((told == told[:1]) | np.isnan(told)).all())
    if frozen:
        notes.append(f"{track.source} left out: all of its {len(told)} fixes are the same")
    return frozen


TRUTH_MESSAGES = ("SIM_STATE", "HIL_STATE_QUATERNION", "SIMSTATE")
"""The one that says most first."""


def message_truth(
    messages: Mapping[str, Messages], seconds: Mapping[str, Array], origin: Origin | None, track: PositionTrack | None
) -> TruthTrack | None:
    """The truth in a boot's messages, at their boot times `seconds`; see `truth_track` for origin and track."""
    name = next((name for name in TRUTH_MESSAGES if name in messages), None)
    if name is None:
        return None
    told = messages[name]
    nowhere = np.full(len(told), np.nan)
    if name == "HIL_STATE_QUATERNION":
        q = told["attitude_quaternion"].astype(np.float64)
        velocity = np.column_stack([_si(told, field) for field in ("vx", "vy", "vz")])
        place = _si(told, "lat"), _si(told, "lon"), _si(told, "alt")
    else:
        q = from_euler(told["roll"], told["pitch"], told["yaw"])
        velocity = np.full((len(told), 3), np.nan)
        place = nowhere, nowhere, nowhere
    if name == "SIM_STATE":
        velocity = np.column_stack([_si(told, field) for field in ("vn", "ve", "vd")])
        if told["lat_int"].any():  # `lat` and `lon` are degE7 too, whatever their unit says, cut to 24 bits
            place = _si(told, "lat_int"), _si(told, "lon_int"), _si(told, "alt")
    elif name == "SIMSTATE":
        place = _si(told, "lat"), _si(told, "lng"), nowhere
    return truth_track(name, seconds[name], q, velocity, place, origin, track)


def _si(messages: Messages, field: str) -> Array:
    return np.asarray(messages[field] * SI[messages.layout.units[field]])
