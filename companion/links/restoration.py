"""Gives a vehicle its own message intervals back, and knows of each message whether the vehicle has confirmed it.

An acknowledgement names the command and not the message, so that one that is lost, or late (through MAVProxy), cannot
be told from that of another message. Each request is therefore followed by GET_MESSAGE_INTERVAL, whose answer names it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil

from companion.links import requests
from companion.links.original_rates import OriginalRate, OriginalRatesFile, is_same
from companion.links.request_table import STREAMS
from companion.links.requests import Request, Target
from companion.mavlink import Messages

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
            return not self.before.is_ours(interval_us)
        return is_same(interval_us, self.interval_us)


class Restoration:
    """Requests come out, answers go in, until every message is as before.

    earlier: what was found of each message that was asked for. ids: the numbers of messages. answers: whether the
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
        """The messages that are not confirmed to be as before; none of a vehicle that has taken no request at all."""
        return (*self._messages, *self._streams) if self._answers else ()

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
        self._streams.clear()  # nobody acknowledges a stream: that the vehicle is heard has to do
        if "MESSAGE_INTERVAL" in messages:
            self._answers = True
            answers = messages["MESSAGE_INTERVAL"]
            for number, us in zip(answers["message_id"].tolist(), answers["interval_us"].tolist(), strict=True):
                self._messages = {
                    name: one for name, one in self._messages.items() if one.id != number or not one.is_as_before(us)
                }
        if "COMMAND_ACK" in messages:
            results = requests.results(messages["COMMAND_ACK"], requests.SET_MESSAGE_INTERVAL, own_sysid)
            self._answers = self._answers or bool(results)
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
