"""Who is on a link: the autopilots that are heard, by their heartbeats, and those of them that send an IMU.

Anybody can make up heartbeats, so that both lists are bounded. Who sends an IMU has a place whoever has spoken before.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from companion.links.requests import Target
from companion.mavlink import Messages
from companion.model import IMU_MESSAGES

_NO_VEHICLES = {5, 6, 18, 26, 27, 30, 31}  # MAV_TYPE: tracker, GCS, companion, gimbal, ADS-B, camera, charging station
_NO_AUTOPILOT = 8  # MAV_AUTOPILOT_INVALID: ground stations, cameras, companions
MOST_VEHICLES = 64
"""That are told apart: a sender that makes up a new one with every heartbeat must not fill the memory."""


class Vehicles:
    """Every autopilot heard → its MAV_AUTOPILOT without prefix, in the order of their first heartbeats.

    names: of MAV_AUTOPILOT. chosen: whether the user has named a vehicle, which then has a place in any crowd.
    """

    def __init__(self, names: Mapping[int, str], chosen: Callable[[Target], bool]) -> None:
        self.known: dict[Target, str] = {}
        self.limited = False  # whether more are heard than are known
        self._names, self._chosen = names, chosen
        self._imu_senders: dict[Target, None] = {}

    def receive(self, messages: Mapping[str, Messages]) -> list[Target]:
        """Take what has arrived: the vehicles that are heard for the first time."""
        for name in IMU_MESSAGES:
            if name in messages and len(self._imu_senders) < MOST_VEHICLES:
                self._imu_senders |= dict.fromkeys(Target(*ids) for ids in messages[name].senders())
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
