"""A log's messages → its flights: one per vehicle and boot, with tracks on one clock.

Also here: how messages arrived: count, rate, longest gap, copies.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from companion.mavlink import Dialect, Messages, as_bytes
from companion.model import (
    IMU_MESSAGES,
    Array,
    AttitudeTrack,
    BiasTrack,
    Event,
    Flight,
    ImuTrack,
    MessageStats,
    Origin,
    ParameterChange,
    PositionTrack,
    SensorInUse,
    Vehicle,
)
from companion.telemetry import convert, events
from companion.telemetry.aiding import aiding_tracks, valid_position
from companion.telemetry.biases import ardupilot_biases, px4_biases, selected_imu
from companion.telemetry.clock import Clock, boot_seconds, device_time, system_epoch
from companion.telemetry.control import CONTROL_MESSAGES, TRUTH_MESSAGES, actuator_track, control_track, message_truth
from companion.telemetry.convert import SENSOR_MESSAGES, message_lanes, message_sensors
from companion.telemetry.parameters import NOT_EKF, at_boot, declination, of_instance, setting_names, values_of
from companion.telemetry.sources import Lazy, LazyTuple
from companion.telemetry.split import STATE_MESSAGES, Boot, NonVehicle, Sender, boots, describe, senders

_ECHO_S = 2.0  # two identical frames within this time are one packet received twice


def arrivals(messages: Mapping[str, Messages], timed: Mapping[str, Messages]) -> Mapping[str, MessageStats]:
    """The statistics of a flight's messages by name, each made when it is read; timed: with boot times.

    By device time where the message carries it, else by the log's stamps. No message is kept for it, only its times.
    """
    makers: dict[str, Callable[[], MessageStats]] = {}
    for name in sorted(messages):
        one = messages[name]
        own = device_time(one)
        if own is None:
            makers[name] = partial(_stamped, one.log_time, one.crc, one.seq)
        else:
            makers[name] = partial(arrival, timed[name].t if name in timed else own, _copies(one, own))
    return Lazy(makers)


def _stamped(log_time: Array, crc: npt.NDArray[np.uint16], seq: npt.NDArray[np.uint8]) -> MessageStats:
    return arrival(log_time, len(_echoes(log_time, crc, seq)))


def arrival(times: Array, duplicates: int) -> MessageStats:
    """The statistics of messages at times (N,) s; those without a time (NaN) count, and that is all."""
    gaps = np.diff(times)
    in_order = (gaps >= 0).all()  # though perhaps several at once
    gaps = gaps[gaps > 0] if in_order else np.diff(np.unique(times[np.isfinite(times)]))
    if not len(gaps):
        return MessageStats(len(times), None, None, duplicates)
    known = times[np.isfinite(times)]
    span = float(known.max() - known.min())
    return MessageStats(len(times), (len(known) - 1) / span, float(gaps.max()), duplicates)


def _copies(messages: Messages, own: Array) -> int:
    """How many messages have the device time and content of another."""
    if (np.diff(own) > 0).all():
        return 0
    order = np.argsort(own, kind="stable")
    again = np.flatnonzero(np.diff(own[order]) == 0)
    rows = as_bytes(np.ascontiguousarray(messages.rows))
    return int((rows[order[again]] == rows[order[again + 1]]).sum())


def _echoes(log_time: Array, crc: npt.NDArray[np.uint16], seq: npt.NDArray[np.uint8]) -> npt.NDArray[np.intp]:
    """Which frames without a device time are one that was received just before: the same CRC, which covers `seq`."""
    frame = crc.astype(np.uint32) << 8 | seq
    order = np.argsort(frame, kind="stable")  # in file order among equals
    same = np.flatnonzero(np.diff(frame[order]) == 0)
    apart = log_time[order[same + 1]] - log_time[order[same]]
    return np.asarray(order[same[apart < _ECHO_S] + 1])


def _once(messages: Messages) -> Messages:
    """Without those that were received just before."""
    echoes = _echoes(messages.log_time, messages.crc, messages.seq)
    return messages.select(np.isin(np.arange(len(messages)), echoes, invert=True)) if len(echoes) else messages


_TIMED = SENSOR_MESSAGES | STATE_MESSAGES | {
    *TRUTH_MESSAGES, *CONTROL_MESSAGES, "EXTENDED_SYS_STATE", "PARAM_VALUE", "STATUSTEXT", "HEARTBEAT",
}  # fmt: skip
"""Messages that become tracks, series, events or texts, and need a place on the flight's clock."""

_RECEIVERS = ("GPS_RAW_INT", "GPS2_RAW")
_ELSEWHEN_S = 5.0  # a stamp that is further off than this from those of its neighbours is no time since boot
_GROUND_STATION = 190  # MAV_COMP_ID_MISSIONPLANNER
_FIX_2D = 2  # GPS_FIX_TYPE

NEEDED = _TIMED | {"AUTOPILOT_VERSION", "GPS_GLOBAL_ORIGIN", "HOME_POSITION", "SYSTEM_TIME"}
"""Messages whose fields a flight is made of."""


def flights(
    messages: dict[str, Messages], dialect: Dialect, *, dequantise: bool = False
) -> tuple[list[Flight], list[NonVehicle]]:
    """Every flight in the messages, vehicles in order of their ids, boots in time's; and who else speaks in them.

    The messages are taken over: the dictionary is empty afterwards, and what has become a track is let go at once, so
    that a large log is not held twice.
    """
    every_flight: list[Flight] = []
    others: list[NonVehicle] = []
    speaking = senders(messages)
    messages.clear()
    found_by_others = _parameters_of_ground_stations(speaking)
    for ids in sorted(speaking):
        sender = speaking.pop(ids)
        notes: list[str] = []
        vehicle = describe(ids, sender, dialect, notes)
        if isinstance(vehicle, NonVehicle):
            others.append(vehicle)
            continue
        parameters = found_by_others.get(vehicle.sysid, {}) if _is_ardupilot(vehicle) else {}
        every_flight += _boots_of(vehicle, sender, parameters, notes, dialect, dequantise)
    return every_flight, others


def _parameters_of_ground_stations(speaking: Mapping[tuple[int, int], Sender]) -> dict[int, dict[str, float]]:
    """System id → the parameters that MAVProxy sends in the vehicle's name when it has downloaded them as a file."""
    return {
        sysid: values_of(sent["param_id"].tolist(), convert.parameter_values(sent, [], bytewise=False))
        for (sysid, compid), sender in speaking.items()
        if compid == _GROUND_STATION and (sent := sender.get("PARAM_VALUE")) is not None
    }


@dataclass(slots=True)
class _Begun:
    """A flight whose tracks are being made."""

    boot: Boot
    flight: Flight
    turns: convert.Turns
    imus: dict[str, ImuTrack]
    notes: list[str]


def _boots_of(
    vehicle: Vehicle,
    sender: Sender,
    parameters: Mapping[str, float],
    notes: list[str],
    dialect: Dialect,
    dequantise: bool,
) -> list[Flight]:
    """The flights of one vehicle. First all but the tracks; then message by message the tracks of all its boots.

    So the messages of a type are let go before the next become tracks. parameters: known before the first boot; those
    of a boot outlive the next reboot, and are seldom read again after it.
    """
    begun: list[_Begun] = []
    for boot in boots(vehicle, sender):
        begun.append(_begin(boot, parameters, notes, dialect))
        parameters = begun[-1].flight.parameters
    for name in IMU_MESSAGES:
        for one in begun:
            if (sent := one.boot.messages.pop(name, None)) is not None:
                known = one.flight.parameters
                track = convert.imu(sent, vehicle, known, one.turns, one.notes, dequantise=dequantise)
                one.imus |= {} if track is None else {name: track}
    return [_with_tracks(one, dequantise) for one in begun]


def _with_tracks(begun: _Begun, dequantise: bool) -> Flight:
    messages, flight, imus = begun.boot.messages, begun.flight, begun.imus
    notes = [*begun.notes, *_doubts(flight, imus)]
    angles = partial(convert.attitude, trim_off=convert.pitch_trim(flight.vehicle, flight.parameters))
    attitudes = _made(begun, angles, "ATTITUDE_QUATERNION", "ATTITUDE")
    attitude, notes_of = max(attitudes, key=lambda one: len(one[0]), default=(None, []))
    positions = _made(begun, convert.position, "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT")
    position, odd = max(positions, key=lambda one: _weight(one[0]), default=(None, []))
    notes += [*notes_of, *odd]
    position = valid_position(position, flight.series.get("estimator"), notes)
    used = flight.imu_in_use
    biases: Sequence[BiasTrack] = ()
    if _is_ardupilot(flight.vehicle):
        biases = LazyTuple(partial(ardupilot_biases, imus, attitude, used, begun.turns, dequantised=dequantise))
    elif flight.vehicle.autopilot == "PX4":
        selected, instance = selected_imu(imus, flight.parameters, notes)
        biases = LazyTuple(partial(px4_biases, imus, selected, dequantised=dequantise))
        if instance is not None:
            used = SensorInUse(np.array([flight.start]), np.array([instance]), "HIGHRES_IMU")
            imus["HIGHRES_IMU"] = of_instance(imus["HIGHRES_IMU"], instance, flight.parameters)
    return replace(
        flight,
        imus=imus,
        attitude=attitude,
        position=position,
        **aiding_tracks(flight.series, notes, begun.turns),
        biases=biases,
        imu_in_use=used,
        lanes=message_lanes(flight.series) if _is_ardupilot(flight.vehicle) else (),
        control=control_track(messages, attitude),
        actuators=actuator_track(messages, flight.parameters),
        truth=message_truth(messages, flight.origin, position),
    )


def _begin(boot: Boot, known: Mapping[str, float], before: list[str], dialect: Dialect) -> _Begun:
    """The boot's flight as far as it needs no track. known: the parameters before it."""
    notes = [*before, *boot.notes]
    messages = boot.messages
    timed = {name: _timed(m, boot.clock, notes) for name, m in messages.items() if name in _TIMED}
    stats = arrivals(messages, timed)
    messages.update(timed)
    first, last = _span(boot)
    if not len(boot.clock.t):
        notes.append("the vehicle sends no device time: the duration is that of the log's stamps, 0 where it has none")
    parameters, at_first, changes = _parameters(boot, known, notes)
    texts = events.status_texts(_once(messages["STATUSTEXT"])) if "STATUSTEXT" in messages else ()
    resets = events.text_resets(texts)
    if "ODOMETRY" in messages:
        resets += events.odometry_resets(messages["ODOMETRY"])
    ardupilot = _is_ardupilot(boot.vehicle)
    flight = Flight(
        vehicle=boot.vehicle,
        settings=setting_names(boot.vehicle.autopilot),
        declination=declination(parameters),
        boot=boot.number,
        start=first,
        duration=last - first,
        origin=_origin(messages),
        epoch=system_epoch(messages.get("SYSTEM_TIME"), boot.clock),
        home=convert.home(messages["HOME_POSITION"]) if "HOME_POSITION" in messages else None,
        series=message_sensors(messages, notes, px4=boot.vehicle.autopilot == "PX4"),
        events=_events(boot, dialect),
        parameters=parameters,
        texts=texts,
        messages=stats,
        imu_in_use=events.imu_in_use(resets, at_boot(parameters, at_first), first) if ardupilot else None,
        resets=tuple(sorted(resets, key=lambda reset: reset.t)),
        parameter_changes=changes,
    )
    turns = convert.turns(at_first, notes, changes) if ardupilot else convert.UNTURNED
    return _Begun(boot, flight, turns, {}, notes)


def _timed(messages: Messages, clock: Clock, notes: list[str]) -> Messages:
    """The messages with their boot times; of one that counts from elsewhere those of its neighbours.

    ArduPilot stamps what a receiver says without a fix with the time of its last one (GPS_RAW_INT: last_fix_time_ms).
    """
    t, shift = boot_seconds(messages, clock)
    if messages.name in _RECEIVERS and len(clock.t):
        t = np.where(messages["fix_type"] < _FIX_2D, clock.at(messages.offset), t)
    if messages.name in IMU_MESSAGES:
        if shift:
            notes.append(f"{messages.name}.time_usec runs {shift:+.3f} s from time_boot_ms: taken out")
    elif "time_usec" in messages.layout.fields and len(clock.t) and len(t):
        beside = clock.at(messages.offset)
        off = np.abs(t - beside)
        if off.max() > _ELSEWHEN_S and float(np.median(off)) > _ELSEWHEN_S:
            notes.append(f"{messages.name}.time_usec is no time since boot: that of its neighbours is used")
            t = beside
    return replace(messages, sender_s=t)


def _parameters(
    boot: Boot, known: Mapping[str, float], notes: list[str]
) -> tuple[dict[str, float], dict[str, float], Sequence[ParameterChange]]:
    """The last value of each parameter, the first, and what changed in between."""
    if (sent := boot.messages.get("PARAM_VALUE")) is None:
        return dict(known), dict(known), ()
    values = convert.parameter_values(sent, notes, bytewise=boot.vehicle.autopilot == "PX4")
    names = sent["param_id"].tolist()
    last, first = values_of(names, values), values_of(names, values, first=True)
    changes = partial(events.parameter_changes, names, sent.t, values)
    return {**known, **last}, {**known, **first}, LazyTuple(changes)


def _span(boot: Boot) -> tuple[float, float]:
    """First and last boot time, s; of log time where the vehicle sends no device time at all."""
    if len(boot.clock.t):
        return float(boot.clock.t.min()), float(boot.clock.t.max())
    stamps = np.concatenate([m.log_time for m in boot.messages.values()])
    stamps = stamps[np.isfinite(stamps)]
    return 0.0, float(np.ptp(stamps)) if len(stamps) else 0.0


def _doubts(flight: Flight, imus: Mapping[str, ImuTrack]) -> list[str]:
    """What is to be known of a flight's IMUs as a whole."""
    px4 = flight.vehicle.autopilot == "PX4"
    if px4 and imus.keys() == {"HIGHRES_IMU"}:
        return ["HIGHRES_IMU is all there is: PX4 has subtracted its EKF's biases, so it is no independent sensor"]
    if not _is_ardupilot(flight.vehicle):
        return []
    doubts = []
    if imus and "AHRS_TRIM_X" not in flight.parameters:
        doubts.append("AHRS_TRIM is not in the log: if the board is trimmed, the accelerometer looks tilted by it")
    estimator = NOT_EKF.get(flight.parameters.get("AHRS_EKF_TYPE", np.nan))
    if estimator is not None:
        doubts.append(f"AHRS_EKF_TYPE: attitude and position are those of {estimator}, and not of an EKF")
    return doubts


def _is_ardupilot(vehicle: Vehicle) -> bool:
    return vehicle.autopilot == "ARDUPILOTMEGA"


def _weight(position: PositionTrack) -> float:
    """LOCAL_POSITION_NED is preferred, unless GLOBAL_POSITION_INT covers more than twice its time."""
    return float(np.ptp(position.t)) * (2.0 if position.source == "LOCAL_POSITION_NED" else 1.0)


Track = TypeVar("Track", AttitudeTrack, PositionTrack)
_Maker = Callable[[Messages, list[str]], Track | None]


def _made(begun: _Begun, make: _Maker[Track], *names: str) -> list[tuple[Track, list[str]]]:
    """The tracks of these messages, each with its notes."""
    made: list[tuple[Track, list[str]]] = []
    for name in (name for name in names if name in begun.boot.messages):
        notes: list[str] = []
        track = make(begun.boot.messages.pop(name), notes)
        made += [] if track is None else [(track, notes)]
    return made


def _origin(messages: Sender) -> Origin | None:
    names = ("GLOBAL_POSITION_INT", "GPS_RAW_INT", "GPS_GLOBAL_ORIGIN")
    places = (convert.origin(messages[name], messages) for name in names if name in messages)
    return next((place for place in places if place is not None), None)


def _events(boot: Boot, dialect: Dialect) -> tuple[Event, ...]:
    beats, states = boot.messages.get("HEARTBEAT"), boot.messages.get("EXTENDED_SYS_STATE")
    changes = () if beats is None else events.heartbeat_events(_once(beats), boot.vehicle, dialect)
    return events.in_order(changes + (() if states is None else events.landed_events(states)))
