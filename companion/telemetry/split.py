"""Vehicles and boots: which packets belong to which flight, and who is listened to where too many send."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from companion.mavlink import NO_VEHICLES, Dialect, Frames, Index, Messages
from companion.model import IMU_MESSAGES, Array, Vehicle, counted
from companion.telemetry.clock import (
    ON_LINK,
    UNIX_S,
    Clock,
    device_time,
    left_out,
    off_course,
    reboots,
    sender_clock,
    stale_start,
    steps_back,
)
from companion.telemetry.parameters import UNKNOWN, banner, release, words
from companion.telemetry.samples import BoolArray, majority

Sender = dict[str, Messages]

STATE_MESSAGES = {
    *IMU_MESSAGES, "ATTITUDE", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT",
}  # fmt: skip
"""Messages of which each makes its sender a vehicle."""

_VEHICLE_MESSAGES = STATE_MESSAGES | {"SYS_STATUS", "VFR_HUD", "PARAM_VALUE", "EXTENDED_SYS_STATE"}

_REPORTED_STEPS = 3  # of the clock, in a note each


@dataclass(frozen=True, slots=True)
class NonVehicle:
    """A component that sends in the log and is no vehicle."""

    sysid: int
    compid: int
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class Boot:
    """The packets of one boot of one vehicle, and its clock."""

    vehicle: Vehicle
    number: int  # 1 for the first in the log
    messages: Sender  # for its taker to empty
    clock: Clock
    notes: tuple[str, ...]


MOST_SENDERS = 256
"""That are looked at, those with the most messages: 65,025 ids can be made up, and no swarm has so many."""


def senders(messages: Mapping[str, Messages]) -> dict[tuple[int, int], Sender]:
    """Messages (by name, each in the order of arrival) by (sysid, compid) of who sent them; see `MOST_SENDERS`."""
    counts = Counter[tuple[int, int]]()
    for one in messages.values():
        counts.update(one.senders())
    senders = {who for who, _ in counts.most_common(MOST_SENDERS)}
    by_sender: dict[tuple[int, int], Sender] = {}
    for name, one in messages.items():
        for who in senders & one.senders().keys():
            by_sender.setdefault(who, {})[name] = one.sent_by(*who)
    return by_sender


def describe(ids: tuple[int, int], sender: Sender, dialect: Dialect, notes: list[str]) -> Vehicle | NonVehicle:
    """The vehicle that a sender is, or why it is none. What is decided on the way is noted.

    A heartbeat alone makes no vehicle, and one that contradicts the others changes none: the majority counts.
    """
    states = STATE_MESSAGES & sender.keys()
    autopilot = kind = UNKNOWN
    if (beats := sender.get("HEARTBEAT")) is not None:
        alike = beats.select(majority(beats["autopilot"], beats["type"]))
        numbers = int(alike["autopilot"][0]), int(alike["type"][0])
        autopilot = dialect.enum_names("MAV_AUTOPILOT").get(numbers[0], str(numbers[0]))
        kind = dialect.enum_names("MAV_TYPE").get(numbers[1], str(numbers[1]))
        if numbers[1] in NO_VEHICLES:
            return NonVehicle(*ids, f"its heartbeats say {kind}")
        if autopilot == "INVALID" and not states:
            return NonVehicle(*ids, f"its heartbeats ({kind}) say that it is no autopilot")
        if not _VEHICLE_MESSAGES & sender.keys():
            return NonVehicle(*ids, f"heartbeats ({autopilot} {kind}), but no telemetry of a vehicle")
        if others := len(beats) - len(alike):
            notes.append(f"{others} of {len(beats)} heartbeats contradict the others ({autopilot} {kind}): ignored")
    elif not states:
        return NonVehicle(*ids, "no heartbeat, no attitude, no IMU, no position")
    firmware = _banner(sender)
    if kind == UNKNOWN and firmware is not None:
        autopilot, (kind, _) = "ARDUPILOTMEGA", firmware
    versions = sender.get("AUTOPILOT_VERSION")
    version = release(0 if versions is None else int(versions["flight_sw_version"][-1]))
    version = version or (firmware[1] if firmware else "")
    return Vehicle(*ids, autopilot=autopilot, type=kind, firmware=version)


def boots(vehicle: Vehicle, sender: Sender) -> Iterator[Boot]:
    """The vehicle's packets, cut where its clock starts again. `sender` is taken over: it is empty afterwards.

    Of the last boot, which mostly is the only one, nothing is kept here, so that its taker can let go of what it has
    read.
    """
    astray = _drop_off_course(sender)
    clock = sender_clock(sender)
    starts = reboots(clock)
    edges = [0, *starts, len(clock.t)]
    places = {name: [0, *(_first_of(m, clock, i) for i in starts), len(m)] for name, m in sender.items()}
    for number, (first, last) in enumerate(pairwise(edges), 1):
        notes = astray if number == 1 else []
        if number > 1:
            notes.append(
                f"boot {number} begins where the device clock fell from "
                f"{clock.t[first - 1]:.1f} s to {clock.t[first]:.1f} s"
            )
        own = clock[first:last]
        stale = stale_start(own)
        if stale:
            notes.append(
                f"{counted(stale, 'stale packet')} at the start: the device clock jumps from "
                f"{own.t[stale - 1]:.1f} s to {own.t[stale]:.1f} s while log time stands still"
            )
            own = own[stale:]
        cut = {name: m.select(slice(*places[name][number - 1 : number + 1])) for name, m in sender.items()}
        if last == len(clock.t):
            sender.clear()
        if stale:
            cut = {name: m.select(m.offset >= own.offset[0]) for name, m in cut.items()}
        cut, own, stepped = _without_steps_back(cut, own)
        cut = {n: m for n, m in cut.items() if len(m)}
        yield Boot(vehicle, number, cut, own, (*notes, *stepped))


def _drop_off_course(sender: Sender) -> list[str]:
    """Read the messages' own times, and let go of those that leave the flight's course; a note of each such type."""
    times = {name: own for name, m in sender.items() if (own := device_time(m)) is not None}
    sender.update({name: replace(sender[name], sender_s=t) for name, t in times.items()})
    apart = off_course(times, ON_LINK)
    sender.update({name: sender[name].select(~mask) for name, mask in apart.items()})
    return left_out(times, apart)


def _first_of(messages: Messages, clock: Clock, packet: int) -> int:
    """Index of the first message that belongs to the boot which begins with this packet of the clock.

    Between the last clock packet of one boot and the first of the next, a message goes to the one whose time is nearer
    to its own; one without a time of its own, to the one that is nearer in the log.
    """
    low, high = np.searchsorted(messages.offset, clock.offset[[packet - 1, packet]], side="right")
    between = slice(int(low), int(high))
    own = device_time(messages.select(between))
    if own is None or (own > UNIX_S).any():
        own, old, new = messages.log_time[between], clock.log_time[packet - 1], clock.log_time[packet]
    else:
        old, new = clock.t[packet - 1], clock.t[packet]
    later = np.flatnonzero(np.abs(own - new) <= np.abs(own - old))
    return int(low + later[0]) if len(later) else int(high)


def _without_steps_back(sender: Sender, clock: Clock) -> tuple[Sender, Clock, list[str]]:
    """Where the clock was set back without a reboot, the packets that it then passes again are left out."""
    back = np.asarray(steps_back(clock), np.intp)
    if not len(back):
        return sender, clock, []
    offset = clock.offset[back]
    passed_again = np.append(np.minimum.accumulate(clock.t[back][::-1])[::-1], np.inf)  # from when on, by what follows

    def stays(at: Index, t: Array) -> BoolArray:
        return np.asarray(t < passed_again[np.searchsorted(offset, at, side="right")])

    sender = {n: m.select(stays(m.offset, clock.at(m.offset))) for n, m in sender.items()}
    notes = [
        f"the device clock was set back from {clock.t[i - 1]:.2f} s to {clock.t[i]:.2f} s without a reboot: "
        "what it had said of that time before is left out"
        for i in back[:_REPORTED_STEPS]
    ]
    if len(back) > _REPORTED_STEPS:
        notes.append(
            f"the device clock was set back {counted(len(back) - _REPORTED_STEPS, 'time')} more: the same is done there"
        )
    return sender, clock[stays(clock.offset, clock.t)], notes


def _banner(sender: Sender) -> tuple[str, str] | None:
    """Type and version by ArduPilot's banner, which is sent with the parameters."""
    if (sent := sender.get("STATUSTEXT")) is None:
        return None
    return banner(map(words, dict.fromkeys(sent["text"].tolist())))  # the same are sent over and over


_MOST_SENDERS = 64  # that are all listened to
_MOST_IN_A_CROWD = 16  # where there are more: those with the most frames
_LEAST_SHARE = 0.005  # of the frames, that such a one has: a vehicle at 250 Hz beside 50,000 made-up frames/s
_ROUND = 2000  # frames between two counts
_FADED = 0.5  # frames: half of a count is forgotten at each of the next


class BusiestSenders:
    """Lets the frames of at most so many senders through; up to 64, and there is no crowd, all of them."""

    def __init__(self) -> None:
        self._counts = np.zeros(1 << 16)  # by sysid << 8 | compid, fading
        self._chosen: BoolArray | None = None  # by the same; None: everybody
        self._frames = 0  # since the last count

    def admit(self, frames: Frames) -> Frames:
        """Those of the frames whose senders are listened to."""
        if not len(frames):
            return frames
        sender = frames.sysid.astype(np.intp) << 8 | frames.compid
        someone_new = not self._counts[sender].all()
        np.add.at(self._counts, sender, 1.0)
        self._frames += len(frames)
        if self._frames >= _ROUND or (someone_new and self._chosen is None):
            self._choose()
        if self._frames >= _ROUND:
            self._frames = 0
            self._counts *= 0.5
            self._counts[self._counts < _FADED] = 0.0
        return frames if self._chosen is None else frames.select(self._chosen[sender])

    def _choose(self) -> None:
        self._chosen = None
        if np.count_nonzero(self._counts) > _MOST_SENDERS:
            most = np.argpartition(self._counts, -_MOST_IN_A_CROWD)[-_MOST_IN_A_CROWD:]
            self._chosen = np.zeros(len(self._counts), np.bool_)
            self._chosen[most[self._counts[most] >= _LEAST_SHARE * self._counts.sum()]] = True
