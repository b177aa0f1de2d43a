"""A vehicle's own message intervals: kept in a file before the first request, and given back.

A companion that is killed (kill -9, power) or has lost its link leaves its own rates behind, and the next one would
take them for the vehicle's. So they are written down before the first request changes them, one file per vehicle and
link in the user's state folder; a message is removed from it when the vehicle has confirmed that it is as before.

An acknowledgement names the command and not the message, so that one that is lost, or late (through MAVProxy), cannot
be distinguished from that of another message. Each request is therefore followed by GET_MESSAGE_INTERVAL, whose answer
names it.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import sys
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass
from math import ceil
from pathlib import Path

from companion.links import requests
from companion.links.request_table import STREAMS
from companion.links.requests import Request, Target
from companion.mavlink import Messages

_SAME = 0.1  # by which an interval may differ from the requested one and still be it ...
_SAME_US = 1000  # ... and so many µs: ArduPilot keeps whole ms
_LONGEST_US = 2**31  # of MESSAGE_INTERVAL
_MOST_HZ = 2**16  # of REQUEST_DATA_STREAM


@dataclass(frozen=True, slots=True)
class OriginalRate:
    """One message before the companion's first request for it."""

    found_us: int | None  # interval as MESSAGE_INTERVAL says it; None: the vehicle did not say
    found_hz: float  # what arrived
    asked_us: int  # the interval that the companion requested
    by_stream: bool = False  # requested with REQUEST_DATA_STREAM

    @property
    def is_whole(self) -> bool:
        """Whether every value is one that a vehicle says: a file may hold anything."""
        intervals = [one for one in (self.found_us, self.asked_us) if one is not None]
        whole = all(isinstance(one, int) and abs(one) < _LONGEST_US for one in intervals) and self.asked_us is not None
        return whole and isinstance(self.found_hz, int | float) and 0 <= self.found_hz < _MOST_HZ


class OriginalRatesFile:
    """What one vehicle on one link sent before: read when it is made, written whenever something is added.

    path: None keeps nothing.
    """

    def __init__(self, path: Path | None = None) -> None:
        self.path = path
        self.known: dict[str, OriginalRate] = _read(path) if path is not None else {}
        self.inherited = frozenset(self.known)  # that an earlier companion has left behind
        self.problem = ""  # why nothing can be written, for the user

    def note(self, name: str, earlier: OriginalRate) -> None:
        """Write down one message before it is requested."""
        if self.known.get(name) == earlier:
            return
        self.known[name] = earlier
        self._write()

    def forget(self, names: Collection[str]) -> None:
        """Those messages are as before."""
        known = {name: one for name, one in self.known.items() if name not in names}
        if known != self.known:
            self.known = known
            self._write()

    def _write(self) -> None:
        if self.path is None:
            return
        if not self.known:
            with contextlib.suppress(OSError):
                self.path.unlink(missing_ok=True)
            return
        part = self.path.with_suffix(f".{os.getpid()}")
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            part.write_text(json.dumps({name: asdict(one) for name, one in self.known.items()}, indent=1))
            part.replace(self.path)
        except OSError as error:
            with contextlib.suppress(OSError):  # what a full disk has taken of it
                part.unlink(missing_ok=True)
            self.problem = (
                f"{self.path} cannot be written ({error.strerror}): if companion is killed, the vehicle keeps its rates"
            )


def is_same(one_us: int, other_us: int) -> bool:
    """Whether two intervals are one, within what an autopilot rounds them by."""
    return abs(one_us - other_us) <= max(_SAME * other_us, _SAME_US)


def original_rates_path(link: str, vehicle: str) -> Path:
    """Where the file of a vehicle on a link lies."""
    return state_folder() / "intervals" / (re.sub(r"[^A-Za-z0-9.]+", "_", f"{link} {vehicle}").strip("_") + ".json")


def state_folder() -> Path:
    """The user's folder for what a program remembers between runs (XDG_STATE_HOME; %LOCALAPPDATA% on Windows)."""
    home = os.environ.get("LOCALAPPDATA" if sys.platform == "win32" else "XDG_STATE_HOME", "")
    return (Path(home) if home else Path.home() / ".local" / "state") / "companion"


def _read(path: Path) -> dict[str, OriginalRate]:
    """What the file says; nothing where there is none or it is damaged."""
    try:
        stored = {str(name): OriginalRate(**one) for name, one in json.loads(path.read_text()).items()}
    except (OSError, ValueError, TypeError, AttributeError, RecursionError):
        return {}
    return {name: one for name, one in stored.items() if one.is_whole}


_DEFAULT, _STOP = 0, -1  # SET_MESSAGE_INTERVAL
NOT_SENT = -1
"""MESSAGE_INTERVAL of ArduPilot, and of the protocol. PX4 says 0 there, and -1 of what it sends at every update
(mavlink_receiver.cpp, get_message_interval)."""


@dataclass(frozen=True, slots=True)
class _Message:
    """One message that is to be as before."""

    id: int
    before: OriginalRate
    interval_us: int  # to ask for

    def is_as_before(self, interval_us: int) -> bool:
        """By what MESSAGE_INTERVAL says."""
        if self.interval_us == _STOP:
            return interval_us <= 0
        if self.interval_us == _DEFAULT:  # nobody says what that is
            return not is_same(interval_us, self.before.asked_us)
        return is_same(interval_us, self.interval_us)


class Restoration:
    """Requests come out, answers go in, until every message is as before.

    earlier: what was found of each message that was requested. ids: the numbers of messages. answers: whether the
    vehicle has ever answered a request. late: acknowledgements of earlier requests that may still come.
    """

    def __init__(
        self,
        target: Target,
        earlier: OriginalRatesFile,
        ids: Mapping[str, int],
        *,
        ardupilot: bool,
        answers: bool,
        late: int = 0,
    ) -> None:
        self._target = target
        self._earlier = earlier
        known = {name: one for name, one in earlier.known.items() if name in ids}
        self._streams = {name: one for name, one in known.items() if one.by_stream and name in STREAMS}
        self._messages = {
            name: _Message(ids[name], one, _interval(name, one, ardupilot=ardupilot))
            for name, one in known.items()
            if name not in self._streams
        }
        self._answers = answers
        self._unacknowledged = late

    @property
    def complete(self) -> bool:
        """Whether the vehicle has confirmed that every message is as before."""
        return not self._messages and not self._streams

    @property
    def unconfirmed(self) -> tuple[str, ...]:
        """The messages that are not confirmed to be as before.

        Of a vehicle that has taken no request at all those alone that an earlier companion has requested.
        """
        left = (*self._messages, *self._streams)
        return left if self._answers else tuple(name for name in left if name in self._earlier.inherited)

    def requests(self) -> list[Request]:
        """What restores the messages that are left, each followed by the question whether it has."""
        self._unacknowledged += len(self._messages)
        restoring = []
        for message in self._messages.values():
            restoring.append(requests.set_interval(self._target, message.id, message.interval_us))
            restoring.append(requests.get_interval(self._target, message.id))
        rates: dict[int, int] = {}
        for name, one in self._streams.items():  # the fastest of a stream says how often it came
            rates[STREAMS[name]] = max(rates.get(STREAMS[name], 0), _whole(one.found_hz))
        return restoring + [requests.request_stream(self._target, stream, hz) for stream, hz in rates.items()]

    def receive(self, messages: Mapping[str, Messages], own_sysid: int) -> None:
        """Take what the vehicle sent after a request."""
        self._streams.clear()  # nobody acknowledges a stream: that the vehicle is received has to do
        for message_id, us in requests.intervals(messages):
            self._answers = True
            self._messages = {
                name: one for name, one in self._messages.items() if one.id != message_id or not one.is_as_before(us)
            }
        if results := requests.interval_results(messages, own_sysid):
            self._answers = True
            self._unacknowledged -= results.count(requests.ACCEPTED)
            if self._unacknowledged == 0:  # which confirms what no MESSAGE_INTERVAL tells
                self._messages = {name: one for name, one in self._messages.items() if one.before.found_us is not None}

    def end(self) -> str:
        """Keep for the next run what is not confirmed, and forget the rest. What the user is to know of it, or ""."""
        left = self.unconfirmed
        self._earlier.forget(self._earlier.known.keys() - set(left))
        if not left:
            return ""
        kept = self._earlier.path is not None and not self._earlier.problem
        then = (
            f"the next run on this link will restore that ({self._earlier.path})"
            if kept
            else "reboot it to restore that"
        )
        are = "is" if len(left) == 1 else "are"
        return f"vehicle {self._target} has not confirmed that {', '.join(left)} {are} sent as before: {then}"


def _interval(name: str, before: OriginalRate, *, ardupilot: bool) -> int:
    """What a message had before, µs; where the vehicle did not say, what arrived; else its default.

    -1 sent back means *stop* to every autopilot, which is right only for what did not come.
    ArduPilot has no default for what is in no stream: it FAILS such a request, and goes on sending.
    """
    if before.found_us is None and before.found_hz:
        return round(1e6 / _whole(before.found_hz))
    if before.found_us is not None and before.found_us > 0:
        return before.found_us
    if before.found_us == NOT_SENT and ardupilot and not before.found_hz:
        return _STOP
    return _DEFAULT if name in STREAMS or not ardupilot else _STOP


def _whole(hz: float) -> int:
    """The rate that was set, by what arrived of it: some of it is lost, and counted over a moment more or less."""
    return max(ceil(hz - 0.3), 1) if hz > 0 else 0
