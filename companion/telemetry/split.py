"""Vehicles and boots: which packets of a log belong to which flight."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from companion.mavlink import Dialect, Log, Messages
from companion.telemetry.clock import Clock, reboots, sender_clock, stale_start
from companion.tracks import Vehicle

Sender = dict[str, Messages]

_STATE_MESSAGES = {
    "RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3", "HIGHRES_IMU", "ATTITUDE", "ATTITUDE_QUATERNION",
    "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT",
}  # fmt: skip
_VEHICLE_MESSAGES = _STATE_MESSAGES | {"SYS_STATUS", "VFR_HUD", "PARAM_VALUE", "EXTENDED_SYS_STATE"}

_NOT_VEHICLES = {"GCS", "ANTENNA_TRACKER", "ONBOARD_CONTROLLER", "GIMBAL", "ADSB", "CAMERA", "CHARGING_STATION"}


@dataclass(frozen=True, slots=True, eq=False)
class Boot:
    """The packets of one boot of one vehicle, and its clock."""

    vehicle: Vehicle
    number: int  # 1 for the first in the log
    messages: Sender
    clock: Clock
    notes: tuple[str, ...]


def senders(log: Log) -> dict[tuple[int, int], Sender]:
    """The log's messages by (sysid, compid) of who sent them."""
    found: dict[tuple[int, int], Sender] = {}
    for name, messages in log.messages.items():
        who = messages.sysid.astype(np.uint16) << 8 | messages.compid
        for key in np.unique(who):
            found.setdefault((int(key) >> 8, int(key) & 255), {})[name] = messages.select(who == key)
    return found


def describe(ids: tuple[int, int], sender: Sender, dialect: Dialect) -> Vehicle | None:
    """The vehicle that a sender is, or None for ground stations, radios, cameras and companions.

    A heartbeat alone makes no vehicle, and one that contradicts the others changes none: the majority counts.
    """
    autopilot = kind = "UNKNOWN"
    if "HEARTBEAT" in sender and len(sender["HEARTBEAT"]):
        beats = sender["HEARTBEAT"]
        pairs, counts = np.unique(np.column_stack([beats["autopilot"], beats["type"]]), axis=0, return_counts=True)
        code = pairs[np.argmax(counts)]
        autopilot = _enum_name(dialect, "MAV_AUTOPILOT", int(code[0]))
        kind = _enum_name(dialect, "MAV_TYPE", int(code[1]))
        if (autopilot == "INVALID" or kind in _NOT_VEHICLES) and not _STATE_MESSAGES & sender.keys():
            return None
        if kind in _NOT_VEHICLES or not _VEHICLE_MESSAGES & sender.keys():
            return None
    elif not _STATE_MESSAGES & sender.keys():
        return None
    return Vehicle(*ids, autopilot=autopilot, type=kind, firmware=_firmware(sender))


def boots(vehicle: Vehicle, sender: Sender) -> Iterator[Boot]:
    """The vehicle's packets, cut where its clock starts again."""
    clock = sender_clock(sender)
    edges = [0, *reboots(clock), len(clock.t)]
    for number, (first, last) in enumerate(pairwise(edges), 1):
        notes: list[str] = []
        if number > 1:
            notes.append(
                f"boot {number} begins where the device clock fell from "
                f"{clock.t[first - 1]:.1f} s to {clock.t[first]:.1f} s"
            )
        own = Clock(clock.offset[first:last], clock.t[first:last], clock.log_time[first:last])
        stale = stale_start(own)
        if stale:
            notes.append(
                f"{stale} packets at the start are stale: time_boot_ms jumps from {own.t[stale - 1]:.1f} s to "
                f"{own.t[stale]:.1f} s while log time stands still"
            )
            own = Clock(own.offset[stale:], own.t[stale:], own.log_time[stale:])
        begin = 0 if number == 1 and not stale else int(own.offset[0]) if len(own.t) else 0
        end = int(clock.offset[last]) if last < len(clock.t) else np.iinfo(np.int64).max
        cut = {name: m.select((m.offset >= begin) & (m.offset < end)) for name, m in sender.items()}
        yield Boot(vehicle, number, {n: m for n, m in cut.items() if len(m)}, own, tuple(notes))


def _enum_name(dialect: Dialect, enum: str, value: int) -> str:
    names: Mapping[int, str] = dialect.enum_names(enum)
    return names.get(value, f"{enum}_{value}").removeprefix(f"{enum}_")


def _firmware(sender: Sender) -> str:
    """ "4.7.0" from AUTOPILOT_VERSION (major, minor, patch, type, one byte each), else from the banner, else ""."""
    versions = sender.get("AUTOPILOT_VERSION")
    if versions is not None and (code := int(versions["flight_sw_version"][-1])):
        return f"{code >> 24}.{code >> 16 & 255}.{code >> 8 & 255}"
    if "STATUSTEXT" in sender:  # ArduPilot's banner, sent with the parameters: "ArduCopter V4.7.0-dev (90700977)"
        for text in sender["STATUSTEXT"]["text"].tolist():
            if banner := re.match(rb"(?:Ardu\w+|Rover|Blimp|AntennaTracker) V(\d[\w.-]*)", text):
                return banner[1].decode("ascii")
    return ""
