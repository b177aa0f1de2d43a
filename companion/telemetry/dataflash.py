"""ArduPilot's on-board log → its flight. The IMU is there at 25-1000 Hz, as floats.

Attitude and position are those of the primary EKF core (XKQ and XKF1, or NKQ and NKF1 of EKF2), which live in the frame
of the IMU: AHRS_TRIM plays no part. Where a log has none, ATT is taken, which is what ATTITUDE would have said.
Sources: ArduPilot `libraries/AP_Logger/LogStructure.h`, `AP_NavEKF3/LogStructure.h`, `AP_NavEKF3_Logging.cpp`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from companion.errors import DataError
from companion.mavlink import Dialect, RecordLayout, Records
from companion.telemetry import convert
from companion.telemetry.arrival import arrival
from companion.telemetry.epoch import epoch_of, gps_to_unix
from companion.telemetry.events import dataflash_events
from companion.telemetry.sensors import RECORD_SENSORS, record_sensors
from companion.telemetry.words import words
from companion.tracks import Array, AttitudeTrack, Epoch, Flight, ImuTrack, Origin, PositionTrack, StatusText, Vehicle

_TYPES = {
    b"ArduCopter": "QUADROTOR",
    b"ArduPlane": "FIXED_WING",
    b"ArduRover": "GROUND_ROVER",
    b"Rover": "GROUND_ROVER",
    b"ArduSub": "SUBMARINE",
    b"Blimp": "AIRSHIP",
}
_HAS_POSITION = 0b11000  # EKF solution status: horiz_pos_rel and horiz_pos_abs (nav_filter_status in AP_NavEKF)
_HOME = 1  # ORGN.Type: LogOriginType::ahrs_home
_INFO = 6  # MAV_SEVERITY: MSG does not say


_VECTORS = tuple(f"{kind}{axis}" for kind in ("Gyr", "Acc") for axis in "XYZ")
_NUMBERS: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(("IMU", "IMU2", "IMU3"), _VECTORS),
    **dict.fromkeys(("XKQ", "NKQ"), ("Q1", "Q2", "Q3", "Q4")),
    **dict.fromkeys(("XKF1", "NKF1"), ("PN", "PE", "PD", "VN", "VE", "VD")),
    **dict.fromkeys(("POS", "GPS", "ORGN"), ("Lat", "Lng", "Alt")),
    "ATT": ("Roll", "Pitch", "Yaw"),
    "PARM": ("Value",),
}
_WORDS = {"PARM": "Name", "MSG": "Message"}

RECORDS = RECORD_SENSORS | {
    "PARM", "MSG", "EV", "ERR", "MODE", "ARM", "IMU", "IMU2", "IMU3", "XKQ", "NKQ", "ATT", "XKF1", "NKF1", "XKF4",
    "NKF4", "POS", "GPS", "ORGN",
}  # fmt: skip
"""Records whose fields a flight is made of."""


def dataflash_flight(
    messages: dict[str, Records],
    dialect: Dialect,
    *,
    core: int | None = None,
    undecoded: Mapping[str, int] = MappingProxyType({}),
) -> Flight | None:
    """The one flight of a .bin; None when it has no times at all.

    The records are taken over: the dictionary is empty afterwards, and the IMU's are let go when they have become
    tracks. dialect: has the names of the modes. core: of the EKF, to compare with; None: the one that flew.
    undecoded: how many records of each name could not be read, for the notes.
    Raises DataError when the log has no such core.
    """
    records = {name: r for name, r in messages.items() if len(r) and r.layout.has_numbers("TimeUS")}
    messages.clear()
    left_out = [
        f"{name}: {count} records left out: the log's declaration of them is damaged or contradicts itself"
        for name, count in undecoded.items()
    ]
    for name in [name for name, one in records.items() if not _is_whole(name, one.layout)]:
        columns = words(", ".join(records[name].layout.fields))
        left_out.append(
            f"{name}: {len(records.pop(name))} records left out: the log declares their columns as {columns}"
        )
    if not records:
        return None
    parameters = _parameters(records)
    vehicle = _vehicle(records, parameters)
    core, notes = _core(records, core)
    notes += left_out
    stats, edges = {}, []
    for name in sorted(records):
        t = records[name].in_unit("TimeUS")
        stats[name] = arrival(t, 0)
        edges.append((t[0], t[-1]))
    begin, end = float(min(first for first, _ in edges)), float(max(last for _, last in edges))
    series = record_sensors(records, core)
    imus = _imus(records)
    attitude = _attitude(records, core, imus)
    if attitude is not None and attitude.source == "ATT" and (trim := convert.trim(parameters)):
        imus = {name: convert.turned(track, trim[0]) for name, track in imus.items()}
        notes.append(trim[1])
    return Flight(
        vehicle=vehicle,
        boot=1,
        start=begin,
        duration=end - begin,
        imus=imus,
        attitude=attitude,
        position=_position(records, core),
        origin=_origin(records),
        epoch=_epoch(records),
        home=_home(records),
        series=series,
        events=dataflash_events(records, vehicle, dialect),
        parameters=parameters,
        texts=_texts(records),
        messages=stats,
        notes=tuple(notes),
        on_board=True,
    )


def _is_whole(name: str, layout: RecordLayout) -> bool:
    """Whether records have what is read of them: where damage met their declaration, a column has another name."""
    words = _WORDS.get(name)
    return layout.has_numbers(*_NUMBERS.get(name, ())) and (words is None or layout.kind(words) == "S")


def _parameters(records: Mapping[str, Records]) -> dict[str, float]:
    if "PARM" not in records:
        return {}
    names = (words(bytes(n)) for n in records["PARM"]["Name"])
    with np.errstate(invalid="ignore"):  # damage makes NaNs that signal
        values = records["PARM"]["Value"].astype(np.float64).tolist()
    return dict(zip(names, values, strict=True))


def _core(records: Mapping[str, Records], wanted: int | None) -> tuple[int, list[str]]:
    """The EKF core to compare with, and a note when that is not simply the one that always flew."""
    primary, notes = _primary_core(records)
    if wanted is None or wanted == primary:
        return primary, notes
    known = sorted({c for name in ("XKQ", "NKQ", "XKF1", "NKF1") if name in records for c in records[name].instances})
    if wanted not in known:
        have = ", ".join(map(str, known)) or "one without a number"
        raise DataError(f"the log has no EKF core {wanted}. It has: {have}; the one that flew is {primary}.")
    return wanted, [*notes, f"EKF core {wanted} is the reference, as asked; the one that flew is {primary}"]


def _primary_core(records: Mapping[str, Records]) -> tuple[int, list[str]]:
    """The EKF core that flew for most of the log (XKF4.PI), and a note when it was not always the same."""
    for name in ("XKF4", "NKF4"):
        if name in records and records[name].layout.has_numbers("PI"):
            cores, counts = np.unique(records[name]["PI"], return_counts=True)
            core = int(cores[np.argmax(counts)])
            if len(cores) == 1:
                return core, []
            return core, [f"the EKF changed its primary core ({cores.tolist()}): core {core} is the reference"]
    return 0, []


def _imus(records: dict[str, Records]) -> dict[str, ImuTrack]:
    """IMU[0], IMU[1], ... as log viewers call them. Older logs have IMU, IMU2, IMU3 in place of the instance.

    Their records are let go: they are most of a log.
    """
    found: dict[str, ImuTrack] = {}
    for number, name in enumerate(("IMU", "IMU2", "IMU3")):
        if name not in records:
            continue
        readings = records.pop(name)
        for instance in readings.instances or (number,):
            one = readings.instance(instance)
            gyro, accel = (np.column_stack([one.in_unit(f"{kind}{axis}") for axis in "XYZ"]) for kind in ("Gyr", "Acc"))
            t = one.in_unit("TimeUS")
            keep = convert.increasing(t, np.asarray(np.isfinite(np.column_stack([gyro, accel])).all(axis=1)))
            key = f"IMU[{instance}]"
            found[key] = ImuTrack(t[keep], gyro[keep], accel[keep], source=key, instance=int(instance))
    return found


def _attitude(records: Mapping[str, Records], core: int, imus: Mapping[str, ImuTrack]) -> AttitudeTrack | None:
    for name in ("XKQ", "NKQ"):
        if name in records:
            one = records[name].instance(core)
            q = np.column_stack([one[f"Q{i}"] for i in (1, 2, 3, 4)]).astype(np.float64)
            return _attitude_track(one.in_unit("TimeUS"), q, name, imus)
    if "ATT" in records:
        one = records["ATT"]
        q = convert.q_from_euler(*(np.radians(one[n].astype(np.float64)) for n in ("Roll", "Pitch", "Yaw")))
        return _attitude_track(one.in_unit("TimeUS"), q, "ATT", imus)
    return None


def _attitude_track(t: Array, q: Array, source: str, imus: Mapping[str, ImuTrack]) -> AttitudeTrack | None:
    good = np.isfinite(q).all(axis=1) & (np.abs(np.linalg.norm(q, axis=1) - 1.0) < 0.1)
    keep = convert.increasing(t, good)
    t = t[keep]
    if len(t) < 2:
        return None
    return AttitudeTrack(t, convert.continuous(q[keep]), _rates(t, imus), source)


def _rates(t: Array, imus: Mapping[str, ImuTrack]) -> Array:
    """Body rates at times t (N, 3) rad/s: the log has none without bias, so the first IMU's mean around each time."""
    track = next((track for track in imus.values() if len(track) > 1), None)
    if track is None:
        return np.zeros((len(t), 3))
    steps = np.diff(track.t)[:, None] * 0.5 * (track.gyro[1:] + track.gyro[:-1])
    turned = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    edges = np.concatenate([t[:1], 0.5 * (t[1:] + t[:-1]), t[-1:]])
    at = np.column_stack([np.interp(edges, track.t, column) for column in turned.T])
    return np.asarray(np.diff(at, axis=0) / np.diff(edges)[:, None])


def _position(records: Mapping[str, Records], core: int) -> PositionTrack | None:
    """XKF1 or NKF1 while the filter calls its horizontal position known."""
    for name, status in (("XKF1", "XKF4"), ("NKF1", "NKF4")):
        if name not in records:
            continue
        one = records[name].instance(core)
        t = one.in_unit("TimeUS")
        position = np.column_stack([one.in_unit(n) for n in ("PN", "PE", "PD")])
        velocity = np.column_stack([one.in_unit(n) for n in ("VN", "VE", "VD")])
        good = np.isfinite(np.column_stack([position, velocity])).all(axis=1)
        if status in records and records[status].layout.has_numbers("SS"):
            solution = records[status].instance(core)
            last = np.searchsorted(solution.in_unit("TimeUS"), t, side="right") - 1
            good &= (solution["SS"][np.maximum(last, 0)].astype(np.int64) & _HAS_POSITION) != 0
        keep = convert.increasing(t, np.asarray(good))
        track = PositionTrack(t[keep], position[keep], velocity[keep], name)
        if len(track) > 1:
            return track
    return None


def _origin(records: Mapping[str, Records]) -> Origin | None:
    for name in ("POS", "GPS", "ORGN"):
        if name not in records:
            continue
        latitude, longitude, height = (records[name][n].astype(np.float64) for n in ("Lat", "Lng", "Alt"))
        fixed = np.flatnonzero((latitude != 0) | (longitude != 0))
        if len(fixed):
            i = fixed[0]
            t = None if name == "ORGN" else float(records[name].in_unit("TimeUS")[i])
            return Origin(float(np.radians(latitude[i])), float(np.radians(longitude[i])), float(height[i]), t)
    return None


def _epoch(records: Mapping[str, Records]) -> Epoch | None:
    """By the GPS's own week and time of week, where it has a fix (Status 3 and more)."""
    gps = records.get("GPS")
    if gps is None or not gps.layout.has_numbers("GWk", "GMS", "Status"):
        return None
    fixed = gps["Status"] >= 3
    week, seconds = gps["GWk"][fixed].astype(np.float64), gps["GMS"][fixed] * 1e-3
    return epoch_of(gps_to_unix(week, seconds), gps.in_unit("TimeUS")[fixed], "GPS")


def _home(records: Mapping[str, Records]) -> Origin | None:
    """The last home that ORGN names: it is set again where the vehicle arms."""
    if "ORGN" not in records or not records["ORGN"].layout.has_numbers("Type"):
        return None
    homes = records["ORGN"].select(records["ORGN"]["Type"] == _HOME)
    if not len(homes):
        return None
    latitude, longitude, height = (float(homes[n][-1]) for n in ("Lat", "Lng", "Alt"))
    return Origin(float(np.radians(latitude)), float(np.radians(longitude)), height)


def _texts(records: Mapping[str, Records]) -> tuple[StatusText, ...]:
    if "MSG" not in records:
        return ()
    rows = zip(records["MSG"].in_unit("TimeUS").tolist(), records["MSG"]["Message"].tolist(), strict=True)
    return tuple(StatusText(t, _INFO, words(text)) for t, text in rows)


def _vehicle(records: Mapping[str, Records], parameters: Mapping[str, float]) -> Vehicle:
    banner = next(
        (
            match
            for text in (records["MSG"]["Message"].tolist() if "MSG" in records else ())
            if (match := re.match(rb"(Ardu\w+|Rover|Blimp) V(\d[\w.-]*)", text))
        ),
        None,
    )
    return Vehicle(
        sysid=int(parameters.get("MAV_SYSID", parameters.get("SYSID_THISMAV", 1))),
        compid=1,
        autopilot="ARDUPILOTMEGA",
        type=_TYPES.get(banner[1], "UNKNOWN") if banner else "UNKNOWN",
        firmware=banner[2].decode("ascii") if banner else "",
    )
