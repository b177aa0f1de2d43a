"""What happened in a flight: armed, disarmed, a new mode, an error, in the words of each format; and its texts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np
import numpy.typing as npt

from companion.logs import Records
from companion.mavlink import Dialect, Messages, mode_name
from companion.model import Array, Event, StatusText, Vehicle
from companion.telemetry.samples import majority
from companion.telemetry.sanitize import words

_ARMED_FLAG = 128  # MAV_MODE_FLAG_SAFETY_ARMED
_UNDEFINED, _ON_GROUND = 0, 1  # MAV_LANDED_STATE
_EV_ARMED, _EV_DISARMED = 10, 11

# ArduPilot libraries/AP_Logger/AP_Logger.h, LogEvent and LogErrorSubsystem.
_EV = {
    10: "armed", 11: "disarmed", 15: "auto armed", 17: "landed, maybe", 18: "landed", 19: "GPS lost", 21: "flip begins",
    22: "flip ends", 25: "home set", 28: "took off", 30: "autotune begins", 31: "autotune off",
    33: "autotune succeeded", 34: "autotune failed", 38: "trim saved", 41: "fence enabled", 42: "fence disabled",
    46: "gripper closed", 47: "gripper opened", 49: "parachute disabled", 50: "parachute enabled",
    51: "parachute released", 52: "landing gear down", 53: "landing gear up", 54: "motors emergency stopped",
    55: "motors emergency stop cleared", 56: "motor interlock off", 57: "motor interlock on",
    60: "EKF height reset", 61: "landing cancelled by the pilot", 62: "EKF yaw reset", 67: "primary GPS changed",
    73: "landing place moved", 74: "standby on", 75: "standby off", 163: "surfaced", 164: "dived", 165: "on the bottom",
    166: "off the bottom",
}  # fmt: skip
_ERR = {
    1: "main loop", 2: "radio", 3: "compass", 4: "optical flow", 5: "radio failsafe", 6: "battery failsafe",
    7: "GPS failsafe", 8: "ground station failsafe", 9: "fence failsafe", 10: "flight mode", 11: "GPS",
    12: "crash check", 13: "flip", 14: "autotune", 15: "parachute", 16: "EKF check", 17: "EKF failsafe",
    18: "barometer", 19: "CPU", 20: "ADS-B failsafe", 21: "terrain", 22: "navigation", 23: "terrain failsafe",
    24: "EKF primary core", 25: "thrust loss", 26: "sensor failsafe", 27: "leak failsafe", 28: "pilot input",
    29: "vibration failsafe", 30: "internal error", 31: "dead reckoning failsafe",
}  # fmt: skip


def heartbeat_events(beats: Messages, vehicle: Vehicle, dialect: Dialect) -> tuple[Event, ...]:
    """Changes of arming and mode between the vehicle's heartbeats.

    The first heartbeat gives the mode at the beginning, and "armed" if it already was.
    """
    beats = beats.select(majority(beats["autopilot"], beats["type"]))  # somebody else may speak with these ids
    return changes(
        beats.t,
        (beats["base_mode"] & _ARMED_FLAG) != 0,
        beats["custom_mode"],
        lambda mode: mode_name(dialect, vehicle.autopilot, vehicle.type, mode),
    )


def landed_events(states: Messages) -> tuple[Event, ...]:
    """Take-offs and landings by EXTENDED_SYS_STATE."""
    t = states.t
    known = np.flatnonzero(np.isfinite(t) & (states["landed_state"] != _UNDEFINED))
    aloft = states["landed_state"][known] != _ON_GROUND
    events = [Event(float(t[known[0]]), "event", "in the air")] if len(known) and aloft[0] else []
    turns = (np.flatnonzero(np.diff(aloft)) + 1).tolist()
    events += [Event(float(t[known[i]]), "event", "took off" if aloft[i] else "landed") for i in turns]
    return tuple(events)


def changes(
    t: Array,
    armed: npt.NDArray[np.bool_],
    modes: npt.NDArray[np.integer[np.typing.NBitBase]],
    name: Callable[[int], str],
) -> tuple[Event, ...]:
    """Events where the state of arming or the mode is another than before; all (N,), in order of time."""
    if not len(t):
        return ()
    events = [Event(float(t[0]), "armed", "armed when the log begins")] if armed[0] else []
    events.append(Event(float(t[0]), "mode", name(int(modes[0]))))
    for i in (np.flatnonzero(np.diff(armed)) + 1).tolist():
        word = "armed" if armed[i] else "disarmed"
        events.append(Event(float(t[i]), word, word))
    events += [Event(float(t[i]), "mode", name(int(modes[i]))) for i in (np.flatnonzero(np.diff(modes)) + 1).tolist()]
    return in_order(events)


def dataflash_events(records: Mapping[str, Records], vehicle: Vehicle, dialect: Dialect) -> tuple[Event, ...]:
    """MODE, ARM, EV and ERR of an ArduPilot log."""
    events: list[Event] = []
    for t, mode in _rows(records, "MODE", "ModeNum" if _has(records, "MODE", "ModeNum") else "Mode"):
        name = mode_name(dialect, vehicle.autopilot, vehicle.type, mode)
        if not events or events[-1].text != name:  # a log begins by repeating the present mode
            events.append(Event(t, "mode", name))
    for t, state in _rows(records, "ARM", "ArmState"):
        events.append(Event(t, "armed" if state else "disarmed", "armed" if state else "disarmed"))
    for t, number in _rows(records, "EV", "Id"):
        if number in (_EV_ARMED, _EV_DISARMED):
            if not _has(records, "ARM", "ArmState"):  # older logs
                events.append(Event(t, _EV[number], _EV[number]))
        else:
            events.append(Event(t, "event", _EV.get(number, f"event {number}")))
    # Where damage met the declaration of one of the two columns there are no rows of it.
    for (t, subsystem), (_, code) in zip(_rows(records, "ERR", "Subsys"), _rows(records, "ERR", "ECode"), strict=False):
        what = _ERR.get(subsystem, f"subsystem {subsystem}")
        events.append(Event(t, "error" if code else "event", f"{what}: error {code}" if code else f"{what}: resolved"))
    return in_order(events)


def status_texts(messages: Messages) -> tuple[StatusText, ...]:
    """STATUSTEXT, the chunks of long ones (same id, chunk_seq 0, 1, ...) put together.

    A chunk whose predecessor was lost is a text of its own.
    """
    said: list[StatusText] = []
    expected = (0, 0)  # id and chunk_seq of what would go on with the last text
    columns = (messages[n].tolist() for n in ("severity", "text", "id", "chunk_seq"))
    decoded: dict[bytes, str] = {}  # the same are said over and over
    for at, severity, raw, chunk_id, chunk in zip(messages.t.tolist(), *columns, strict=True):
        text = decoded.get(raw)
        if text is None:
            text = decoded[raw] = words(raw)
        if chunk_id and (chunk_id, chunk) == expected:
            said[-1] = StatusText(said[-1].t, said[-1].severity, said[-1].text + text)
        else:
            said.append(StatusText(at, severity, text))
        expected = (chunk_id, chunk + 1)
    return tuple(said)


def in_order(events: Iterable[Event]) -> tuple[Event, ...]:
    """The events by time."""
    return tuple(sorted(events, key=lambda event: event.t))


def _has(records: Mapping[str, Records], name: str, field: str) -> bool:
    return name in records and records[name].layout.has_numbers(field)


def _rows(records: Mapping[str, Records], name: str, field: str) -> list[tuple[float, int]]:
    if not _has(records, name, field):
        return []
    one = records[name]
    return list(zip(one.t.tolist(), one[field].astype(np.int64).tolist(), strict=True))
