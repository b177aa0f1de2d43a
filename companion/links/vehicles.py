"""Who is on a link: the autopilots by their heartbeats, those that send an IMU, and one that is requested to.

Anybody can make up heartbeats, so that both lists are bounded. Who sends an IMU has a place whoever has spoken before.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from companion.links.requests import Request, Target
from companion.links.stream_manager import StreamManager
from companion.links.vehicle_facts import Reboots, Timesync
from companion.mavlink import Messages
from companion.model import IMU_MESSAGES

_NO_VEHICLES = {5, 6, 18, 26, 27, 30, 31}  # MAV_TYPE: tracker, GCS, companion, gimbal, ADS-B, camera, charging station
_NO_AUTOPILOT = 8  # MAV_AUTOPILOT_INVALID: ground stations, cameras, companions
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
            if autopilot == _NO_AUTOPILOT or kind in _NO_VEHICLES or target in self.known:
                continue
            if len(self.known) >= MOST_VEHICLES and not (target in self._imu_senders or self._chosen(target)):
                self.limited = True
                continue
            self.known[target] = self._names.get(autopilot, f"autopilot {autopilot}").removeprefix("MAV_AUTOPILOT_")
            met.append(target)
        return met


class VehicleSession:
    """Messages and times go in, requests and sentences come out.

    rates: None when nothing may be requested. reported: where sentences for the user are added.
    """

    def __init__(
        self, target: Target, rates: StreamManager | None, reported: list[str], now: float, patience_s: float
    ) -> None:
        self.target = target
        self.rates = rates
        self.timesync = Timesync()
        self.sends_imu = False  # whether an IMU message of it has come
        self._reboots = Reboots()  # where there are no rates, which watch this too
        self.found_at = now  # s
        self._patience_s = patience_s
        self._complained = False
        self._reported = reported

    def receive(self, messages: Mapping[str, Messages], now: float) -> float | None:
        """Take those messages that are of this vehicle: when it has started, s, once after a reboot."""
        own: dict[str, Messages] = {}
        for name, columns in messages.items():
            mine = (columns.sysid == self.target.sysid) & (columns.compid == self.target.compid)
            if mine.any():
                own[name] = columns.select(mine)
        if "TIMESYNC" in own:
            self.timesync.receive(own["TIMESYNC"], now)
        self.sends_imu = self.sends_imu or not own.keys().isdisjoint(IMU_MESSAGES)
        if self.rates is None:
            return self._reboots.receive(own, now)
        return self.rates.receive(own, now)

    def awaits(self, now: float) -> bool:
        """Whether answers are due: those that ask for messages, and the clock's, whose latency counts."""
        return self.rates is not None and (not self.rates.settled or self.timesync.awaits(now))

    def next_requests(self, now: float) -> list[Request]:
        """What to send now."""
        if self.rates is None:
            return []
        candidates = (self.rates.next_request(now), self.timesync.next_request(now))
        return [request for request in candidates if request is not None]

    def complain(self, now: float) -> None:
        """Say, once, that no IMU message comes."""
        if self._complained or now - self.found_at <= self._patience_s or self.sends_imu:
            return
        self._complained = True
        how = "raise the stream rate on the vehicle: SRx_RAW_SENS, or MAVx_RAW_SENS from ArduPilot 4.7"
        why = "--listen-only asks for none" if self.rates is None else "it was asked, and sends none"
        if self.rates is not None and self.rates.signed:
            why = "it signs its messages, and obeys only requests that are signed with its key"
            how = "give the key with --signing-key-file"
        self._reported.append(f"vehicle {self.target} sends no IMU message ({why}): {how}.")
