"""What happened in a flight: armed, disarmed, a new mode, an error, in the words of each format; and its texts.

Also here: changes that a vehicle announces itself: resets of its estimator, lane switches, parameters set in flight.

The words are those of ArduPilot's `AP_NavEKF2/3` and `AP_AHRS`; PX4 counts its resets in ODOMETRY.reset_counter
(`modules/mavlink/streams/ODOMETRY.hpp`: the sum of all its counters), so that which state was reset shows in the jump.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.logs import Records
from companion.mavlink import Dialect, Index, Messages, mode_name
from companion.model import Array, EstimatorReset, Event, ParameterChange, ResetKind, SensorInUse, StatusText, Vehicle
from companion.telemetry.parameters import words
from companion.telemetry.samples import BoolArray, majority

_RESETS: tuple[tuple[re.Pattern[str], ResetKind], ...] = (
    (re.compile(r"EKF\d (?:IMU\d )?lane switch (?P<core>\d)", re.ASCII), "lane"),
    (re.compile(r"EKF\d? primary changed: ?(?P<core>\d)", re.ASCII), "lane"),
    (re.compile(r"EKF\d IMU(?P<core>\d) .*(?:yaw|heading).*(?:reset|align)", re.ASCII | re.IGNORECASE), "heading"),
    (re.compile(r"EKF\d IMU(?P<core>\d) forced reset", re.ASCII), "attitude"),
    (
        re.compile(r"EKF\d IMU(?P<core>\d) (?:is using|stopped aiding|started relative aiding|origin set)", re.ASCII),
        "position",
    ),
    (re.compile(r"EKF yaw reset", re.ASCII), "heading"),
    (re.compile(r"EKF height reset", re.ASCII), "height"),
)
"""What a text announces; the first that matches."""

_SAME_S = 2.0  # "EKF3 lane switch 1" and "EKF primary changed:1" are one change
_DEGREE = float(np.radians(1.0))
_VISIBLE: Mapping[ResetKind, float] = {
    "attitude": 0.2 * _DEGREE, "heading": 0.2 * _DEGREE, "velocity": 0.2, "position": 0.05, "height": 0.05,
}  # fmt: skip
"""rad, m/s, m: a jump that is more than what happens between two messages."""


def text_resets(texts: Iterable[StatusText]) -> tuple[EstimatorReset, ...]:
    """Resets and lane switches in words."""
    resets: list[EstimatorReset] = []
    for one in texts:
        if "EKF" not in one.text:
            continue
        for pattern, kind in _RESETS:
            if match := pattern.match(one.text):
                core = match.groupdict().get("core")
                reset = EstimatorReset(one.t, kind, one.text, None if core is None else int(core))
                if not any(_same_switch(reset, other) for other in resets):
                    resets.append(reset)
                break
    return tuple(resets)


def odometry_resets(odometry: Messages) -> tuple[EstimatorReset, ...]:
    """Where ODOMETRY's counter of resets goes on, and which states jumped there: at least the one that did most."""
    t = odometry.t
    order = np.flatnonzero(np.isfinite(t))
    order = order[np.argsort(t[order], kind="stable")]
    counter = odometry["reset_counter"][order].astype(np.int64)
    places = np.flatnonzero(np.diff(counter) != 0)
    before, after = order[places], order[places + 1]
    sizes = _jumps(odometry, before, after, (t[after] - t[before])[:, None])
    kinds = list(sizes)
    seen = np.nan_to_num(np.column_stack([sizes[kind] / _VISIBLE[kind] for kind in kinds]))
    resets = []
    for n, place in enumerate(places.tolist()):
        text = f"ODOMETRY.reset_counter {counter[place]} → {counter[place + 1]}"
        jumped = np.flatnonzero(seen[n] > 1.0)
        most = jumped if len(jumped) else [int(np.argmax(seen[n]))]
        resets += [EstimatorReset(float(t[after[n]]), kinds[k], text) for k in most]
    return tuple(resets)


def lane_changes(t: Array, primary: Index, words: str) -> Iterator[EstimatorReset]:
    """Where the primary core (N,) is another than before; words: with {before} and {core}."""
    for i in turns(primary):
        before, core = int(primary[i - 1]), int(primary[i])
        yield EstimatorReset(float(t[i]), "lane", words.format(before=before, core=core), core)


def parameter_changes(names: Sequence[bytes], t: Array, values: Array) -> tuple[ParameterChange, ...]:
    """Parameters whose value differs from the one reported before, without what ArduPilot only counts (STAT_RUNTIME).

    names, t and values: (N,) as reported, at boot times in s. A vehicle acknowledges a new value by sending it,
    and logs it; a value that it only repeats is no change.
    """
    known: dict[bytes, float] = {}
    changed: list[tuple[float, bytes, float]] = []
    for name, at, value in zip(names, t.tolist(), values.tolist(), strict=True):
        if not math.isfinite(at) or not math.isfinite(value):
            continue
        before = known.get(name, value)
        known[name] = value
        if before != value and not name.startswith(b"STAT_"):
            changed.append((at, name, value))
    decoded = {name: words(name) for name in known}  # one that is tuned in flight changes over and over
    return tuple(ParameterChange(at, decoded[name], value) for at, name, value in changed)


def imu_in_use(resets: Sequence[EstimatorReset], parameters: Mapping[str, float], begin: float) -> SensorInUse | None:
    """Which IMU ArduPilot's EKF used, from its lane switches and from what its parameters say of the lanes.

    The n-th lane reads the n-th IMU of EK3_IMU_MASK (AP_NavEKF3.cpp, InitialiseFilter). None where nothing tells.
    """
    ekf = "EK2" if parameters.get("AHRS_EKF_TYPE") == 2 else "EK3"
    switches = [reset for reset in resets if reset.kind == "lane" and reset.core is not None]
    if not switches and f"{ekf}_IMU_MASK" not in parameters:
        return None
    primary = int(parameters.get(f"{ekf}_PRIMARY", 0.0))
    lanes = [(begin, primary), *((switch.t, switch.core or 0) for switch in switches)]
    mask = parameters.get(f"{ekf}_IMU_MASK", np.nan)
    known = [(at, imu) for at, lane in lanes if (imu := imu_of_core(lane, mask)) is not None]
    if not known:
        return None
    source = "lane switches" if switches else f"{ekf}_PRIMARY"
    return SensorInUse(np.array([at for at, _ in known]), np.array([imu for _, imu in known], np.int64), source)


def imu_of_core(core: int, mask: float) -> int | None:
    """The IMU of an EKF's core: the n-th bit of EK3_IMU_MASK, which by default has all; None beyond those."""
    if not 0 < mask < 256:
        return core
    bits = [bit for bit in range(8) if int(mask) >> bit & 1]
    return bits[core] if core < len(bits) else None


def _same_switch(one: EstimatorReset, other: EstimatorReset) -> bool:
    return one.kind == other.kind == "lane" and one.core == other.core and abs(one.t - other.t) < _SAME_S


def _jumps(odometry: Messages, before: Index, after: Index, dt: Array) -> dict[ResetKind, Array]:
    """By how much each state jumped between pairs of messages, beyond what rates and velocities explain: (n,) each."""
    q = odometry["q"].astype(np.float64)
    w, axis = q[before, :1], q[before, 1:]
    moved_w, moved_axis = q[after, :1], q[after, 1:]
    turn = w * moved_axis - moved_w * axis - np.cross(axis, moved_axis)  # vector part of q0* ⊗ q1
    real = w * moved_w + (axis * moved_axis).sum(axis=1, keepdims=True)
    rates = odometry.columns("rollspeed", "pitchspeed", "yawspeed")
    error = 2.0 * turn * np.where(real < 0, -1.0, 1.0) - rates[before] * dt
    swing = 2.0 * np.cross(axis, error)
    error = error + w * swing + np.cross(axis, swing)  # into NED
    velocity = odometry.columns("vx", "vy", "vz")
    mean = 0.5 * (velocity[before] + velocity[after])
    step = odometry.columns("x", "y", "z")
    step = step[after] - step[before] - mean * dt
    return {
        "attitude": np.hypot(error[:, 0], error[:, 1]),
        "heading": np.abs(error[:, 2]),
        "velocity": np.linalg.norm(velocity[after] - velocity[before], axis=1),
        "position": np.hypot(step[:, 0], step[:, 1]),
        "height": np.abs(step[:, 2]),
    }


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

_NEVER_RESOLVED = (10, 24)  # their code is the mode that was refused, and the core that flies from then on


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
    events += [Event(float(t[known[i]]), "event", "took off" if aloft[i] else "landed") for i in turns(aloft)]
    return tuple(events)


def changes(t: Array, armed: BoolArray, modes: npt.NDArray[Any], name: Callable[[int], str]) -> tuple[Event, ...]:
    """Events where the state of arming or the mode is another than before; all (N,), in order of time."""
    if not len(t):
        return ()
    return in_order([*arming(t, armed), *(Event(float(t[i]), "mode", name(int(modes[i]))) for i in (0, *turns(modes)))])


def arming(t: Array, armed: BoolArray) -> Iterator[Event]:
    """Where the vehicle is armed and disarmed (N,), one or more, and that it was armed when the log began."""
    if armed[0]:
        yield Event(float(t[0]), "armed", "armed when the log begins")
    for i in turns(armed):
        word = "armed" if armed[i] else "disarmed"
        yield Event(float(t[i]), word, word)


def turns(states: npt.NDArray[Any]) -> list[int]:
    """Rows at which a state (N,) is another than in the row before."""
    rows: list[int] = (np.flatnonzero(np.diff(states)) + 1).tolist()
    return rows


def dataflash_events(records: Mapping[str, Records], vehicle: Vehicle, dialect: Dialect) -> tuple[Event, ...]:
    """MODE, ARM, EV and ERR of an ArduPilot log."""
    events: list[Event] = []
    for t, mode in numbers(records, "MODE", "ModeNum" if _has(records, "MODE", "ModeNum") else "Mode"):
        name = mode_name(dialect, vehicle.autopilot, vehicle.type, mode)
        if not events or events[-1].text != name:  # a log begins by repeating the present mode
            events.append(Event(t, "mode", name))
    for t, state in numbers(records, "ARM", "ArmState"):
        events.append(Event(t, "armed" if state else "disarmed", "armed" if state else "disarmed"))
    for t, number in numbers(records, "EV", "Id"):
        if number in (_EV_ARMED, _EV_DISARMED):
            if not _has(records, "ARM", "ArmState"):  # older logs
                events.append(Event(t, _EV[number], _EV[number]))
        else:
            events.append(Event(t, "event", _EV.get(number, f"event {number}")))
    # Where damage met the declaration of one of the two columns there are no rows of it.
    subsystems, codes = (numbers(records, "ERR", column) for column in ("Subsys", "ECode"))
    for (t, subsystem), (_, code) in zip(subsystems, codes, strict=False):
        what = _ERR.get(subsystem, f"subsystem {subsystem}")
        bad = code or subsystem in _NEVER_RESOLVED
        events.append(Event(t, "error" if bad else "event", f"{what}: error {code}" if bad else f"{what}: resolved"))
    return in_order(events)


def status_texts(messages: Messages) -> tuple[StatusText, ...]:
    """STATUSTEXT, the chunks of long ones (same id, chunk_seq 0, 1, ...) put together.

    A chunk whose predecessor was lost is a text of its own.
    """
    joined: list[StatusText] = []
    expected = (0, 0)  # id and chunk_seq of what would go on with the last text
    severities, texts, ids, chunks = (messages[n].tolist() for n in ("severity", "text", "id", "chunk_seq"))
    decoded = {raw: words(raw) for raw in set(texts)}  # the same are said over and over
    for at, severity, raw, chunk_id, chunk in zip(messages.t.tolist(), severities, texts, ids, chunks, strict=True):
        text = decoded[raw]
        if chunk_id and (chunk_id, chunk) == expected:
            joined[-1] = StatusText(joined[-1].t, joined[-1].severity, joined[-1].text + text)
        else:
            joined.append(StatusText(at, severity, text))
        expected = (chunk_id, chunk + 1)
    return tuple(joined)


def in_order(events: Iterable[Event]) -> tuple[Event, ...]:
    """The events by time."""
    return tuple(sorted(events, key=lambda event: event.t))


def _has(records: Mapping[str, Records], name: str, field: str) -> bool:
    return name in records and records[name].layout.has_numbers(field)


def numbers(records: Mapping[str, Records], name: str, field: str) -> list[tuple[float, int]]:
    """Time, s, and whole number of each record; none where the log has no such column."""
    if not _has(records, name, field):
        return []
    one = records[name]
    return list(zip(one.t.tolist(), one[field].astype(np.int64).tolist(), strict=True))
