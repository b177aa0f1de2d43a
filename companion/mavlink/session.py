"""A companion on a link: hears vehicles, asks one of them for its IMU, records everything, leaves as it came."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from companion.mavlink import requests
from companion.mavlink.frames import Frames
from companion.mavlink.link import Link
from companion.mavlink.messages import Messages, split_messages
from companion.mavlink.rates import Rates
from companion.mavlink.recorder import Recorder
from companion.mavlink.requests import Target
from companion.mavlink.wanted import fit, wanted_from
from companion.mavlink.wishes import State

_HEARTBEAT_S = 1.0
_LEAVING_S = (0.5, 0.4)  # to hear that the intervals are restored, at the first and the second attempt
_IMU = ("RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3", "HIGHRES_IMU")
_HEARD = (
    "HEARTBEAT", "COMMAND_ACK", "MESSAGE_INTERVAL", "PARAM_VALUE", "AUTOPILOT_VERSION", "ATTITUDE", "SCALED_IMU",
    "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT",
)  # fmt: skip
"""The messages whose fields a session reads: those of requests, and those with the vehicle's clock."""
_NO_VEHICLES = {5, 6, 18, 26, 27, 30, 31}  # MAV_TYPE: tracker, GCS, companion, gimbal, ADS-B, camera, charging station
_NO_AUTOPILOT = 8  # MAV_AUTOPILOT_INVALID: ground stations, cameras, companions


@dataclass(frozen=True, slots=True)
class Arriving:
    """One message that is asked for."""

    name: str
    wanted_hz: float
    received_hz: float  # over the last 5 s
    state: State


@dataclass(frozen=True, slots=True)
class Report:
    """How a session stands: plain values, to be read in any thread."""

    link: str
    problem: str  # why nothing is received at present; "" while frames arrive
    vehicles: tuple[str, ...]  # every autopilot heard
    arriving: tuple[Arriving, ...]
    frames: int
    lost: int  # frames missing by sequence
    recording: str  # file; "" for none
    recorded_bytes: int
    recording_problem: str


@dataclass(frozen=True, slots=True)
class Choice:
    """What a session asks for."""

    vehicle: str | None = None  # SYSID or SYSID:COMPID; None: the first that is heard
    imu_hz: float = 100.0
    attitude_hz: float = 50.0
    position_hz: float = 20.0


class Session:
    """Call `step` again and again; then `leave`. `said` collects sentences for the user.

    on_frames: is given what arrives, and when (s UNIX). patience_s: how long a vehicle may send no IMU message before
    that is said.
    """

    def __init__(
        self,
        link: Link,
        *,
        choice: Choice = Choice(),
        recorder: Recorder | None = None,
        on_frames: Callable[[Frames, float], None] | None = None,
        patience_s: float = 10.0,
    ) -> None:
        self.link = link
        self.recorder = recorder
        self.vehicles: dict[Target, str] = {}  # every autopilot heard → its MAV_AUTOPILOT without prefix
        self.rates: Rates | None = None  # of the vehicle that is asked
        self.counts: dict[str, int] = {}  # messages of that vehicle, by name
        self.said: list[str] = []
        self._target: Target | None = None
        self._choice = choice
        self.on_frames = on_frames
        self._patience_s = patience_s
        self._names = link.dialect.enum_names("MAV_AUTOPILOT")
        self._beat = 0.0
        self._found_at = 0.0
        self._told = {"imu": False, "disk": False}

    def step(self, timeout_s: float = 0.1) -> Frames:
        """Receive, record and ask once. Raises InputError when the link carries no MAVLink."""
        frames = self.link.receive(timeout_s)
        now = time.monotonic()
        if self.recorder is not None:
            self.recorder.write(frames)
            if self.recorder.problem and not self._told["disk"]:
                self._told["disk"] = True
                self.said.append(self.recorder.problem)
        if self.on_frames is not None and len(frames):
            self.on_frames(frames, time.time())
        if len(frames):
            self._notice(split_messages(frames, self.link.dialect, _HEARD), now)
        self._speak(now)
        return frames

    def report(self) -> Report:
        """How it stands."""
        link, recorder = self.link, self.recorder
        wishes = self.rates.wishes if self.rates is not None else []
        return Report(
            link=str(link.address),
            problem=link.problem,
            vehicles=tuple(map(str, self.vehicles)),
            arriving=tuple(Arriving(w.name, w.wanted_hz, w.received_hz, w.state) for w in wishes),
            frames=link.health.frames,
            lost=sum(link.health.lost.values()),
            recording=str(recorder.path) if recorder else "",
            recorded_bytes=recorder.size_bytes if recorder else 0,
            recording_problem=recorder.problem if recorder else "",
        )

    def leave(self) -> None:
        """Give the vehicle its intervals back; takes less than a second."""
        if self.link.listen_only or self.rates is None:
            return
        given_back = self.rates.restore()
        for attempt_s in _LEAVING_S:
            if not given_back:
                return
            before = self.counts.get("COMMAND_ACK", 0)
            for request in given_back:
                self.link.send(request)
            expected = sum(request.name == "COMMAND_LONG" for request in given_back)
            until = time.monotonic() + attempt_s
            self.rates = None  # nothing is asked any more
            while self.counts.get("COMMAND_ACK", 0) - before < expected and time.monotonic() < until:
                self.step(0.02)
            if self.counts.get("COMMAND_ACK", 0) - before >= expected:
                return
        self.said.append("the vehicle has not confirmed that its message intervals are as before")

    def _notice(self, messages: Mapping[str, Messages], now: float) -> None:
        if "HEARTBEAT" in messages:
            self._meet(messages["HEARTBEAT"], now)
        target = self._target
        if target is None:
            return
        own: dict[str, Messages] = {}
        for name, found in messages.items():
            mine = (found.sysid == target.sysid) & (found.compid == target.compid)
            if mine.any():
                own[name] = found.select(mine)
                self.counts[name] = self.counts.get(name, 0) + int(mine.sum())
        if self.rates is not None:
            self.rates.hear(own, now)
            self.said += self.rates.said
            self.rates.said.clear()

    def _meet(self, beats: Messages, now: float) -> None:
        who = np.column_stack([beats.sysid, beats.compid, beats["autopilot"], beats["type"]])
        for sysid, compid, autopilot, kind in np.unique(who, axis=0).tolist():
            target = Target(sysid, compid)
            if autopilot == _NO_AUTOPILOT or kind in _NO_VEHICLES or target in self.vehicles:
                continue
            name = self._names.get(autopilot, f"autopilot {autopilot}").removeprefix("MAV_AUTOPILOT_")
            self.vehicles[target] = name
            if self._target is None and self._choice.vehicle in (None, str(sysid), str(target)):
                self._take(target, name, now)
            else:
                self.said.append(f"vehicle {target} ({name}) is heard too; --vehicle {target} would ask it")

    def _take(self, target: Target, name: str, now: float) -> None:
        self._target, self._found_at = target, now
        self.said.append(f"vehicle {target} ({name}) is heard")
        if self.link.listen_only:
            return
        choice = self._choice
        wanted = wanted_from(name, imu_hz=choice.imu_hz, attitude_hz=choice.attitude_hz, position_hz=choice.position_hz)
        fitting, warning = fit(wanted, self.link.dialect, self.link.address.bytes_per_second)
        if warning:
            self.said.append(warning)
        self.rates = Rates(target, fitting, self.link.dialect, own_sysid=self.link.sysid, ardupilot=name != "PX4")

    def _speak(self, now: float) -> None:
        if now - self._beat >= _HEARTBEAT_S:
            self._beat = now
            self.link.send(requests.heartbeat())
        if self.rates is not None and (request := self.rates.next_request(now)):
            self.link.send(request)
        silent = self._target is not None and not any(name in self.counts for name in _IMU)
        if silent and not self._told["imu"] and now - self._found_at > self._patience_s:
            self._told["imu"] = True
            how = "raise the stream rate on the vehicle: SRx_RAW_SENS, or MAVx_RAW_SENS from ArduPilot 4.7"
            why = "--listen-only asks for none" if self.link.listen_only else "it was asked, and sends none"
            self.said.append(f"vehicle {self._target} sends no IMU message ({why}): {how}.")
