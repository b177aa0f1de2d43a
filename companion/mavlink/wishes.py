"""What a vehicle is wished to send, and how far each wish has come."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class State(Enum):
    """How far a wish has come."""

    FINDING = "asking for the present interval"
    ASKING = "asking for ours"
    WATCHING = "agreed"
    GIVEN_UP = "given up"


@dataclass(slots=True)
class Wish:
    """One message and how often it is wanted."""

    name: str
    message_id: int
    wanted_hz: float
    asked_hz: float  # lower than wanted when the vehicle denied that
    received_hz: float = 0.0  # over the last 5 s
    found_us: int | None = None  # the interval before we asked, as MESSAGE_INTERVAL says it; None: not known
    found_hz: float = 0.0  # what arrived before we asked, where the vehicle did not say
    ours: bool = False  # an interval of ours has been asked for, and perhaps taken
    state: State = State.FINDING
    by_stream: bool = False  # asked for with REQUEST_DATA_STREAM
    attempts: int = 0  # of the present request
    retries: int = 0  # after it was turned down
    due: float = 0.0  # s, when to ask (again)
    count: int = 0  # arrived in this window
    window: float | None = None  # s, when it began
