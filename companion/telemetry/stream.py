"""Flights while they happen: bytes or frames in, in any pieces; flights out, by the same functions as a whole log.

The columns of what has arrived are kept, not the tracks: a law of telemetry (which message is the attitude, where a
boot begins, what a late packet belongs to) looks at all of them, and so gives what it would give for the log. With
`window_s` only the last so many seconds are kept, which bounds the memory, and `recent` looks at the last few seconds,
which bounds the work.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from companion.mavlink import DEFAULT_DIALECT, Collected, Decoder, Frames, Messages, load_dialect
from companion.model import Array, AttitudeTrack, Flight, ImuTrack, Origin, PositionTrack
from companion.telemetry import convert
from companion.telemetry.clock import device_time, reboots, sender_clock
from companion.telemetry.convert import ned_between
from companion.telemetry.flights import NEEDED, flights
from companion.telemetry.split import BusiestSenders, senders

_AHEAD_S = 5.0  # of what is known: a time that is further on than that is none of this flight's, or after a gap
_SAME_S = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class NewestTracks:
    """The end of a flight: samples that are known already, and those that have come since."""

    imu: ImuTrack
    attitude: AttitudeTrack
    position: PositionTrack | None  # None where the flight has none


def sources(flight: Flight, imu: str) -> tuple[str, ...]:
    """The messages that the dead reckoning and its reference come from."""
    attitude = (flight.attitude.source,) if flight.attitude is not None else ()
    return (imu, *attitude, *((flight.position.source,) if flight.position is not None else ()))


def newest_tracks(
    flight: Flight, imu: str, messages: Mapping[str, Messages], *, dequantise: bool = False
) -> NewestTracks | None:
    """The tracks of these messages, by name: the last of those that the flight was made of, and what has come since.

    None where they cannot simply go on from it: after a reboot or a gap, where their times are not those of the
    flight, or where one of them says nothing. Then the whole flight is to be looked at.
    """
    turns = convert.turns(flight.parameters, []) if flight.vehicle.autopilot == "ARDUPILOTMEGA" else convert.UNTURNED
    attitude = position = None
    track: ImuTrack | None = None
    for name in sources(flight, imu):
        sent = _of_vehicle(flight, messages.get(name))
        if sent is None or len(sent) < 2:
            return None
        if name == imu:
            track = convert.imu(sent, flight.vehicle, flight.parameters, turns, [], dequantise=dequantise)
        elif name.startswith("ATTITUDE"):
            attitude = convert.attitude(sent, [], convert.pitch_trim(flight.vehicle, flight.parameters))
        elif name == "LOCAL_POSITION_NED":
            position = convert.position(sent, [])
        else:
            return None  # a position on the globe is seen from where the flight began
    if track is None or attitude is None or flight.attitude is None:
        return None
    pairs = [(track.t, flight.imus[imu].t), (attitude.t, flight.attitude.t)]
    if position is not None and flight.position is not None:
        pairs.append((position.t, flight.position.t))
    return NewestTracks(track, attitude, position) if all(_goes_on(*pair) for pair in pairs) else None


def _of_vehicle(flight: Flight, sent: Messages | None) -> Messages | None:
    """With the times that they carry; None where they carry none."""
    sent = None if sent is None else sent.sent_by(flight.vehicle.sysid, flight.vehicle.compid)
    t = None if sent is None else device_time(sent)
    return None if sent is None or t is None else replace(sent, sender_s=t)


def _goes_on(t: Array, known: Array) -> bool:
    """Whether times (N,) hold the last of those that are known (M,), and all of them are among these or around it."""
    last = known[-1]
    near = int(np.searchsorted(t, last - _SAME_S))
    first = min(known[0], last - _AHEAD_S) - _SAME_S
    return bool(near < len(t) and t[near] < last + _SAME_S and t[0] > first and t[-1] < last + _AHEAD_S)


_SLACK = 1.1  # of the window: trimmed when it has grown to this

_SURE = 25  # packets with a clock after a reboot: fewer may be an echo of old ones
_SAME_BYTES = 100_000  # two reboots nearer than this in the stream are one, seen in other messages

_PERSISTENT = {"PARAM_VALUE": "param_id", "AUTOPILOT_VERSION": None, "GPS_GLOBAL_ORIGIN": None, "HOME_POSITION": None}
"""Sent once and true for long: the last of each sender (and value of a field) is kept whatever the window."""

_TELLING = frozenset({"HEARTBEAT", *_PERSISTENT})
"""Rare messages that say what the vehicle is: `recent` looks at all of them."""


class Stream:
    """What has arrived so far.

    window_s: forget what arrived longer ago, and of a crowd hear only those who say the most; None keeps everything.
    dequantise: see `config/default.toml`.
    """

    def __init__(
        self, *, dialect: str = DEFAULT_DIALECT, window_s: float | None = None, dequantise: bool = False
    ) -> None:
        self.dialect = load_dialect(dialect)
        self.window_s = window_s
        self._dequantise = dequantise
        self._decoder = Decoder(self.dialect, stamped=False)
        self._busiest = BusiestSenders() if window_s is not None else None
        self._collected = Collected(self.dialect, NEEDED)
        self.newest = np.nan  # s UNIX, when the newest message arrived; NaN: none has
        self._begin = np.nan  # s UNIX, of what is kept
        self._reboots: dict[tuple[int, int], list[int]] = {}  # vehicle → where in the stream it has rebooted
        self._firmware: dict[tuple[int, int], str] = {}  # vehicle → what it said it runs, which it may say only once
        self._origins: dict[tuple[int, int, int], Origin] = {}  # vehicle and boot → where its NED began

    def push(self, chunk: bytes, received: float) -> None:
        """Take the next bytes of a link; received: s UNIX."""
        self.add(self._decoder.push(chunk), received)

    def add(self, frames: Frames, received: float | None = None) -> None:
        """Take frames that were decoded elsewhere (`Session.listen`); received: s UNIX, where they have no stamp."""
        if self._busiest is not None:
            frames = self._busiest.admit(frames)
        if received is not None:
            frames = replace(frames, stamp=np.full(len(frames), round(received * 1e6), np.uint64))
        times = self._collected.add(frames)
        times = times[np.isfinite(times)]
        if len(times):
            self.newest = float(np.fmax(self.newest, times.max()))
            self._begin = float(np.fmin(self._begin, times.min()))
        if self.window_s is not None and self.newest - self._begin > _SLACK * self.window_s:
            self._trim(self.newest - self.window_s)

    def flights(self) -> list[Flight]:
        """The flights in everything that is kept: without a window the same as those of the whole log."""
        return self._flights(self._collected.messages())

    def recent(self, seconds: float) -> list[Flight]:
        """The flights in what arrived in the last so many seconds: cheap enough for every frame of a display."""
        since = self.newest - seconds
        every = self._collected.messages()
        late = {n: messages if n in _TELLING else _since(messages, since) for n, messages in every.items()}
        return self._flights({name: messages for name, messages in late.items() if len(messages)})

    def extend(self, flight: Flight, imu: str, since: float) -> NewestTracks | None:
        """What arrived at `since` s UNIX or later of one IMU of a flight, its attitude and its position.

        flight: one of `recent`, made of some of these messages. A tenth of the work of `recent`; None where only that
        can tell (see `newest_tracks`).
        """
        types = self._collected.types
        columns = {name: types[name] for name in sources(flight, imu) if name in types}
        newest = {name: _since(column.messages(), since) for name, column in columns.items()}
        return newest_tracks(flight, imu, newest, dequantise=self._dequantise)

    @property
    def messages(self) -> int:
        """How many messages are kept."""
        return sum(len(column) for column in self._collected.types.values())

    def _flights(self, messages: dict[str, Messages]) -> list[Flight]:
        ordered = dict(sorted(messages.items(), key=lambda item: int(item[1].offset[0])))
        several, _ = flights(dict(ordered), self.dialect, dequantise=self._dequantise)
        if self.window_s is None and messages.keys() == self._collected.types.keys():
            return several
        earlier = {who: self._reboots_before(who, sender) for who, sender in senders(ordered).items()}
        return [self._placed(flight, earlier[flight.vehicle.sysid, flight.vehicle.compid]) for flight in several]

    def _reboots_before(self, who: tuple[int, int], sender: dict[str, Messages]) -> int:
        """How many times a vehicle has rebooted before these messages of it begin."""
        clock = sender_clock(sender)
        places = [int(clock.offset[i]) for i in reboots(clock) if len(clock.t) - i >= _SURE]
        known = self._reboots.setdefault(who, [])
        known += [place for place in places if all(abs(place - other) > _SAME_BYTES for other in known)]
        return len(known) - len(places)

    def _placed(self, flight: Flight, earlier: int) -> Flight:
        """The flight with its number and its origin as they were when it began, perhaps before the window did."""
        vehicle = flight.vehicle
        who = (vehicle.sysid, vehicle.compid)
        if vehicle.firmware:
            self._firmware[who] = vehicle.firmware
        vehicle = replace(vehicle, firmware=self._firmware.get(who, ""))
        flight = replace(flight, vehicle=vehicle, boot=flight.boot + earlier)
        if flight.origin is None:
            return flight
        key = (*who, flight.boot)
        origin = self._origins.setdefault(key, flight.origin)
        position = flight.position
        if origin != flight.origin and position is not None and position.source == "GLOBAL_POSITION_INT":
            position = replace(position, position=position.position + ned_between(origin, flight.origin))
        return replace(flight, origin=origin, position=position)

    def _trim(self, since: float) -> None:
        self.flights()  # which remembers what is said only once: reboots, origin, firmware
        for name, column in self._collected.types.items():
            messages = column.messages()
            lasting = name in _PERSISTENT
            column.keep(_last_of_each(messages, _PERSISTENT[name]) if lasting else ~(messages.log_time < since))
        self._collected.types = {name: column for name, column in self._collected.types.items() if len(column)}
        self._begin = since


def _since(messages: Messages, t: float) -> Messages:
    """Those that arrived at `t` s UNIX or later; all without a time."""
    late = ~(messages.log_time < t)
    first = int(late.argmax()) if late.any() else len(late)
    return messages.select(slice(first, None)).select(late[first:])  # all of them, unless stamps go backwards


def _last_of_each(messages: Messages, field: str | None) -> npt.NDArray[np.int64]:
    """The last of each sender, and of each value of the field."""
    values = messages[field].tolist() if field else [b""] * len(messages)
    keys = zip(messages.sysid.tolist(), messages.compid.tolist(), values, strict=True)
    return np.array(sorted({key: i for i, key in enumerate(keys)}.values()), np.int64)
