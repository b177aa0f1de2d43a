"""What gives a vehicle its message intervals back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil

from companion.mavlink import requests
from companion.mavlink.earlier import Earlier
from companion.mavlink.requests import Request, Target
from companion.mavlink.wishes import STREAMS, Wish

_DEFAULT, _STOP = 0, -1  # SET_MESSAGE_INTERVAL


def restoring(
    target: Target, wishes: Sequence[Wish], leftover: Mapping[int, Earlier], *, ardupilot: bool
) -> list[Request]:
    """Requests that undo the wishes: each message gets the interval that it had; a stream the rate at which it arrived.

    leftover: message id → what an earlier companion found, for messages that are not wished for now.
    """
    streams: dict[int, int] = {}
    intervals: list[Request] = []
    for wish in wishes:
        if wish.by_stream:
            stream = STREAMS[wish.name]
            streams[stream] = max(streams.get(stream, 0), _whole(wish.found_hz))
        elif wish.ours:
            us = _interval(wish.found_us, wish.found_hz, has_default=wish.name in STREAMS or not ardupilot)
            intervals.append(requests.set_interval(target, wish.message_id, us))
    for number, earlier in leftover.items():
        if not earlier.by_stream:
            us = _interval(earlier.found_us, earlier.found_hz, has_default=not ardupilot)
            intervals.append(requests.set_interval(target, number, us))
    return intervals + [requests.request_stream(target, stream, hz) for stream, hz in streams.items()]


def _interval(found_us: int | None, found_hz: float, *, has_default: bool) -> int:
    """What a message had before, µs; where the vehicle did not say, what arrived; else its default.

    ArduPilot has no default for what is in no stream: it FAILS such a request, and goes on sending.
    """
    if found_us:
        return found_us
    if found_us is None and found_hz:
        return round(1e6 / _whole(found_hz))
    return _DEFAULT if has_default else _STOP


def _whole(hz: float) -> int:
    """The rate that was set, by what arrived of it: some of it is lost, and counted over a moment more or less."""
    return ceil(max(hz - 0.3, 0.0))
