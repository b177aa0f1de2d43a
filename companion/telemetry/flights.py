"""A log's messages → its flights: one per vehicle and boot, with tracks on one clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from companion.mavlink import Dialect, Messages
from companion.series import Event
from companion.telemetry import convert
from companion.telemetry.arrival import arrivals
from companion.telemetry.clock import boot_seconds
from companion.telemetry.epoch import system_epoch
from companion.telemetry.events import heartbeat_events
from companion.telemetry.sensors import SENSOR_MESSAGES, message_sensors
from companion.telemetry.split import Boot, Bystander, boots, describe, senders
from companion.telemetry.words import words
from companion.tracks import (
    Array,
    AttitudeTrack,
    Flight,
    ImuTrack,
    Origin,
    PositionTrack,
    StatusText,
    Vehicle,
)

_TIMED = SENSOR_MESSAGES | {
    *convert.IMU_MESSAGES, "ATTITUDE", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "STATUSTEXT",
    "HEARTBEAT",
}  # fmt: skip
"""Messages that become tracks, series, events or texts, and need a place on the flight's clock."""


NEEDED = _TIMED | {"PARAM_VALUE", "AUTOPILOT_VERSION", "GPS_GLOBAL_ORIGIN", "HOME_POSITION", "SYSTEM_TIME"}
"""Messages whose fields a flight is made of."""


def flights(
    messages: dict[str, Messages], dialect: Dialect, *, dequantise: bool = False
) -> tuple[list[Flight], list[Bystander]]:
    """Every flight in the messages, vehicles in order of their ids, boots in time's; and who else speaks in them.

    The messages are taken over: the dictionary is empty afterwards, and what has become a track is let go at once, so
    that a large log is not held twice.
    """
    found: list[Flight] = []
    others: list[Bystander] = []
    speaking = senders(messages)
    messages.clear()
    for ids in sorted(speaking):
        sender = speaking.pop(ids)
        vehicle, notes = describe(ids, sender, dialect)
        if isinstance(vehicle, Bystander):
            others.append(vehicle)
            continue
        found += _boots_of(vehicle, sender, notes, dialect, dequantise)
    return found, others


def _boots_of(
    vehicle: Vehicle, sender: dict[str, Messages], said: tuple[str, ...], dialect: Dialect, dequantise: bool
) -> list[Flight]:
    """The flights of one vehicle. First all but the tracks; then message by message the tracks of all its boots.

    So the messages of a type are let go before the next become tracks.
    """
    begun: list[tuple[Boot, dict[str, Array], Flight]] = []
    parameters: dict[str, float] = {}
    for boot in boots(vehicle, sender):
        if "PARAM_VALUE" in boot.messages:  # parameters outlive a reboot, and are seldom read again after it
            bytewise = vehicle.autopilot == "PX4"
            parameters = parameters | convert.parameters(boot.messages["PARAM_VALUE"], bytewise=bytewise)
        begun.append((boot, *_without_tracks(boot, parameters, said, dialect)))
    tracks: list[tuple[dict[str, ImuTrack], list[str]]] = [({}, []) for _ in begun]
    for name in convert.IMU_MESSAGES:
        for (boot, seconds, flight), (imus, notes) in zip(begun, tracks, strict=True):
            if name in boot.messages:
                track, told = convert.imu_track(boot.messages.pop(name), seconds.pop(name), dequantise=dequantise)
                notes.extend(told)
                if track is not None:
                    trim = convert.trim(flight.parameters) if _is_ardupilot(vehicle) else None
                    imus[name] = convert.turned(track, trim[0]) if trim else track
    return [
        replace(
            flight,
            imus=imus,
            attitude=_attitude(boot, seconds),
            position=_position(boot, seconds),
            notes=(*flight.notes, *notes, *_doubts(vehicle, imus, flight.parameters)),
        )
        for (boot, seconds, flight), (imus, notes) in zip(begun, tracks, strict=True)
    ]


def _without_tracks(
    boot: Boot, parameters: dict[str, float], said: tuple[str, ...], dialect: Dialect
) -> tuple[dict[str, Array], Flight]:
    """The boot times of its messages, and its flight as far as it needs no track."""
    seconds: dict[str, Array] = {}
    notes = [*said, *boot.notes]
    for name, messages in boot.messages.items():
        if name not in _TIMED:
            continue
        seconds[name], shift = boot_seconds(messages, boot.clock)
        if shift and name in convert.IMU_MESSAGES:
            notes.append(f"{name}.time_usec runs {shift:+.3f} s from time_boot_ms: taken out")
    first, last = _span(boot)
    if not len(boot.clock.t):
        notes.append("the vehicle sends no device time: the duration is that of the log's stamps, 0 where it has none")
    return seconds, Flight(
        vehicle=boot.vehicle,
        boot=boot.number,
        start=first,
        duration=last - first,
        origin=_origin(boot),
        epoch=system_epoch(boot.messages.get("SYSTEM_TIME"), boot.clock),
        home=convert.home(boot.messages["HOME_POSITION"]) if "HOME_POSITION" in boot.messages else None,
        series=message_sensors(boot.messages, seconds, px4=boot.vehicle.autopilot == "PX4"),
        events=_events(boot, seconds, dialect),
        parameters=parameters,
        texts=_texts(boot, seconds),
        messages=arrivals(boot.messages, seconds),
        notes=tuple(notes),
    )


def _span(boot: Boot) -> tuple[float, float]:
    """First and last boot time, s; of log time where the vehicle sends no device time at all."""
    if len(boot.clock.t):
        return float(boot.clock.t.min()), float(boot.clock.t.max())
    stamps = np.concatenate([m.log_time for m in boot.messages.values()])
    stamps = stamps[np.isfinite(stamps)]
    return 0.0, float(np.ptp(stamps)) if len(stamps) else 0.0


def _doubts(vehicle: Vehicle, imus: Mapping[str, ImuTrack], parameters: Mapping[str, float]) -> list[str]:
    """What is to be known of a flight's IMUs as a whole."""
    if not imus:
        return []
    if vehicle.autopilot == "PX4" and imus.keys() == {"HIGHRES_IMU"}:
        return ["HIGHRES_IMU is all there is: PX4 has subtracted its EKF's biases, so it is no independent witness"]
    if not _is_ardupilot(vehicle):
        return []
    if "AHRS_TRIM_X" not in parameters:
        return ["AHRS_TRIM is not in the log: if the board is trimmed, the accelerometer looks tilted by it"]
    trim = convert.trim(parameters)
    return [trim[1]] if trim else []


def _is_ardupilot(vehicle: Vehicle) -> bool:
    return vehicle.autopilot == "ARDUPILOTMEGA"


def _attitude(boot: Boot, seconds: dict[str, Array]) -> AttitudeTrack | None:
    """The better sampled of ATTITUDE_QUATERNION and ATTITUDE."""
    names = ("ATTITUDE_QUATERNION", "ATTITUDE")
    tracks = [convert.attitude_track(boot.messages.pop(n), seconds[n]) for n in names if n in boot.messages]
    usable = [track for track in tracks if len(track) > 1]
    return max(usable, key=len) if usable else None


def _position(boot: Boot, seconds: dict[str, Array]) -> PositionTrack | None:
    """LOCAL_POSITION_NED, unless GLOBAL_POSITION_INT covers more than twice its time."""
    names = ("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT")
    tracks = [convert.position_track(boot.messages.pop(n), seconds[n]) for n in names if n in boot.messages]
    usable = [track for track in tracks if len(track) > 1]
    if not usable:
        return None
    local, other = usable[0], usable[-1]
    return other if np.ptp(other.t) > 2 * np.ptp(local.t) else local


def _origin(boot: Boot) -> Origin | None:
    names = ("GLOBAL_POSITION_INT", "GPS_RAW_INT", "GPS_GLOBAL_ORIGIN")
    known = (
        convert.origin(m, boot_seconds(m, boot.clock)[0]) for n in names if (m := boot.messages.get(n)) is not None
    )
    return next((place for place in known if place is not None), None)


def _events(boot: Boot, seconds: dict[str, Array], dialect: Dialect) -> tuple[Event, ...]:
    if "HEARTBEAT" not in boot.messages:
        return ()
    return heartbeat_events(boot.messages["HEARTBEAT"], seconds["HEARTBEAT"], boot.vehicle, dialect)


def _texts(boot: Boot, seconds: dict[str, Array]) -> tuple[StatusText, ...]:
    """STATUSTEXT, the chunks of long ones (same id, chunk_seq 0, 1, ...) put together."""
    if "STATUSTEXT" not in boot.messages:
        return ()
    said: list[StatusText] = []
    messages = boot.messages["STATUSTEXT"]
    columns = (messages[n].tolist() for n in ("severity", "text", "id", "chunk_seq"))
    decoded: dict[bytes, str] = {}  # the same are said over and over
    for t, severity, raw, chunk_id, chunk in zip(seconds["STATUSTEXT"].tolist(), *columns, strict=True):
        text = decoded.get(raw)
        if text is None:
            text = decoded[raw] = words(raw)
        if chunk_id and chunk and said:
            said[-1] = StatusText(said[-1].t, said[-1].severity, said[-1].text + text)
        else:
            said.append(StatusText(t, severity, text))
    return tuple(said)
