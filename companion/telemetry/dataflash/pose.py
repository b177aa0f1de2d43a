"""The attitude and position that an ArduPilot log's reference core estimated, and where on Earth it was.

Sources: ArduPilot `AP_NavEKF3/LogStructure.h`, `AP_AHRS/LogStructure.h`, `AP_NavEKF/AP_Nav_Common.h`.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from companion.logs import Records
from companion.model import Array, AttitudeTrack, BiasTrack, Epoch, ImuTrack, Origin, PositionTrack, interpolated
from companion.telemetry import convert
from companion.telemetry.clock import epoch_of, gps_to_unix
from companion.telemetry.dataflash.cores import Flew, of_cores
from companion.telemetry.outliers import lone, lone_turns, uncontradicted
from companion.telemetry.validity import has_position

EKF_ORIGIN, _HOME = 0, 1  # ORGN.Type: LogOriginType
_FIX_3D = 3

NUMBERS: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(("POS", "ORGN"), ("Lat", "Lng", "Alt")),
    "ATT": ("Roll", "Pitch", "Yaw"),
}
"""Columns that these records must have."""


def attitude(
    records: Mapping[str, Records], mine: Flew, core: int, parameters: Mapping[str, float]
) -> tuple[Array, Array, str] | None:
    """Times (N,) s, quaternions (N, 4) and source of the attitude that flew: of its EKF core, else ATT.

    None for fewer than two.
    """
    one = of_cores(records, f"{mine.prefix}Q").get(core)
    if one is not None and not by_dcm(parameters):
        return _continuous(one.t, np.column_stack([one[f"Q{i}"] for i in (1, 2, 3, 4)]).astype(np.float64), one.name)
    if "ATT" in records:
        one = records["ATT"]
        q = convert.q_from_euler(*(np.radians(one[n].astype(np.float64)) for n in ("Roll", "Pitch", "Yaw")))
        return _continuous(one.t, q, "ATT")
    return None


def by_dcm(parameters: Mapping[str, float]) -> bool:
    """Whether the vehicle flew by DCM, and its EKFs only ran along."""
    return parameters.get("AHRS_EKF_TYPE", parameters.get("AHRS_EKF_USE", 1.0)) == 0


def _continuous(t: Array, q: Array, source: str) -> tuple[Array, Array, str] | None:
    good = np.isfinite(t) & np.isfinite(q).all(axis=1) & (np.abs(np.linalg.norm(q, axis=1) - 1.0) < 0.1)
    keep = convert.increasing(t, np.asarray(good))
    return (t[keep], convert.continuous(q[keep]), source) if len(t[keep]) > 1 else None


def with_rates(
    sampled: tuple[Array, Array, str], imus: Mapping[str, ImuTrack], bias: BiasTrack | None, notes: list[str]
) -> AttitudeTrack:
    """The attitude with body rates: those of the core's own IMU less the bias that it believes.

    A single sample that turns away and back, which these rates contradict, is left out and noted.

    The log has none without bias, so they are the mean of the IMU around each time. bias: None where it is not told.
    """
    t, q, source = sampled
    instance = bias.imu_instance if bias is not None else None
    tracks = [track for track in imus.values() if len(track) > 1]
    track = next((one for one in tracks if one.instance == instance), tracks[0] if tracks else None)
    rates = np.zeros((len(t), 3)) if track is None else _mean_rates(t, track, bias)
    kept = uncontradicted(source, notes, lone_turns(t, q, rates))
    if not kept.all():
        t, q, rates = t[kept], convert.continuous(q[kept]), rates[kept]
    return AttitudeTrack(t, q, rates, source, rates_told=False)


def _mean_rates(t: Array, track: ImuTrack, bias: BiasTrack | None) -> Array:
    """(N, 3) rad/s around each of the times t (N,)."""
    steps = np.diff(track.t)[:, None] * 0.5 * (track.gyro[1:] + track.gyro[:-1])
    turned = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    edges = np.concatenate([t[:1], 0.5 * (t[1:] + t[:-1]), t[-1:]])
    at = interpolated(edges, track.t, turned)
    rates = np.diff(at, axis=0) / np.diff(edges)[:, None]
    if bias is not None and bias.imu_instance == track.instance:  # and not that of a mixture of IMUs
        rates -= interpolated(t, bias.t, bias.gyro)
    return np.asarray(rates)


def position(
    records: Mapping[str, Records], mine: Flew, core: int, parameters: Mapping[str, float]
) -> tuple[PositionTrack | None, list[str]]:
    """XKF1, NKF1 or EKF1 while the filter calls its horizontal position known; and notes."""
    one = of_cores(records, f"{mine.prefix}F1").get(core)
    if one is None:
        return None, []
    if by_dcm(parameters):
        return None, [f"{one.name}: its position is left out, as this EKF did not fly: the attitude is that of DCM"]
    t = one.t
    place = np.column_stack([one.in_unit(n) for n in ("PN", "PE", "PD")])
    velocity = np.column_stack([one.in_unit(n) for n in ("VN", "VE", "VD")])
    good = np.isfinite(t) & np.isfinite(np.column_stack([place, velocity])).all(axis=1)
    solution = of_cores(records, f"{mine.prefix}F4").get(core)
    if solution is not None and len(solution) and solution.layout.has_numbers("SS"):
        good &= has_position(t, solution.t, solution["SS"].astype(np.float64))
    keep = convert.increasing(t, np.asarray(good))
    t, place, velocity = t[keep], place[keep], velocity[keep]
    notes: list[str] = []
    kept = uncontradicted(one.name, notes, lone(place), lone(velocity))
    t, place, velocity = t[kept], place[kept], velocity[kept]
    return (PositionTrack(t, place, velocity, f"{mine.prefix}F1") if len(t) > 1 else None), notes


def origin(records: Mapping[str, Records]) -> Origin | None:
    """Where POS or GPS first says that the vehicle was; else the zero of the estimate."""
    for name in ("POS", "GPS"):
        if name in records:
            latitude, longitude, height = (records[name][n].astype(np.float64) for n in ("Lat", "Lng", "Alt"))
            fixed = np.flatnonzero((latitude != 0) | (longitude != 0))
            if len(fixed):
                i = fixed[0]
                t = float(records[name].t[i])
                return Origin(float(np.radians(latitude[i])), float(np.radians(longitude[i])), float(height[i]), t)
    return _place(records, None, first=True)


def ekf_origin(records: Mapping[str, Records]) -> Origin | None:
    """Where the estimate's position is zero."""
    return _place(records, EKF_ORIGIN)


def home(records: Mapping[str, Records]) -> Origin | None:
    """The last home that ORGN names: it is set again where the vehicle arms."""
    return _place(records, _HOME)


def _place(records: Mapping[str, Records], kind: int | None, *, first: bool = False) -> Origin | None:
    """The last (or first) place that ORGN names, of a kind where it tells it."""
    if "ORGN" not in records:
        return None
    rows = records["ORGN"]
    known = (rows["Lat"] != 0) | (rows["Lng"] != 0)
    if kind is not None:
        known &= rows["Type"] == kind if rows.layout.has_numbers("Type") else False
    rows = rows.select(np.asarray(known))
    if not len(rows):
        return None
    latitude, longitude, height = (float(rows[n][0 if first else -1]) for n in ("Lat", "Lng", "Alt"))
    return Origin(float(np.radians(latitude)), float(np.radians(longitude)), height)


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
