"""Asks one vehicle for the messages that are desired, watches what comes, and gives back what it found.

No socket and no clock in here: messages and times go in, requests and sentences come out.

What ArduPilot does to requests (GCS_Common.cpp, V4.7): an interval is cut to whole ms; one that is faster than
floor(loop_us / 800) ms is DENIED; ten distinct intervals exist for a link, a further one silently becomes the nearest;
all streams fall to a quarter while parameters or missions are loaded; a reboot forgets them. PX4 (v1.16) accepts
messages that it has no source for and never sends them, and takes the nearest of its source's ticks.
"""

from __future__ import annotations

from collections.abc import Mapping

from companion.links import request_table, requests
from companion.links.request_table import STREAMS, RequestState, StreamRequest, slower
from companion.links.requests import Request, Target
from companion.links.restoration import NOT_SENT, OriginalRate, OriginalRatesFile, Restoration, is_same
from companion.links.vehicles import PARAMETERS, PX4_PARAMETERS, Facts, Reboots
from companion.mavlink import Dialect, Messages

_ANSWER_S = 1.0  # how long an answer may take
_ATTEMPTS = 4  # for a request that is not answered
_FIND_ATTEMPTS = 8  # for the present interval of what arrives: without the answer it could not be given back
_FIND_ATTEMPTS_ABSENT = 2  # ... of what does not arrive
_AS_OFTEN = 0.8  # of the rate that is desired: what arrives so often, though nobody says its interval, is left alone
_SPACING_S = 0.02  # between requests: some firmware drops what comes in one burst
_WINDOW_S = 5.0  # over which an arriving rate is measured
_ENOUGH = 0.6  # of the messages agreed, less their square root: fewer is "turned down"; a loss of 30 % is not
_RETRIES = 4  # against somebody who turns a message down: no fight
_BACK_OFF_S = 5.0  # before the second of them, doubled each time
_SLOWEST_HZ = 5.0  # a DENIED request is lowered no further
_SILENT_S = 3.0  # after that the vehicle, or the link to it, may have forgotten everything
_NOT_NOW, _DENIED, _IN_PROGRESS = 1, 2, 5  # MAV_RESULT


class StreamManager:
    """The stream requests to one vehicle, and the parameters that are read from it. Times in s of any steady clock.

    desired: message → Hz. own_sysid: answers to others are not ours. earlier: what there was, kept beyond a kill -9.
    """

    def __init__(
        self,
        target: Target,
        desired: Mapping[str, float],
        dialect: Dialect,
        *,
        own_sysid: int,
        ardupilot: bool = True,
        earlier: OriginalRatesFile | None = None,
        reported: list[str] | None = None,
    ) -> None:
        self.target = target
        self.stream_requests = [StreamRequest(name, dialect.by_name[name].id, hz, hz) for name, hz in desired.items()]
        self.lost_share = 0.0  # of the vehicle's frames, lately
        self._thin = request_table.ThinLink(dialect, scales=not ardupilot)
        self.signed = False  # whether the vehicle signs, and we have no key
        self.reported: list[str] = [] if reported is None else reported  # for the user; emptied by whoever shows it
        self._own = own_sysid
        self._ardupilot = ardupilot
        self._facts = Facts(target, PARAMETERS if ardupilot else PX4_PARAMETERS)
        self._waiting: StreamRequest | None = None  # whose COMMAND_ACK is due: it names the command, not the message
        self._answers = False  # whether it has ever answered a request for an interval
        self._next = 0.0
        self._reboots = Reboots()
        self._received: float | None = None  # s, when the vehicle was received last
        self._streamed: float | None = None  # s, when something that we requested came last
        self._restarts = 0
        self._gathered = request_table.Gathered()
        self._earlier = earlier or OriginalRatesFile()
        self._ids = {name: message.id for name, message in dialect.by_name.items()}
        self._restoration: Restoration | None = None  # from when on everything is restored

    @property
    def settled(self) -> bool:
        """Whether every request is agreed or given up."""
        return all(message.state in (RequestState.WATCHING, RequestState.GIVEN_UP) for message in self.stream_requests)

    def receive(self, messages: Mapping[str, Messages], now: float) -> float | None:
        """Take note of what this vehicle sent, and nobody else: when it has started, s, once after a reboot."""
        if not messages:
            return None
        if self._received is not None and now - self._received > _SILENT_S:
            self.reported.append(f"vehicle {self.target} is back after {now - self._received:.0f} s: asking again")
            self._start_again()
        self._received = now
        if self._restoration is not None:
            self._restoration.receive(messages, self._own)
            return None
        started = self._notice_reboot(messages, now)
        self._facts.receive(messages)
        for result in requests.interval_results(messages, self._own):
            self._answers = True
            self._answered(result, now)
        for message_id, interval_us in requests.intervals(messages):
            self._answers = True
            self._take_interval(message_id, interval_us, now)
        for message in self.stream_requests:
            if message.name in messages:
                message.count += len(messages[message.name])
                self._streamed = now
            self._measure(message, now)
        self._notice_end(now)
        self._lower(now)
        self.reported += self._gathered.sentences(now, complete=self.settled)
        return started

    def next_request(self, now: float) -> Request | None:
        """What to send now, if anything."""
        if now < self._next or self._received is None:
            return None
        if now - self._received > _SILENT_S:
            for message in self.stream_requests:
                message.received_hz = 0.0
            return None
        request = self._ask(now) or self._find(now)  # the IMU need not wait until the last interval is known
        if request is None and self.settled:
            request = self._facts.next_request(now)
        if request is not None:
            self._next = now + _SPACING_S
        return request

    def restore(self) -> Restoration:
        """Ask for nothing any more; what gives every message that we changed the interval back that it had."""
        if self._restoration is None:
            self._restoration = Restoration(
                self.target,
                self._earlier,
                self._ids,
                ardupilot=self._ardupilot,
                answers=self._answers,
                late=int(self._waiting is not None),
            )
        return self._restoration

    def _find(self, now: float) -> Request | None:
        for message in self.stream_requests:
            if message.state is RequestState.FINDING and now >= message.due:
                if message.attempts >= (_FIND_ATTEMPTS if message.arrives else _FIND_ATTEMPTS_ABSENT):
                    self._found_nothing(message, now)
                    continue
                message.attempts, message.due = message.attempts + 1, now + _ANSWER_S
                return requests.get_interval(self.target, message.message_id)
        return None

    def _found_nothing(self, message: StreamRequest, now: float) -> None:
        """The vehicle does not say how often it sends a message; what arrives says something."""
        message.found_hz = message.arriving_hz(now)
        earlier = self._earlier.known.get(message.name)
        if earlier is not None:
            message.found_us, message.found_hz, message.ours = earlier.found_us, earlier.found_hz, not earlier.by_stream
        as_often = message.found_hz >= _AS_OFTEN * message.requested_hz
        message.move(RequestState.WATCHING if as_often and earlier is None else RequestState.ASKING, now)

    def _ask(self, now: float) -> Request | None:
        if self._waiting is not None:
            if now < self._waiting.due:
                return None
            self._waiting = None
        for message in self.stream_requests:
            if message.state is not RequestState.ASKING or now < message.due:
                continue
            if message.attempts >= (_ATTEMPTS if self._answers or message is self.stream_requests[0] else 1):
                self._refused(message, request_table.SIGNS if self.signed else "the vehicle does not answer", now)
            if message.by_stream:
                self._note(message)
                message.move(RequestState.WATCHING, now)  # nobody acknowledges a stream
                return self._ask_stream(STREAMS[message.name])
            if message.state is RequestState.ASKING:
                self._note(message)
                message.ours, message.requested_s = True, now
                message.attempts, message.due, self._waiting = message.attempts + 1, now + _ANSWER_S, message
                interval_us = round(1e6 / message.requested_hz)
                message.asked_us.add(interval_us)
                return requests.set_interval(self.target, message.message_id, interval_us)
        return None

    def _note(self, message: StreamRequest) -> None:
        """Write down what there was, before it is changed."""
        problem = self._earlier.problem
        one = OriginalRate(
            message.found_us, round(message.found_hz, 1), round(1e6 / message.requested_hz), message.by_stream
        )
        self._earlier.note(message.name, one)
        if self._earlier.problem != problem:
            self.reported.append(self._earlier.problem)

    def _ask_stream(self, stream: int) -> Request:
        """A stream carries several messages: the fastest of them says how often."""
        members = (one for one in self.stream_requests if one.by_stream and STREAMS[one.name] == stream)
        return requests.request_stream(self.target, stream, round(max(one.requested_hz for one in members)))

    def _take_interval(self, number: int, interval: int, now: float) -> None:
        for message in self.stream_requests:
            if message.message_id == number and message.state is RequestState.FINDING:
                earlier = self._earlier.known.get(message.name)
                asked = set() if earlier is None else {earlier.asked_us} | message.asked_us
                message.ours = any(is_same(interval, one) for one in asked)  # not the vehicle's own
                if earlier is not None and message.ours:
                    message.found_us, message.found_hz = earlier.found_us, earlier.found_hz
                else:  # the vehicle has rebooted since, or somebody has set it
                    self._earlier.forget({message.name})
                    message.found_us = interval
                    message.found_hz = message.arriving_hz(now) if interval == NOT_SENT else 0.0
                # Somebody has it as often already, e.g. PX4's onboard link its attitude: we need not take from them.
                enough = 0 < interval <= 1e6 / message.requested_hz
                message.move(RequestState.WATCHING if enough else RequestState.ASKING, 0.0)

    def _answered(self, result: int, now: float) -> None:
        message = self._waiting
        if message is None or result == _IN_PROGRESS:
            return
        self._waiting = None
        if result == requests.ACCEPTED:
            message.move(RequestState.WATCHING, now)
        elif result == _DENIED and not self._unknown(message) and slower(message.requested_hz) >= _SLOWEST_HZ:
            # perhaps faster than its loop allows
            message.requested_hz = slower(message.requested_hz)
            message.move(RequestState.ASKING, now)
        elif result == _NOT_NOW:
            message.due = now + _ANSWER_S  # as if it had not answered
        else:
            self._refused(message, request_table.REFUSES, now)

    def _unknown(self, message: StreamRequest) -> bool:
        """Whether ArduPilot has said that it does not know a message (PX4 says the same of one that is not sent)."""
        return self._ardupilot and message.found_us == 0

    def _refused(self, message: StreamRequest, why: str, now: float) -> None:
        if self._ardupilot and message.name in STREAMS and not message.by_stream:
            message.by_stream, message.requested_hz = True, message.desired_hz
            self._gathered.add(message.name, f"{{}}: {why}; asking for its stream instead", now)
            message.move(RequestState.ASKING, now)
        else:
            message.move(RequestState.GIVEN_UP, now)
            absent = message.name in request_table.OPTIONAL and why == request_table.REFUSES
            self._gathered.add(message.name, request_table.ABSENT if absent else f"{{}}: {why}; given up", now)

    def _measure(self, message: StreamRequest, now: float) -> None:
        if message.window is None:
            message.window, message.count = now, 0
        elapsed = now - message.window
        if elapsed < _WINDOW_S:
            return
        expected = message.requested_hz * elapsed
        enough = message.count >= _ENOUGH * expected - expected**0.5
        message.received_hz, message.window, message.count = message.count / elapsed, now, 0
        if message.state is RequestState.GIVEN_UP and enough and message.received_hz:
            # e.g. ArduPilot sends all streams at a quarter for as long as parameters are loaded
            self.reported.append(f"{message.name}: {message.received_hz:.0f} Hz arrive again")
            message.retries = 0
            message.move(RequestState.WATCHING, now)
        if message.state is not RequestState.WATCHING:
            return
        if not enough:
            self._turned_down(message, now)
        elif message.requested_hz < message.desired_hz and not message.retries:
            message.retries = 1  # said once
            self.reported.append(
                f"{message.name}: {message.desired_hz:g} Hz is refused, {message.received_hz:.0f} Hz arrive"
            )

    def _turned_down(self, message: StreamRequest, now: float) -> None:
        absent = message.name in request_table.OPTIONAL and not message.received_hz
        if absent and message.retries:
            self._gathered.add(message.name, request_table.ABSENT, now)
            message.move(RequestState.GIVEN_UP, now)
            return
        arrives = f"{message.received_hz:.1f} of {message.requested_hz:.3g} Hz arrive"
        if message.retries >= _RETRIES:
            nothing = request_table.WITHOUT.get(message.name, "it has no source")
            overridden = "another program is probably overriding the rate, or the link is too slow"
            why = overridden if message.received_hz else nothing
            self.reported.append(f"{message.name}: {arrives}: {why}; given up")
            message.move(RequestState.GIVEN_UP, now)
            return
        if not absent:
            self.reported.append(f"{message.name}: {arrives}; asking again")
        again = RequestState.ASKING if message.ours else RequestState.FINDING  # who requested what we found has left
        message.move(again, now + (_BACK_OFF_S * 2 ** (message.retries - 1) if message.retries else 0.0))
        message.retries += 1

    def _notice_reboot(self, messages: Mapping[str, Messages], now: float) -> float | None:
        """When it has started, s, where it has just rebooted."""
        started = self._reboots.receive(messages, now)
        if started is None:
            return None
        self._restarts = 0
        if self._reboots.two_clocks:
            self.reported.append(
                f"two clocks speak as vehicle {self.target}: two vehicles with one system id, or an echo of another "
                "time. Give each vehicle an id of its own (SYSID_THISMAV, MAV_SYSID, MAV_SYS_ID)."
            )
            return None
        self.reported.append(f"vehicle {self.target} has rebooted: asking again")
        before = [one for one in self.stream_requests if one.requested_s < started]
        self._earlier.forget({one.name for one in before})
        for one in before:
            one.asked_us.clear()
        self._start_again()
        return started

    def _notice_end(self, now: float) -> None:
        """A reboot shows first in that only heartbeats come any more: not even the messages with the clock."""
        if self._streamed is None or now - self._streamed < _SILENT_S or self._restarts >= _RETRIES:
            return
        if any(message.state is RequestState.WATCHING for message in self.stream_requests):
            self._restarts += 1
            self.reported.append(f"vehicle {self.target} sends nothing of what was agreed any more: asking again")
            self._start_again()

    def _lower(self, now: float) -> None:
        """Ask for what the link carries, the most important first, where it does not carry what was agreed."""
        fitting, words = self._thin.fitting(self.stream_requests, self.lost_share, now)
        if words:
            self.reported.append(words)
        for message in self.stream_requests:
            if fitting.get(message.name, message.requested_hz) < message.requested_hz:
                message.requested_hz, message.retries = fitting[message.name], 1
                message.move(RequestState.ASKING if message.ours else RequestState.FINDING, 0.0)

    def _start_again(self) -> None:
        """What was agreed may be gone; an interval that is still ours tells that it is not.

        After a reboot what to give back is what the vehicle has booted with.
        """
        self._thin.start_again()
        self._waiting = self._streamed = None
        for message in self.stream_requests:
            message.requested_hz, message.retries, message.by_stream = message.desired_hz, 0, False
            message.move(RequestState.FINDING, 0.0)
