"""ArduPilot's on-board log → its flights. The IMU is there at 25-1000 Hz, as floats.

Attitude and position are those of the primary EKF core (XKQ and XKF1, or NKQ and NKF1 of EKF2), which live in the frame
of the IMU: AHRS_TRIM plays no part. Where a log has none, ATT is taken, which is what ATTITUDE would have said.
Sources: ArduPilot `libraries/AP_Logger/LogStructure.h`, `AP_NavEKF3/LogStructure.h`, `AP_NavEKF3_Logging.cpp`.

Also here: a simulator's truth, the controller's setpoints, and its outputs to the motors.

Sources: ArduPilot `SITL/SITL.cpp` (SIM, SIM2), `AP_AHRS/LogStructure.h` (ATT), `AP_Logger/LogStructure.h` (RCOU, RCO2,
RCO3).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from companion.logs import RecordLayout, Records
from companion.mavlink import Dialect
from companion.model import (
    ActuatorTrack,
    Array,
    ControlTrack,
    Flight,
    StatusText,
    TruthTrack,
    Vehicle,
    counted,
    from_euler,
)
from companion.telemetry import convert
from companion.telemetry.aiding import aiding_tracks
from companion.telemetry.control import actuators_of, control_of, truth_track
from companion.telemetry.dataflash import cores, pose
from companion.telemetry.dataflash.joined import boots
from companion.telemetry.dataflash.pose import ekf_origin, in_frame
from companion.telemetry.dataflash.sensors import IMU_NUMBERS, NEEDED, imu_tracks, record_sensors, with_times
from companion.telemetry.events import dataflash_events, parameter_changes
from companion.telemetry.flights import arrival
from companion.telemetry.parameters import (
    at_boot,
    banner,
    declination,
    identity,
    possible,
    setting_names,
    values_of,
    vehicle_type,
    words,
)
from companion.telemetry.samples import increasing
from companion.telemetry.sources import SI

_OUTPUTS = {"RCOU": 14, "RCO2": 4, "RCO3": 14}
"""Records of the outputs → how many they have; each goes on where the one before ends."""

_TRUTH: Mapping[str, tuple[str, ...]] = {
    "SIM": ("Lat", "Lng", "Alt", "Roll", "Pitch", "Yaw"),
    "SIM2": ("VN", "VE", "VD"),
}
"""Columns that these records must have."""

_DESIRED = ("DesRoll", "DesPitch", "DesYaw")


def truth(records: Mapping[str, Records]) -> TruthTrack | None:
    """SITL's own state: SIM, with the velocity of SIM2 where that is logged; position about the estimator's origin."""
    if (one := records.get("SIM")) is None:
        return None
    has_q = one.layout.has_numbers(*pose.QUATERNION)
    q = one.columns(*pose.QUATERNION) if has_q else pose.angles(one)
    velocity = np.full((len(one), 3), np.nan)
    if (fine := records.get("SIM2")) is not None:
        for i, name in enumerate(("VN", "VE", "VD")):
            velocity[:, i] = np.interp(one.t, fine.t, fine[name], left=np.nan, right=np.nan)
    place = one.columns("Lat", "Lng", "Alt") * (SI["deg"], SI["deg"], 1.0)
    return truth_track("SIM", one.t, q, velocity, place, ekf_origin(records), None)


def control(ekf: cores.Ekf, trims: convert.Trims, flown: tuple[Array, Array, str] | None = None) -> ControlTrack | None:
    """The desired attitude of ATT, in the frame of the attitude track.

    trims: from the vehicle's frame, of which ATT speaks, into that of its IMU, where that is the track's; else none.
    flown: times (N,) s, quaternions (N, 4) and source of that track.
    """
    one = ekf.records.get("ATT")
    if one is None or not one.layout.has_numbers(*_DESIRED):
        return None
    angles = np.radians(one.columns(*_DESIRED))
    if not angles.any():
        return None
    desired = pose.upright(one, from_euler(*angles.T), flown)
    return control_of("ATT", one.t, in_frame(one.t, desired, trims))


def actuators(records: Mapping[str, Records], parameters: Mapping[str, float]) -> ActuatorTrack | None:
    """RCOU: the first 8 or 14 outputs; RCO2 and RCO3: 15 to 18, and 19 to 32. None where none of them is in use."""
    if "RCOU" not in records:
        return None
    banks = [_bank(records.get(name), count) for name, count in _OUTPUTS.items()]
    return actuators_of("RCOU", banks, parameters)


def _bank(one: Records | None, count: int) -> tuple[Array, Array]:
    """Times (N,) s, increasing, and pulses (N, count) in µs, NaN for outputs that the records lack."""
    if one is None:
        return np.zeros(0), np.zeros((0, count))
    names = [name for name in one.layout.fields if name != one.layout.clock and one.layout.has_numbers(name)][:count]
    pulses = np.full((len(one), count), np.nan)
    for i, name in enumerate(names):
        pulses[:, i] = one[name]
    keep = increasing(one.t, np.isfinite(one.t))
    return one.t[keep], pulses[keep]


_INFO = 6  # MAV_SEVERITY: MSG does not say
_MOST_LISTED = 8  # kinds of record, where no flight is made of them

_NUMBERS: Mapping[str, tuple[str, ...]] = {
    **IMU_NUMBERS,
    **cores.NUMBERS,
    **pose.NUMBERS,
    **_TRUTH,
    "GPS": ("Lat", "Lng", "Alt"),
    "PARM": ("Value",),
}
_WORDS = {"PARM": "Name", "MSG": "Message"}

_OTHERS = {"EV", "ERR", "MODE", "ARM", "VER", "XKFS", "AHR2"}

RECORDS = NEEDED | _NUMBERS.keys() | _WORDS.keys() | _OUTPUTS.keys() | _OTHERS
"""Records whose fields a flight is made of."""


@np.errstate(invalid="ignore", over="ignore")  # damage makes NaNs that signal, and numbers beyond all bounds
def dataflash_flights(
    messages: dict[str, Records], dialect: Dialect, *, core: int | None, undecoded: Mapping[str, int]
) -> tuple[Flight, ...]:
    """The flight of a .bin, or of each log that was joined to it; none when it has no times at all.

    The records are taken over: see `_flight`. Raises DataError when a log has no such core.
    """
    several = list(enumerate(boots(messages), 1))
    made = [_flight(records, dialect, core=core, undecoded=undecoded, boot=boot) for boot, records in several]
    return tuple(flight for flight in made if flight is not None)


def _flight(
    messages: dict[str, Records], dialect: Dialect, *, core: int | None, undecoded: Mapping[str, int], boot: int
) -> Flight | None:
    """The flight of one boot; None when it has no times at all.

    The records are taken over: the dictionary is empty afterwards, and the IMU's are let go when they have become
    tracks. dialect: has the names of the modes. core: of the EKF, to compare with; None: the one that flew.
    undecoded: how many records of each name could not be read, for the notes.
    Raises DataError when the log has no such core.
    """
    records = {name: one for name, one in messages.items() if len(one)}
    messages.clear()
    damaged = [
        f"{name}: {counted(count, 'record')} left out: the log's declaration of them is damaged or contradicts itself"
        for name, count in undecoded.items()
    ]
    for name in [name for name, one in records.items() if not _is_whole(name, one.layout)]:
        columns = words(", ".join(records[name].layout.fields))
        damaged.append(
            f"{name}: {counted(len(records.pop(name)), 'record')} left out: the log declares their columns as {columns}"
        )
    records, wrong = with_times(records)
    if not records:
        return None
    if (sent := records.get("PARM")) is not None:
        values = possible(sent["Name"].tolist(), sent["Value"].astype(np.float64), wrong)
        records["PARM"] = sent.select(np.isfinite(values))
    times = {name: records[name].t for name in sorted(records) if len(records[name])}
    records = {name: one for name, one in records.items() if name in RECORDS}  # of the others there are only times
    names, _, values = _parameters(records)
    parameters = values_of(names, values)
    ekf = cores.flew(records, at_boot(parameters, values_of(names, values, first=True)))
    notes = [] if boot == 1 else [f"log {boot} of several that are joined in this file"]
    core = cores.reference_core(ekf, core, notes)
    flight = replace(_without_tracks(ekf, parameters, times, dialect), boot=boot)
    del times
    return _with_tracks(flight, records, ekf, core, [*notes, *damaged, *wrong])


def why_no_flight(messages: Mapping[str, Records]) -> str:
    """Why a .bin of which there is no flight has none."""
    counts = {name: len(one) for name, one in messages.items()}
    most = sorted(counts, key=lambda name: -counts[name])[:_MOST_LISTED]
    has = f"it has {', '.join(f'{name} ({counts[name]:,})' for name in most)}" if most else "it has no record"
    imu = "" if "IMU" in counts else "it has no IMU (LOG_BITMASK), and "
    return f"{imu}its records have no times, as ArduCopter 3.1 and older wrote them: {has}"


def _without_tracks(
    ekf: cores.Ekf, parameters: Mapping[str, float], times: Mapping[str, Array], dialect: Dialect
) -> Flight:
    records = ekf.records
    texts = _texts(records)
    vehicle = _vehicle(records, parameters, texts)
    begin, end = (float(edge) for edge in (min(t[0] for t in times.values()), max(t[-1] for t in times.values())))
    return Flight(
        vehicle=vehicle,
        settings=setting_names(vehicle.autopilot),
        declination=declination(parameters),
        boot=1,
        start=begin,
        duration=end - begin,
        origin=pose.origin(ekf),
        epoch=pose.epoch(records),
        home=pose.home(records),
        events=dataflash_events(records, vehicle, dialect),
        parameters=parameters,
        texts=texts,
        messages={name: arrival(t, 0) for name, t in times.items()},
        on_board=True,
        actuators=actuators(records, parameters),
        truth=truth(records),
        imu_in_use=cores.imu_in_use(ekf),
        aiding_in_use=ekf.sensors_of(ekf.core),
        lane_in_use=cores.lane_in_use(ekf),
        resets=cores.resets(ekf, texts),
        parameter_changes=parameter_changes(*_parameters(records)),
    )


def _with_tracks(flight: Flight, records: dict[str, Records], ekf: cores.Ekf, core: int, notes: list[str]) -> Flight:
    """The IMUs, and all that lives in their frame: where only ATT tells the attitude, theirs becomes that of ATT."""
    series = record_sensors(ekf, core, notes)
    imus = imu_tracks(records, flight.vehicle, flight.parameters, notes)
    biases = cores.bias_tracks(ekf)
    sampled = pose.attitude(ekf, core)
    in_imu_frame, turns = sampled is not None and sampled[2] != "ATT", convert.UNTURNED
    names, _, values = _parameters(records)
    at_first = values_of(names, values, first=True)
    if sampled is not None and not in_imu_frame:
        turns = convert.turns(at_first, notes, flight.parameter_changes)
    trims = convert.trims(at_first, flight.parameter_changes) if in_imu_frame else ()
    imus = {name: convert.turned(track, turns) for name, track in imus.items()}
    biases = tuple(convert.turned(one, turns) for one in biases)
    own = next((bias for bias in biases if bias.core == core), None)
    position = pose.position(ekf, core, notes)
    return replace(
        flight,
        imus=imus,
        attitude=None if sampled is None else pose.with_rates(sampled, imus, own, notes),
        position=position,
        series=series,
        **aiding_tracks(series, notes, turns),
        biases=biases,
        control=control(ekf, trims, sampled),
        lanes=pose.lanes(ekf, trims, in_imu_frame=in_imu_frame),
    )


def _is_whole(name: str, layout: RecordLayout) -> bool:
    """Whether records have what is read of them: where damage met their declaration, a column has another name."""
    words = _WORDS.get(name)
    return layout.has_numbers(*_NUMBERS.get(name, ())) and (words is None or layout.kind(words) == "S")


def _parameters(records: Mapping[str, Records]) -> tuple[list[bytes], Array, Array]:
    """Names, times (N,) s and values (N,): all are written where the log begins, and each again when it is set."""
    if (one := records.get("PARM")) is None:
        return [], np.zeros(0), np.zeros(0)
    return one["Name"].tolist(), one.t, one["Value"].astype(np.float64)


def _texts(records: Mapping[str, Records]) -> tuple[StatusText, ...]:
    if (one := records.get("MSG")) is None:
        return ()
    rows = zip(one.t.tolist(), one["Message"].tolist(), strict=True)
    return tuple(StatusText(t, _INFO, words(text)) for t, text in rows)


def _vehicle(records: Mapping[str, Records], parameters: Mapping[str, float], texts: Sequence[StatusText]) -> Vehicle:
    build, version = None, ""
    if "VER" in records and records["VER"].layout.has_numbers("BU", "Maj", "Min", "Pat"):
        build, *numbers = (int(records["VER"][name][0]) for name in ("BU", "Maj", "Min", "Pat"))
        version = ".".join(map(str, numbers))
    kind, firmware = banner(one.text for one in texts) or (vehicle_type(parameters, build), version)
    return Vehicle(
        sysid=identity(parameters, "MAV_SYSID", "SYSID_THISMAV"),
        compid=1,
        autopilot="ARDUPILOTMEGA",
        type=kind,
        firmware=firmware,
    )
