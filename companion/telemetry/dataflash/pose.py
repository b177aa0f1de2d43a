"""The attitude and position that an ArduPilot log's reference core estimated, and where on Earth it was.

Also every core of the EKF as a lane of its own, and DCM, which runs along as the fallback: AHR2 is DCM while an EKF
flies. Sources: ArduPilot `AP_NavEKF3/LogStructure.h`, `AP_AHRS/LogStructure.h`, `AP_NavEKF/AP_Nav_Common.h`,
`AP_AHRS/AP_AHRS.cpp` (_get_secondary_EKF_type).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from companion.logs import Records
from companion.model import (
    Array,
    AttitudeTrack,
    BiasTrack,
    Epoch,
    EstimatorLane,
    ImuTrack,
    Origin,
    PositionTrack,
    from_euler,
    integrated,
    interpolated,
    nearest,
)
from companion.telemetry.aiding import has_position
from companion.telemetry.clock import epoch_of, gps_to_unix
from companion.telemetry.convert import Trims, in_force
from companion.telemetry.dataflash.cores import Ekf
from companion.telemetry.parameters import NOT_EKF
from companion.telemetry.samples import BoolArray, attitude_track, attitudes, place, position_track

_EKF_ORIGIN, _HOME = 0, 1  # ORGN.Type: LogOriginType
_FIX_3D = 3
_SAME_HEIGHT_M = 10.0  # of two cores, and of an origin that the estimate mends in flight by the barometer's drift

QUATERNION, _EULER = ("Q1", "Q2", "Q3", "Q4"), ("Roll", "Pitch", "Yaw")

NUMBERS: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(("POS", "ORGN"), ("Lat", "Lng", "Alt")),
    "ATT": _EULER,
}
"""Columns that these records must have."""


def attitude(ekf: Ekf, core: int) -> tuple[Array, Array, str] | None:
    """Times (N,) s, quaternions (N, 4) and source of the attitude that flew: of its EKF core, else ATT.

    None for fewer than two.
    """
    one = ekf.of_cores("Q").get(core)
    if one is not None and not _by_dcm(ekf):
        q = one.columns(*QUATERNION)
    elif (one := ekf.records.get("ATT")) is not None:
        q = angles(one)
    else:
        return None
    _, t, q = attitudes(one.t, q)
    return (t, q, one.name) if len(t) > 1 else None


def _by_dcm(ekf: Ekf) -> bool:
    """Whether the vehicle flew by DCM, and its EKFs only ran along."""
    return ekf.parameters.get("AHRS_EKF_TYPE", ekf.parameters.get("AHRS_EKF_USE", 1.0)) == 0


def with_rates(
    sampled: tuple[Array, Array, str], imus: Mapping[str, ImuTrack], bias: BiasTrack | None, notes: list[str]
) -> AttitudeTrack | None:
    """The attitude with body rates: those of the core's own IMU less the bias that it believes.

    A single sample that turns away and back, which these rates contradict, is left out and noted.

    The log has none without bias, so they are the mean of the IMU around each time, and where there is no IMU those of
    the attitude itself. bias: None where it is not logged.
    """
    t, q, source = sampled
    instance = bias.imu_instance if bias is not None else None
    tracks = [track for track in imus.values() if len(track) > 1]
    track = next((one for one in tracks if one.instance == instance), tracks[0] if tracks else None)
    rates = None if track is None else _mean_rates(t, track, bias)
    made = attitude_track(source, t, q, rates, notes)
    return None if made is None else replace(made, rates_reported=False)


def _mean_rates(t: Array, track: ImuTrack, bias: BiasTrack | None) -> Array:
    """(N, 3) rad/s around each of the times t (N,)."""
    edges = np.concatenate([t[:1], 0.5 * (t[1:] + t[:-1]), t[-1:]])
    at = interpolated(edges, track.t, integrated(track.t, track.gyro))
    rates = np.diff(at, axis=0) / np.diff(edges)[:, None]
    if bias is not None and bias.imu_instance == track.instance:  # and not that of a mixture of IMUs
        rates -= interpolated(t, bias.t, bias.gyro)
    return np.asarray(rates)


def position(ekf: Ekf, core: int, notes: list[str]) -> PositionTrack | None:
    """XKF1, NKF1 or EKF1 while the filter calls its horizontal position known."""
    one = ekf.of_cores("F1").get(core)
    if one is None:
        return None
    if _by_dcm(ekf):
        notes.append(f"{one.name}: its position is left out, as this EKF did not fly: the attitude is that of DCM")
        return None
    if (kind := ekf.parameters.get("AHRS_EKF_TYPE", np.nan)) in NOT_EKF:
        notes.append(
            f"AHRS_EKF_TYPE: the vehicle flew by {NOT_EKF[kind]}: {one.name}'s EKF, which is judged, only ran along"
        )
    ned, velocity = (np.column_stack([one.in_unit(n) for n in names]) for names in (_STATES[:3], _STATES[3:]))
    good = _has_position(one.t, ekf.of_cores("F4").get(core))
    track = position_track(one.name, one.t, ned, velocity, good, notes)
    return None if track is None else replace(track, source=f"{ekf.prefix}F1")


def _has_position(t: Array, status: Records | None) -> BoolArray:
    """(N,) whether a core calls its horizontal position known at times t (N,) s; where it tells nothing, it is."""
    if status is None or not status.layout.has_numbers("SS"):
        return np.ones(len(t), np.bool_)
    return has_position(t, status.t, status["SS"].astype(np.float64))


def origin(ekf: Ekf) -> Origin | None:
    """Where POS or GPS first says that the vehicle was; else the zero of the estimate."""
    for name, is_measured in (("POS", _is_above_sea), ("GPS", _is_fix)):
        if (one := ekf.records.get(name)) is not None:
            known = np.flatnonzero(_is_place(one) & is_measured(one, ekf))
            if len(known):
                return _place(one, int(known[0]), float(one.t[known[0]]))
    return _named_place(ekf.records, None, 0)


def _is_above_sea(pos: Records, ekf: Ekf) -> BoolArray:
    """(N,) whether POS counts heights from the sea: before the estimate is used, it counts them from the start.

    Where it is, its own height above its origin is that of POS, and the origin's height what it is later. Before 2016
    POS does not tell the height above the origin.
    """
    if not pos.layout.has_numbers("RelOriginAlt"):
        return np.ones(len(pos), np.bool_)
    above = pos["RelOriginAlt"].astype(np.float64)
    zero, known = pos["Alt"] - above, np.isfinite(above)
    core = next((one for one in ekf.of_cores("F1").values() if one.layout.has_numbers("PD")), None)
    if core is not None:
        known &= np.abs(above + np.interp(pos.t, core.t, core.in_unit("PD"))) < _SAME_HEIGHT_M
    return np.asarray(known & (np.abs(zero - zero[known][-1]) < _SAME_HEIGHT_M) if known.any() else known)


def _is_fix(gps: Records, _ekf: Ekf) -> BoolArray:
    """(N,) whether a place was measured: without a fix a receiver tells any place."""
    return np.asarray(gps["Status"] >= _FIX_3D) if gps.layout.has_numbers("Status") else np.ones(len(gps), np.bool_)


def ekf_origin(records: Mapping[str, Records]) -> Origin | None:
    """Where the estimate's position is zero."""
    return _named_place(records, _EKF_ORIGIN, -1)


def home(records: Mapping[str, Records]) -> Origin | None:
    """The last home that ORGN names: it is set again where the vehicle arms."""
    return _named_place(records, _HOME, -1)


def _named_place(records: Mapping[str, Records], kind: int | None, which: int) -> Origin | None:
    """One of the places that ORGN names, of a kind where it tells it."""
    if (one := records.get("ORGN")) is None:
        return None
    known = _is_place(one)
    if kind is not None:
        known &= one["Type"] == kind if one.layout.has_numbers("Type") else False
    rows = np.flatnonzero(known)
    return _place(one, int(rows[which])) if len(rows) else None


def _is_place(one: Records) -> BoolArray:
    return np.asarray((one["Lat"] != 0) | (one["Lng"] != 0))


def _place(one: Records, row: int, t: float | None = None) -> Origin:
    latitude, longitude, height = (float(one[name][row]) for name in ("Lat", "Lng", "Alt"))
    return place(latitude, longitude, height, t)


def epoch(records: Mapping[str, Records]) -> Epoch | None:
    """By the GPS's own week and time of week, where it has a fix. Before 2015 they are called Week and TimeMS."""
    gps = records.get("GPS")
    names = (("GWk", "GMS"), ("Week", "TimeMS"))
    dated = next((n for n in names if gps is not None and gps.layout.has_numbers(*n, "Status")), None)
    if gps is None or dated is None or dated[1] == gps.layout.clock:
        return None
    fixed = gps["Status"] >= _FIX_3D
    week, seconds = gps[dated[0]][fixed].astype(np.float64), gps[dated[1]][fixed] * 1e-3
    return epoch_of(gps_to_unix(week, seconds), gps.t[fixed], "GPS")


def in_frame(t: Array, q: Array, trims: Trims) -> Array:
    """Attitudes (N, 4) of the vehicle at times t (N,) s as those of its IMU: AHRS_TRIM turns them."""
    out = q.copy()
    for now, level in in_force(t, trims):
        if level is not None:
            out[now] = _turned_on(q[now], from_euler(*level, 0.0))
    return out


def _turned_on(q: Array, turn: Array) -> Array:
    """The Hamilton product of attitudes (N, 4) with a turn (4,) from the right."""
    w, x, y, z = turn
    return np.asarray(q @ np.array([[w, x, y, z], [-x, w, -z, y], [-y, z, w, -x], [-z, -y, x, w]]))


def upright(one: Records, q: Array, flown: tuple[Array, Array, str] | None) -> Array:
    """Attitudes (N, 4) of ATT in the body, where it tells them as of a tail-sitter that stands on its tail.

    There ArduPlane calls a nose that points up level (Plane::Log_Write_Attitude, AP_AHRS_View). It shows by what ATT
    calls the actual attitude, beside the one that flew.
    """
    if flown is None or not one.layout.has_numbers(*_EULER):
        return q
    own, nose_up = angles(one), from_euler(0.0, 0.5 * np.pi, 0.0)
    down = _down(flown[1][nearest(flown[0], one.t)])
    as_told, turned = (np.sum(down * _down(told), axis=1) for told in (own, _turned_on(own, nose_up)))
    return np.where((turned > as_told)[:, None], _turned_on(q, nose_up), q)


def _down(q: Array) -> Array:
    """(N, 3) down in the body of attitudes (N, 4)."""
    w, x, y, z = q.T
    return np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z])


_STATES = ("PN", "PE", "PD", "VN", "VE", "VD")
_LONGEST_WAIT_S = 0.05  # XKQ and XKF1 of a core are written one after the other


def lanes(ekf: Ekf, trims: Trims, *, in_imu_frame: bool) -> tuple[EstimatorLane, ...]:
    """The cores of the EKF that flew in order of their numbers, then DCM; in the frame of the attitude track.

    in_imu_frame: that is the IMU's, in which XKQ is; else AHRS_TRIM turns it, as in XKF1's own angles. trims: from the
    one into the other, none where nothing is to be turned.
    """
    made = [*_cores(ekf, in_imu_frame=in_imu_frame)]
    if (one := ekf.records.get("AHR2")) is not None and not _by_dcm(ekf) and one.layout.has_numbers(*_EULER):
        _, t, q = attitudes(one.t, in_frame(one.t, angles(one), trims))
        unknown = np.full((len(t), 3), np.nan)
        made.append(EstimatorLane(t, q, unknown, unknown, "DCM", None, "AHR2"))
    return tuple(lane for lane in made if len(lane) > 1)


def _cores(ekf: Ekf, *, in_imu_frame: bool) -> Iterator[EstimatorLane]:
    quaternions = ekf.of_cores("Q") if in_imu_frame else {}
    states, status = (ekf.of_cores(name) for name in ("F1", "F4"))
    for core in sorted(quaternions.keys() | states.keys()):
        state = states.get(core)
        if (one := quaternions.get(core)) is not None:
            t, q = one.t, one.columns(*QUATERNION)
        elif not in_imu_frame and state is not None and state.layout.has_numbers(*_EULER):
            one, t, q = state, state.t, angles(state)
        else:
            continue
        _, t, q = attitudes(t, q)
        velocity, position = _moved(t, state, status.get(core))
        yield EstimatorLane(
            t, q, velocity, position, f"{ekf.name} core {core}", core, f"{one.name}[{core}]",
            ekf.imu_of(core), ekf.sensors_of(core),
        )  # fmt: skip


def angles(one: Records) -> Array:
    """The attitudes (N, 4) that records have as Euler angles in degrees."""
    return from_euler(*np.radians(one.columns(*_EULER)).T)


def _moved(t: Array, state: Records | None, status: Records | None) -> tuple[Array, Array]:
    """Velocity and position (N, 3) at times t (N,), where the core calls its horizontal position known; else NaN."""
    velocity, position = np.full((len(t), 3), np.nan), np.full((len(t), 3), np.nan)
    if state is None or len(state) < 2 or not len(t) or not state.layout.has_numbers(*_STATES):
        return velocity, position
    row = np.clip(np.searchsorted(state.t, t - _LONGEST_WAIT_S), 0, len(state) - 1)
    good = (np.abs(state.t[row] - t) <= _LONGEST_WAIT_S) & _has_position(t, status)
    columns = [np.where(good, state.in_unit(name)[row], np.nan) for name in _STATES]
    return np.column_stack(columns[3:]), np.column_stack(columns[:3])
