"""Who is on a link, what each vehicle is and how its clock runs.

The autopilots by their heartbeats, and those that send an IMU: anybody can make up heartbeats, so that both lists are
bounded, and who sends an IMU has a place whoever has spoken before. Firmware and parameters by request, latency by
TIMESYNC, and reboots.

https://mavlink.io/en/services/timesync.html. ArduPilot (GCS_Common.cpp, handle_timesync) and PX4 (mavlink_timesync.cpp)
answer with the ns since their boot.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np

from companion.links import requests
from companion.links.requests import Request, Target
from companion.mavlink import NO_VEHICLES, Messages
from companion.model import IMU_MESSAGES

_NO_AUTOPILOT = 8  # MAV_AUTOPILOT_INVALID: ground stations, cameras, companions
_EVERYBODY = 0  # as a target: who sends as system or component 0 would have all others obey what is asked of it
MOST_VEHICLES = 64
"""That are distinguished: a sender that makes up a new one with every heartbeat must not fill the memory."""


class Vehicles:
    """Every autopilot received → its MAV_AUTOPILOT without prefix, in the order of their first heartbeats.

    names: of MAV_AUTOPILOT. chosen: whether the user has named a vehicle, which then has a place in any crowd.
    """

    def __init__(self, names: Mapping[int, str], chosen: Callable[[Target], bool]) -> None:
        self.known: dict[Target, str] = {}
        self.limited = False  # whether more are received than are known
        self._names, self._chosen = names, chosen
        self._imu_senders: set[tuple[int, int]] = set()

    def receive(self, messages: Mapping[str, Messages]) -> list[Target]:
        """Take what has arrived: the vehicles that are received for the first time."""
        for name in IMU_MESSAGES:
            if name in messages and len(self._imu_senders) < MOST_VEHICLES:
                self._imu_senders |= messages[name].senders().keys()
        return self._meet(messages["HEARTBEAT"]) if "HEARTBEAT" in messages else []

    @property
    def with_imu(self) -> list[Target]:
        """Those that send an IMU."""
        return [target for target in self.known if target in self._imu_senders]

    def _meet(self, beats: Messages) -> list[Target]:
        met = []
        who = np.column_stack([beats.sysid, beats.compid, beats["autopilot"], beats["type"]])
        for sysid, compid, autopilot, kind in np.unique(who, axis=0).tolist():
            target = Target(sysid, compid)
            if autopilot == _NO_AUTOPILOT or kind in NO_VEHICLES or target in self.known or _EVERYBODY in target:
                continue
            if len(self.known) >= MOST_VEHICLES and not (target in self._imu_senders or self._chosen(target)):
                self.limited = True
                continue
            self.known[target] = self._names.get(autopilot, f"autopilot {autopilot}")
            met.append(target)
        return met


_REBOOT_S = 5.0  # a fall of the clock by more than this is a reboot, as in telemetry
_MOST_REBOOTS, _REBOOTS_S = 2, 10.0  # more in that time are no reboots: a flight controller needs seconds for one


class Reboots:
    """Watches one vehicle's clock."""

    def __init__(self) -> None:
        self.two_clocks = False  # reboots as fast as no vehicle can: nothing is a reboot any more
        self._boot_s = 0.0
        self._reboots: list[float] = []  # s, when the clock fell lately

    def receive(self, messages: Mapping[str, Messages], now: float) -> float | None:
        """Take what a vehicle sent: when it has started, s of the steady clock `now`, once after it has."""
        started = None
        for columns in messages.values():
            if "time_boot_ms" in columns.layout.fields and len(columns.rows):  # the session reads those it needs
                boot_s = float(columns["time_boot_ms"][-1]) * 1e-3
                if not boot_s:  # says nothing, and would hide the fall of the next one
                    continue
                if boot_s < self._boot_s - _REBOOT_S and not self.two_clocks:
                    self._reboots = [t for t in self._reboots if now - t < _REBOOTS_S] + [now]
                    self.two_clocks = len(self._reboots) > _MOST_REBOOTS
                    started = now - boot_s
                self._boot_s = boot_s
        return started


PARAMETERS = (
    "AHRS_TRIM_X", "AHRS_TRIM_Y", "AHRS_ORIENTATION", "INS_GYRO_FILTER", "INS_ACCEL_FILTER", "INS_GYR_ID", "INS_GYR2_ID"
)  # fmt: skip
"""ArduPilot's: the frame of the attitude, the IMU's low-pass, and which parts measure."""

PX4_PARAMETERS = ("CAL_GYRO0_ID",)
"""PX4's: the part behind SCALED_IMU."""

_VERSION, _AUTOPILOT_VERSION = "AUTOPILOT_VERSION", 148
_SPACING_S = 0.5


class Facts:
    """Messages and times go in, requests come out. Parameters outlive a reboot: each is known once it was said."""

    def __init__(self, target: Target, parameters: Sequence[str]) -> None:
        version = requests.request_message(target, _AUTOPILOT_VERSION)
        self._unknown = {_VERSION: [version] * 2} | {
            name: [requests.read_parameter(target, name)] * 4 for name in parameters
        }  # message or parameter → what may still be sent for it
        self._next = 0.0

    def receive(self, messages: Mapping[str, Messages]) -> None:
        """Take note of what the vehicle said."""
        if "PARAM_VALUE" in messages:
            for raw in messages["PARAM_VALUE"]["param_id"].tolist():
                self._unknown.pop(raw.split(b"\0")[0].decode("ascii", "replace"), None)
        if _VERSION in messages:
            self._unknown.pop(_VERSION, None)

    def next_request(self, now: float) -> Request | None:
        """What to send now, if anything."""
        if now < self._next:
            return None
        self._next = now + _SPACING_S
        return next((attempts.pop() for attempts in self._unknown.values() if attempts), None)


_QUICK_S, _SLOW_S = 1.0, 5.0  # between two questions: until enough are answered, and after that
_ANSWER_S = 0.2  # within which an answer is due
_ENOUGH = 10
_KEPT = 20
_STEP_S = 0.5  # between two answers: the clock has been set, or the vehicle has rebooted
_RATE_AFTER_S = 60.0  # before a clock's rate stands out from the jitter of the link


@dataclass(frozen=True, slots=True)
class Clock:
    """What is known of a vehicle's clock."""

    latency_ms: float  # half of the way there and back, median; the 20 ms that a link gathers for are in it
    booted: float  # s UNIX, by our clock, when the vehicle's read zero
    rate_ppm: float | None  # by how much it runs faster than ours; None: not yet known


class Timesync:
    """Asks and listens. Times in s of a steady clock, `unix` is what our clock says of the day."""

    def __init__(self) -> None:
        self._due = 0.0
        self._requested: deque[int] = deque(maxlen=4)  # ns, questions that may still be answered
        self._answers: deque[tuple[float, float]] = deque(maxlen=_KEPT)  # s: there and back; vehicle's clock minus ours
        self._first: tuple[float, float] | None = None  # s when, and what the difference was
        self._newest = 0.0

    def next_request(self, now: float) -> Request | None:
        """What to send now, if anything."""
        if now < self._due:
            return None
        self._due = now + (_QUICK_S if len(self._answers) < _ENOUGH else _SLOW_S)
        self._requested.append(int(now * 1e9))
        return requests.timesync(self._requested[-1])

    def awaits(self, now: float) -> bool:
        """Whether an answer is due."""
        return bool(self._requested) and now - self._requested[-1] * 1e-9 < _ANSWER_S

    def receive(self, answers: Messages, now: float) -> None:
        """Take TIMESYNC messages of the vehicle; those that answer somebody else are passed over."""
        for theirs, ours in zip(answers["tc1"].tolist(), answers["ts1"].tolist(), strict=True):
            if theirs == 0 or ours not in self._requested:
                continue
            self._requested.remove(ours)
            way = now - ours * 1e-9
            difference = theirs * 1e-9 - (ours * 1e-9 + way / 2)
            if self._answers and abs(difference - self._answers[-1][1]) > _STEP_S:
                self._answers.clear()
                self._first = None
            self._answers.append((way, difference))
            self._first = self._first or (now, difference)
            self._newest = now

    def clock(self, now: float, unix: float) -> Clock | None:
        """What is known; None before the first answer."""
        if not self._answers or self._first is None:
            return None
        _, difference = min(self._answers)  # the fastest is the truest
        since, before = self._first
        elapsed = self._newest - since
        rate = 1e6 * (difference - before) / elapsed if elapsed > _RATE_AFTER_S else None
        latency = median(way for way, _ in self._answers) / 2
        return Clock(1e3 * latency, unix - (now + difference), rate)
