"""A companion on a link: hears vehicles, asks one of them for its IMU, records everything, leaves as it came."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from companion.links import requests
from companion.links.link import Link
from companion.links.recordings import Recorder
from companion.links.request_table import Choice, StreamRequest, desired_from, fit
from companion.links.requests import Request, Target
from companion.links.restoration import OriginalRatesFile, original_rates_path
from companion.links.stream_manager import StreamManager
from companion.links.vehicles import MOST_VEHICLES, Clock, Reboots, Timesync, Vehicles
from companion.mavlink import Frames, Messages, split_messages
from companion.model import IMU_MESSAGES, CompanionError

_log = logging.getLogger(__name__)
_HEARTBEAT_S = 1.0
_LEAVING_S = (0.5, 0.4, 0.3, 0.3)  # to hear that the intervals are restored, at each attempt
_GATHER_S, _GATHER_CALM_S = 0.02, 0.08  # s, for one decoding: while answers are due, and else
_SPACING_S = 0.005  # between requests then: a burst would overrun a receive buffer
_READ = (
    "HEARTBEAT", "COMMAND_ACK", "MESSAGE_INTERVAL", "PARAM_VALUE", "AUTOPILOT_VERSION", "ATTITUDE", "SCALED_IMU",
    "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "TIMESYNC",
)  # fmt: skip
"""The messages whose fields a session reads: those of requests, and those with the vehicle's clock."""
_IMU_WITHIN_S = 3.0  # of the request; who sends none makes room for a vehicle that does


@dataclass(frozen=True, slots=True)
class Report:
    """How a session stands: plain values, to be read in any thread."""

    link: str
    problem: str  # why nothing is received at present; "" while frames arrive
    arriving: tuple[StreamRequest, ...]  # as they stood; where several vehicles send, by their ids and names
    frames: int
    lost_by: Mapping[str, float]  # SYSID:COMPID of each with requests → share of its frames that is missing, 0 to 1
    rejected: int  # frames dropped because they carry no signature, or none of our key
    clock: Clock | None  # of the first vehicle with requests
    recording: str  # file; "" for none
    recorded_bytes: int
    recording_problem: str


class Session:
    """Call `step` again and again; then `leave`. `said` collects sentences for the user.

    patience_s: how long a vehicle may send no IMU message before that is said. remember: keep what a vehicle sent
    before in the user's state folder, so that it can be given back after this program was killed.
    """

    def __init__(
        self,
        link: Link,
        *,
        choice: Choice | None = None,
        recorder: Recorder | None = None,
        patience_s: float = 10.0,
        remember: bool = False,
    ) -> None:
        self.link = link
        self.recorder = recorder
        self.requested: dict[Target, VehicleSession] = {}  # those of them that are ours, the first first
        self.reported: list[str] = []
        self._choice = choice or Choice()
        self._listeners: list[Callable[[Frames, float], None]] = []
        self._patience_s = patience_s
        self._remember = remember
        self._vehicles = Vehicles(link.dialect.enum_names("MAV_AUTOPILOT"), self._choice.names)
        self.vehicles: Mapping[Target, str] = self._vehicles.known  # every autopilot received, by its MAV_AUTOPILOT
        self._left: list[VehicleSession] = []  # that had requests before another had: restored at the end
        self._beat = 0.0
        self._epoch = time.time() - time.monotonic()
        self._leaving = False
        self._reported_disk = self._reported_limit = False
        self._excused: set[str] = set()

    def listen(self, listener: Callable[[Frames, float], None]) -> None:
        """Give whatever arrives to one more listener, and when: s UNIX, by a clock that only goes forward."""
        self._listeners.append(listener)

    def step(self, timeout_s: float = 0.1) -> Frames:
        """Receive, record and ask once. Raises InputError when the link carries no MAVLink."""
        frames = self.link.receive(timeout_s, self._gather_s)
        now = time.monotonic()
        if self.recorder is not None:
            self.recorder.write(frames)
            if self.recorder.problem and not self._reported_disk:
                self._reported_disk = True
                self.reported.append(self.recorder.problem)
        self.beside(lambda: self._deal_with(frames, now))
        return frames

    @property
    def _gather_s(self) -> float:
        """For how long what arrives is gathered, to be decoded together.

        Not longer than a device can wait: 4 kB, which Linux keeps for a serial port, are full after 44 ms at 921600
        baud.
        """
        now = time.monotonic()
        calm = not (self._leaving or self.link.address.kind == "serial")
        return _GATHER_CALM_S if calm and not any(one.awaits(now) for one in self.requested.values()) else _GATHER_S

    def beside(self, work: Callable[[], None]) -> None:
        """Do something beside the recording: whatever breaks in it, the next frame is recorded."""
        try:
            work()
        except CompanionError:
            raise
        except Exception as error:  # noqa: BLE001
            kind = type(error).__name__
            if kind not in self._excused:  # each kind is said once
                self._excused.add(kind)
                _log.debug("beside the recording", exc_info=error)
                self.reported.append(f"what was heard could not be dealt with ({kind}: {error}); the recording goes on")

    def _deal_with(self, frames: Frames, now: float) -> None:
        if len(frames):
            for listener in self._listeners:
                listener(frames, self._epoch + now)
            self._notice(split_messages(frames, self.link.dialect, _READ), now)
        self._speak(now)

    @property
    def lost(self) -> dict[str, float]:
        """SYSID:COMPID of each vehicle with requests → share of its frames that is missing by their sequence.

        Of nobody else: of cameras, ground stations and other vehicles an autopilot or a router passes on a part.
        """
        health = self.link.health
        shares = {}
        for target in self.requested:
            lost, received = health.lost.get(target, 0), health.received.get(target, 0)
            shares[str(target)] = lost / (lost + received) if received else 0.0
        return shares

    @property
    def rates(self) -> StreamManager | None:
        """Of the first vehicle with requests."""
        return next((vehicle.rates for vehicle in self.requested.values()), None)

    def report(self) -> Report:
        """How it stands."""
        link, recorder = self.link, self.recorder
        several = len(self.requested) > 1
        arriving = tuple(
            replace(message, name=f"{vehicle.target} {message.name}" if several else message.name)
            for vehicle in self.requested.values()
            if vehicle.rates
            for message in vehicle.rates.stream_requests
        )
        first = next(iter(self.requested.values()), None)
        return Report(
            link=str(link.address),
            problem=link.problem,
            arriving=arriving,
            frames=link.health.frames,
            lost_by=self.lost,
            rejected=link.health.unsigned + link.health.wrongly_signed,
            clock=first.timesync.clock(time.monotonic(), time.time()) if first else None,
            recording=str(recorder.path) if recorder else "",
            recorded_bytes=recorder.size_bytes if recorder else 0,
            recording_problem=recorder.problem if recorder else "",
        )

    def leave(self) -> bool:
        """Restore every vehicle's intervals; takes `_LEAVING_S`. Returns whether each vehicle has confirmed that.

        What is not confirmed is said, and kept for the next run where the session remembers.
        """
        self._leaving = True  # nothing is requested any more
        if self.link.listen_only:
            return True
        restorations = [one.rates.restore() for one in (*self.requested.values(), *self._left) if one.rates]
        until = time.monotonic()
        for attempt_s in _LEAVING_S:
            until += attempt_s
            left = [request for restoration in restorations for request in restoration.requests()]
            for i in range(0, len(left), 2):  # a request, and the question whether it was taken
                for request in left[i : i + 2]:
                    self.link.send(request)
                self.step(_SPACING_S)
            while not all(restoration.complete for restoration in restorations) and time.monotonic() < until:
                self.step(0.02)
        self.reported += [sentence for restoration in restorations if (sentence := restoration.end())]
        return not any(restoration.unconfirmed for restoration in restorations)

    def _notice(self, messages: Mapping[str, Messages], now: float) -> None:
        for target in self._vehicles.receive(messages):
            self._meet(target, now)
        if self._vehicles.limited and not self._reported_limit:
            self._reported_limit = True
            self.reported.append(
                f"{MOST_VEHICLES} vehicles are heard, and more: the rest is recorded, but neither asked nor shown, "
                "unless it sends an IMU or is named by --vehicle"
            )
        for target, vehicle in self.requested.items():
            if vehicle.rates is not None:
                vehicle.rates.signed = target in self.link.health.signers
                vehicle.rates.lost_share = self.link.lost_lately(target)
            if (started := vehicle.receive(messages, now)) is not None:
                self.link.restarted(target, started)
        for vehicle in self._left:
            vehicle.receive(messages, now)
        self._prefer_imu(now)

    def _meet(self, target: Target, now: float) -> None:
        chosen = self._choice.vehicle
        if chosen == "all" or (not self.requested and (chosen is None or self._choice.names(target))):
            self._take(target, now)
        else:
            name = self.vehicles[target]
            self.reported.append(f"vehicle {target} ({name}) is heard too; --vehicle {target} would ask it")

    def _prefer_imu(self, now: float) -> None:
        """Ask a vehicle that sends an IMU in place of one that sends none: anybody can make up heartbeats."""
        if self._choice.vehicle is not None or self._leaving:
            return
        for vehicle in list(self.requested.values()):
            known = {vehicle.target, *(left.target for left in self._left)}
            better = next((target for target in self._vehicles.with_imu if target not in known), None)
            if better is not None and not vehicle.sends_imu and now - vehicle.found_at > _IMU_WITHIN_S:
                self.reported.append(
                    f"vehicle {vehicle.target} sends no IMU message, and {better} does: asking that one"
                )
                self._left.append(self.requested.pop(vehicle.target))
                self._take(better, now)

    def _take(self, target: Target, now: float) -> None:
        name = self.vehicles[target]
        self.reported.append(f"vehicle {target} ({name}) is heard")
        rates = None
        if not self.link.listen_only:
            desired = desired_from(name, self._choice)
            fitting, warning = fit(desired, self.link.dialect, self.link.address.bytes_per_second)
            if warning:
                self.reported.append(warning)
            path = original_rates_path(str(self.link.address), str(target)) if self._remember else None
            earlier = OriginalRatesFile(path)
            rates = StreamManager(
                target,
                fitting,
                self.link.dialect,
                own_sysid=self.link.sysid,
                ardupilot=name != "PX4",
                earlier=earlier,
                reported=self.reported,
            )
            if earlier.known:
                self.reported.append(
                    f"an earlier companion on this link has not restored all message intervals of vehicle {target}: "
                    "they are restored when this one ends"
                )
        self.requested[target] = VehicleSession(target, rates, self.reported, now, self._patience_s)

    def _speak(self, now: float) -> None:
        if now - self._beat >= _HEARTBEAT_S:
            self._beat = now
            self.link.send(requests.heartbeat())
        if self._leaving:
            return
        for vehicle in self.requested.values():
            for request in vehicle.next_requests(now):
                self.link.send(request)
            vehicle.complain(now)


@dataclass(slots=True)
class VehicleSession:
    """Messages and times go in, requests and sentences come out."""

    target: Target
    rates: StreamManager | None  # None when nothing may be requested
    reported: list[str]  # where sentences for the user are added
    found_at: float  # s
    patience_s: float  # after which it is said that no IMU message comes
    timesync: Timesync = field(default_factory=Timesync)
    sends_imu: bool = False  # whether an IMU message of it has come
    complained: bool = False  # whether that none comes has been said
    reboots: Reboots = field(default_factory=Reboots)  # where there are no rates, which watch this too

    def receive(self, messages: Mapping[str, Messages], now: float) -> float | None:
        """Take those messages that are of this vehicle: when it has started, s, once after a reboot."""
        own: dict[str, Messages] = {}
        for name, columns in messages.items():
            if len(sent := columns.sent_by(*self.target)):
                own[name] = sent
        if "TIMESYNC" in own:
            self.timesync.receive(own["TIMESYNC"], now)
        self.sends_imu = self.sends_imu or not own.keys().isdisjoint(IMU_MESSAGES)
        if self.rates is None:
            return self.reboots.receive(own, now)
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
        if self.complained or now - self.found_at <= self.patience_s or self.sends_imu:
            return
        self.complained = True
        how = "raise the stream rate on the vehicle: SRx_RAW_SENS, or MAVx_RAW_SENS from ArduPilot 4.7"
        why = "--listen-only asks for none" if self.rates is None else "it was asked, and sends none"
        if self.rates is not None and self.rates.signed:
            why = "it signs its messages, and obeys only requests that are signed with its key"
            how = "give the key with --signing-key-file"
        self.reported.append(f"vehicle {self.target} sends no IMU message ({why}): {how}.")
