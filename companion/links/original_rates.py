"""What a vehicle sent before the companion's first request, kept in a file until it has been given back.

A companion that is killed (kill -9, power) leaves its own rates behind, and the next one would take them for the
vehicle's. So what was found is written down before the first request changes it, one file per vehicle and link in the
user's state folder, and removed when the vehicle has confirmed that everything is as before.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import ceil
from pathlib import Path

from companion.links import requests
from companion.links.requests import Request, Target
from companion.links.stream_request import STREAMS, StreamRequest

_SAME = 0.1  # by which an interval may differ from the one asked for and still be it ...
_LONGEST_US = 2**31  # of MESSAGE_INTERVAL
_SAME_US = 1000  # ... and so many µs: ArduPilot keeps whole ms


@dataclass(frozen=True, slots=True)
class OriginalRate:
    """One message before the companion's first request for it."""

    found_us: int | None  # interval as MESSAGE_INTERVAL says it; None: the vehicle did not say
    found_hz: float  # what arrived
    asked_us: int  # the interval that the companion asked for
    by_stream: bool = False  # asked for with REQUEST_DATA_STREAM

    @property
    def is_whole(self) -> bool:
        """Whether every value is one that a vehicle says: a file may hold anything."""
        intervals = [one for one in (self.found_us, self.asked_us) if one is not None]
        whole = all(isinstance(one, int) and abs(one) < _LONGEST_US for one in intervals) and self.asked_us is not None
        return whole and isinstance(self.found_hz, int | float) and math.isfinite(self.found_hz)

    def is_ours(self, interval_us: int) -> bool:
        """Whether an interval is the one that an earlier companion asked for: then it is not the vehicle's own."""
        return abs(interval_us - self.asked_us) <= max(_SAME * self.asked_us, _SAME_US)


class OriginalRatesFile:
    """What one vehicle on one link sent before: read when it is made, written whenever something is added.

    path: None keeps nothing.
    """

    def __init__(self, path: Path | None = None) -> None:
        self.path = path
        self.known: dict[str, OriginalRate] = _read(path) if path is not None else {}
        self.problem = ""  # why nothing can be written, for the user

    def note(self, name: str, earlier: OriginalRate) -> None:
        """Write down one message before it is asked for."""
        if self.known.get(name) == earlier:
            return
        self.known[name] = earlier
        if self.path is None:
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

    def forget(self) -> None:
        """Everything has been given back."""
        self.known.clear()
        if self.path is not None:
            with contextlib.suppress(OSError):
                self.path.unlink(missing_ok=True)


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


def restoring(
    target: Target, stream_requests: Sequence[StreamRequest], leftover: Mapping[int, OriginalRate], *, ardupilot: bool
) -> list[Request]:
    """Requests that give each message the interval that it had, and each stream the rate at which it arrived.

    leftover: message id → what an earlier companion found, for messages that are not requested now.
    """
    streams: dict[int, int] = {}
    intervals: list[Request] = []
    for message in stream_requests:
        if message.by_stream:
            stream = STREAMS[message.name]
            streams[stream] = max(streams.get(stream, 0), _whole(message.found_hz))
        elif message.ours:
            us = _interval(
                message.found_us,
                message.found_hz,
                has_default=message.name in STREAMS or not ardupilot,
            )
            intervals.append(requests.set_interval(target, message.message_id, us))
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
