"""The message streams requested of a vehicle: how far each request has come, and what is said of those that fail."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import ceil, inf

_GATHER_S = 20.0  # sentences of one kind are gathered so long: a vehicle that refuses one message refuses several
_MORE_S = 2.0  # ... and at least so long after the newest


class RequestState(Enum):
    """How far a request has come."""

    FINDING = "asking for the present interval"
    ASKING = "asking for ours"
    WATCHING = "agreed"
    GIVEN_UP = "given up"


REFUSES = "the vehicle refuses it"
ABSENT = "the vehicle does not send {}: it has no such sensor, or its firmware no such message"
SIGNS = "the vehicle signs its messages and does not answer unsigned requests: give its key with --signing-key-file"

WITHOUT = {"LOCAL_POSITION_NED": "the autopilot's estimate has no position yet (GPS?)"}
"""Why a message does not come at all, where that is no lack of a sensor. When it comes, that is said."""


@dataclass(slots=True)
class StreamRequest:
    """One message and its desired rate."""

    name: str
    message_id: int
    desired_hz: float
    requested_hz: float  # lower than desired when the vehicle denied that
    received_hz: float = 0.0  # over the last 5 s
    found_us: int | None = None  # the interval before our request, as MESSAGE_INTERVAL reports it; None: not known
    found_hz: float = 0.0  # what arrived before our request, where the vehicle reported no interval
    ours: bool = False  # an interval of ours has been requested, and perhaps taken
    requested_s: float = -inf  # s, when that was last
    state: RequestState = RequestState.FINDING
    by_stream: bool = False  # requested with REQUEST_DATA_STREAM
    optional: bool = False  # many vehicles have no source for it
    attempts: int = 0  # of the present request
    retries: int = 0  # after it was turned down
    due: float = 0.0  # s, when to ask (again)
    count: int = 0  # arrived in this window
    window: float | None = None  # s, when it began

    @property
    def arrives(self) -> bool:
        """Whether it has come lately."""
        return bool(self.count or self.received_hz)

    def arriving_hz(self, now: float) -> float:
        """How often it has come lately."""
        counted = self.count / (now - self.window) if self.window is not None and now > self.window else 0.0
        return max(self.received_hz, counted)

    def move(self, state: RequestState, due: float) -> None:
        """Begin a state: nothing has been tried or counted in it. due: s, when to ask."""
        self.state, self.attempts, self.due, self.window = state, 0, due, None


class Gathered:
    """Messages that something has happened to, gathered into one sentence for each reason."""

    def __init__(self) -> None:
        self._why: dict[str, list[str]] = {}
        self._since: float | None = None  # s, of the first
        self._newest = 0.0  # s

    def add(self, name: str, why: str, now: float) -> None:
        """why: with "{}" where the names stand."""
        self._why.setdefault(why, []).append(name)
        self._since, self._newest = now if self._since is None else self._since, now

    def sentences(self, now: float, *, complete: bool) -> list[str]:
        """What there is to say now. complete: every request is agreed or given up."""
        complete = complete and now - self._newest > _MORE_S
        if self._since is None or not (complete or now - self._since > _GATHER_S):
            return []
        sentences = [why.format(", ".join(names)) for why, names in self._why.items()]
        self._why, self._since = {}, None
        return sentences


def slower(hz: float) -> float:
    """The next rate to try: ArduPilot knows whole milliseconds only, and the fastest of them depends on its loop."""
    interval = int(1000 / hz)
    return 1000 / max(interval + 1, ceil(1.25 * interval))
