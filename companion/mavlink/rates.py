"""Asks one vehicle for the messages that are wanted, watches what comes, and gives back what it found.

No socket and no clock in here: messages and times go in, requests and sentences come out.

What ArduPilot does to requests (GCS_Common.cpp, V4.7): an interval is cut to whole ms; one that is faster than
floor(loop_us / 800) ms is DENIED; ten distinct intervals exist for a link, a further one silently becomes the nearest;
all streams fall to a quarter while parameters or missions are loaded; a reboot forgets them. PX4 (v1.16) accepts
messages that it has no source for and never sends them, and takes the nearest of its source's ticks.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil

from companion.mavlink import requests
from companion.mavlink.boots import Boots
from companion.mavlink.dialect import Dialect
from companion.mavlink.facts import PARAMETERS, PX4_PARAMETERS, Facts
from companion.mavlink.messages import Messages
from companion.mavlink.requests import Request, Target
from companion.mavlink.wishes import State, Wish

_ANSWER_S = 1.0  # how long an answer may take
_ATTEMPTS = 4  # for a request that is not answered
_SPACING_S = 0.02  # between requests: some firmware drops what comes in one burst
_WINDOW_S = 5.0  # over which an arriving rate is measured
_ENOUGH = 0.6  # of the messages agreed, less their square root: fewer is "turned down"; a loss of 30 % is not
_RETRIES = 4  # against somebody who turns a message down: no fight
_BACK_OFF_S = 5.0  # before the second of them, doubled each time
_SLOWEST_HZ = 5.0  # a DENIED request is lowered no further
_SILENT_S = 3.0  # after that the vehicle, or the link to it, may have forgotten everything
_ACCEPTED, _NOT_NOW, _DENIED, _IN_PROGRESS = 0, 1, 2, 5  # MAV_RESULT

_STREAMS = {
    "RAW_IMU": 1,
    "SCALED_IMU2": 1,
    "LOCAL_POSITION_NED": 6,
    "GLOBAL_POSITION_INT": 6,
    "ATTITUDE": 10,
}
"""Message → MAV_DATA_STREAM (RAW_SENSORS, POSITION, EXTRA1), for firmware without SET_MESSAGE_INTERVAL."""

_WITHOUT = {"LOCAL_POSITION_NED": "the autopilot's estimate has no position yet (GPS?)"}
"""Why a message does not come at all, where that is no lack of a sensor. When it comes, that is said."""


class Rates:
    """The wishes for one vehicle, and the parameters that are read from it. Times in s of any steady clock.

    wanted: message → Hz. own_sysid: answers to others are not ours.
    """

    def __init__(
        self, target: Target, wanted: Mapping[str, float], dialect: Dialect, *, own_sysid: int, ardupilot: bool = True
    ) -> None:
        self.target = target
        self.wishes = [Wish(name, dialect.by_name[name].id, hz, hz) for name, hz in wanted.items()]
        self.said: list[str] = []  # for the user; emptied by whoever shows it
        self.confirmed = 0  # requests for an interval that the vehicle has accepted
        self._own = own_sysid
        self._ardupilot = ardupilot
        self._facts = Facts(target, PARAMETERS if ardupilot else PX4_PARAMETERS)
        self._waiting: Wish | None = None  # whose COMMAND_ACK is due: an ack names the command, not the message
        self._next = 0.0
        self._boots = Boots()
        self.started: float | None = None  # s, when it has last rebooted
        self._heard: float | None = None  # s, when the vehicle was heard last
        self._streamed: float | None = None  # s, when something that we asked for came last
        self._restarts = 0

    @property
    def settled(self) -> bool:
        """Whether every wish is agreed or given up."""
        return all(wish.state in (State.WATCHING, State.GIVEN_UP) for wish in self.wishes)

    def hear(self, messages: Mapping[str, Messages], now: float) -> None:
        """Take note of what this vehicle sent, and nobody else."""
        if not messages:
            return
        if self._heard is not None and now - self._heard > _SILENT_S:
            self.said.append(f"vehicle {self.target} is back after {now - self._heard:.0f} s: asking again")
            self._start_again()
        self._heard = now
        self._notice_reboot(messages, now)
        self._facts.hear(messages)
        self._take_answers(messages, now)
        for wish in self.wishes:
            if wish.name in messages:
                wish.count += len(messages[wish.name])
                self._streamed = now
            self._measure(wish, now)
        self._notice_end(now)

    def next_request(self, now: float) -> Request | None:
        """What to send now, if anything."""
        if now < self._next or self._heard is None:
            return None
        if now - self._heard > _SILENT_S:
            for wish in self.wishes:
                wish.received_hz = 0.0
            return None
        request = self._find(now) or self._ask(now)
        if request is None and self.settled:
            request = self._facts.next_request(now)
        if request is not None:
            self._next = now + _SPACING_S
        return request

    def restore(self) -> list[Request]:
        """What gives every message that we changed the interval back that it had; where that is not known, its default.

        A stream gets the rate back at which it arrived before.
        """
        streams: dict[int, int] = {}
        given_back: list[Request] = []
        for wish in self.wishes:
            if wish.by_stream:
                stream = _STREAMS[wish.name]
                streams[stream] = max(streams.get(stream, 0), ceil(wish.found_hz))
            elif wish.ours:
                # ArduPilot has no default for what is in no stream: it FAILS such a request, and goes on sending.
                unknown = 0 if wish.name in _STREAMS or not self._ardupilot else -1
                given_back.append(requests.set_interval(self.target, wish.message_id, wish.found_us or unknown))
        return given_back + [requests.request_stream(self.target, stream, hz) for stream, hz in streams.items()]

    def _find(self, now: float) -> Request | None:
        for wish in self.wishes:
            if wish.state is State.FINDING and now >= wish.due:
                if wish.attempts >= 2:  # it does not say: then its default is what it gets back
                    wish.found_hz = wish.count / (now - wish.window) if wish.window is not None else 0.0
                    self._move(wish, State.ASKING, now)
                    continue
                wish.attempts, wish.due = wish.attempts + 1, now + _ANSWER_S
                return requests.get_interval(self.target, wish.message_id)
        return None

    def _ask(self, now: float) -> Request | None:
        if self._waiting is not None:
            if now < self._waiting.due:
                return None
            self._waiting = None
        if any(wish.state is State.FINDING and (wish.attempts or now >= wish.due) for wish in self.wishes):
            return None
        for wish in self.wishes:
            if wish.state is not State.ASKING or now < wish.due:
                continue
            if wish.attempts >= _ATTEMPTS:
                self._refused(wish, "the vehicle does not answer", now)
            if wish.by_stream:
                self._move(wish, State.WATCHING, now)  # nobody acknowledges a stream
                return self._ask_stream(_STREAMS[wish.name])
            if wish.state is State.ASKING:
                wish.ours = True
                wish.attempts, wish.due, self._waiting = wish.attempts + 1, now + _ANSWER_S, wish
                return requests.set_interval(self.target, wish.message_id, round(1e6 / wish.asked_hz))
        return None

    def _ask_stream(self, stream: int) -> Request:
        """A stream carries several messages: the fastest of them says how often."""
        members = [wish.asked_hz for wish in self.wishes if wish.by_stream and _STREAMS[wish.name] == stream]
        return requests.request_stream(self.target, stream, round(max(members)))

    def _take_answers(self, messages: Mapping[str, Messages], now: float) -> None:
        for name, found in messages.items():
            if name == "MESSAGE_INTERVAL":
                for number, interval in zip(found["message_id"].tolist(), found["interval_us"].tolist(), strict=True):
                    self._found(number, interval)
            elif name == "COMMAND_ACK":
                for i in range(len(found)):
                    mine = int(found["target_system"][i]) in (0, self._own)
                    if mine and found["command"][i] == requests.SET_MESSAGE_INTERVAL:
                        self.confirmed += int(found["result"][i]) == _ACCEPTED
                        self._answered(int(found["result"][i]), now)

    def _found(self, number: int, interval: int) -> None:
        for wish in self.wishes:
            if wish.message_id == number and wish.state is State.FINDING:
                wish.found_us = interval
                # Somebody has it as often already, e.g. PX4's onboard link its attitude: we need not take from them.
                enough = 0 < interval <= 1e6 / wish.asked_hz
                self._move(wish, State.WATCHING if enough else State.ASKING, 0.0)

    def _answered(self, result: int, now: float) -> None:
        wish = self._waiting
        if wish is None or result == _IN_PROGRESS:
            return
        self._waiting = None
        if result == _ACCEPTED:
            self._move(wish, State.WATCHING, now)
        elif result == _DENIED and not self._unknown(wish) and _slower(wish.asked_hz) >= _SLOWEST_HZ:
            # perhaps faster than its loop allows
            wish.asked_hz = _slower(wish.asked_hz)
            self._move(wish, State.ASKING, now)
        elif result == _NOT_NOW:
            wish.due = now + _ANSWER_S  # as if it had not answered
        else:
            self._refused(wish, "the vehicle refuses it", now)

    def _unknown(self, wish: Wish) -> bool:
        """Whether ArduPilot has said that it does not know a message (PX4 says the same of one that is not sent)."""
        return self._ardupilot and wish.found_us == 0

    def _refused(self, wish: Wish, why: str, now: float) -> None:
        if self._ardupilot and wish.name in _STREAMS and not wish.by_stream:
            wish.by_stream, wish.asked_hz = True, wish.wanted_hz
            self.said.append(f"{wish.name}: {why}; asking for its stream instead")
            self._move(wish, State.ASKING, now)
        else:
            self._move(wish, State.GIVEN_UP, now)
            self.said.append(f"{wish.name}: {why}; given up")

    def _measure(self, wish: Wish, now: float) -> None:
        if wish.window is None:
            wish.window, wish.count = now, 0
        elapsed = now - wish.window
        if elapsed < _WINDOW_S:
            return
        expected = wish.asked_hz * elapsed
        enough = wish.count >= _ENOUGH * expected - expected**0.5
        wish.received_hz, wish.window, wish.count = wish.count / elapsed, now, 0
        if wish.state is State.GIVEN_UP and enough and wish.received_hz:
            # e.g. ArduPilot sends all streams at a quarter for as long as parameters are loaded
            self.said.append(f"{wish.name}: {wish.received_hz:.0f} Hz arrive again")
            wish.retries = 0
            self._move(wish, State.WATCHING, now)
        if wish.state is not State.WATCHING:
            return
        if not enough:
            self._turned_down(wish, now)
        elif wish.asked_hz < wish.wanted_hz and not wish.retries:
            wish.retries = 1  # said once
            self.said.append(f"{wish.name}: {wish.wanted_hz:g} Hz is refused, {wish.received_hz:.0f} Hz arrive")

    def _turned_down(self, wish: Wish, now: float) -> None:
        arrives = f"{wish.received_hz:.1f} of {wish.asked_hz:.3g} Hz arrive"
        if wish.retries >= _RETRIES:
            nothing = _WITHOUT.get(wish.name, "it has no source")
            why = "another program turns it down, or the link is too slow" if wish.received_hz else nothing
            self.said.append(f"{wish.name}: {arrives}: {why}; given up")
            self._move(wish, State.GIVEN_UP, now)
            return
        self.said.append(f"{wish.name}: {arrives}; asking again")
        again = State.ASKING if wish.ours else State.FINDING  # who asked for what we found has left
        self._move(wish, again, now + (_BACK_OFF_S * 2 ** (wish.retries - 1) if wish.retries else 0.0))
        wish.retries += 1

    def _notice_reboot(self, messages: Mapping[str, Messages], now: float) -> None:
        started = self._boots.hear(messages, now)
        if started is None:
            return
        self._restarts = 0
        if self._boots.two_clocks:
            self.said.append(
                f"two clocks speak as vehicle {self.target}: two vehicles with one system id, or an echo of another "
                "time. Give each vehicle an id of its own (SYSID_THISMAV, MAV_SYSID, MAV_SYS_ID)."
            )
            return
        self.started = started
        self.said.append(f"vehicle {self.target} has rebooted: asking again")
        self._start_again()

    def _notice_end(self, now: float) -> None:
        """A reboot shows first in that only heartbeats come any more: not even the messages with the clock."""
        if self._streamed is None or now - self._streamed < _SILENT_S or self._restarts >= _RETRIES:
            return
        if any(wish.state is State.WATCHING for wish in self.wishes):
            self._restarts += 1
            self.said.append(f"vehicle {self.target} sends nothing of what was agreed any more: asking again")
            self._start_again()

    def _start_again(self) -> None:
        """Everything that was agreed is gone; what there was before us is what to give back all the same."""
        self._waiting = self._streamed = None
        for wish in self.wishes:
            wish.asked_hz, wish.retries, wish.by_stream = wish.wanted_hz, 0, False
            self._move(wish, State.ASKING if wish.ours else State.FINDING, 0.0)

    def _move(self, wish: Wish, state: State, due: float) -> None:
        wish.state, wish.attempts, wish.due, wish.window = state, 0, due, None


def _slower(hz: float) -> float:
    """The next rate to try: ArduPilot knows whole milliseconds only, and the fastest of them depends on its loop."""
    interval = int(1000 / hz)
    return 1000 / max(interval + 1, ceil(1.25 * interval))
