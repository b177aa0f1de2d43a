"""What a vehicle sent before the companion's first request, kept in a file until it has been restored.

A companion that is killed (kill -9, power) or has lost its link leaves its own rates behind, and the next one would
take them for the vehicle's. So what was found is written down before the first request changes it, one file per vehicle
and link in the user's state folder; a message is removed from it when the vehicle has confirmed that it is as before.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import sys
from collections.abc import Collection
from dataclasses import asdict, dataclass
from pathlib import Path

_SAME = 0.1  # by which an interval may differ from the one asked for and still be it ...
_SAME_US = 1000  # ... and so many µs: ArduPilot keeps whole ms
_LONGEST_US = 2**31  # of MESSAGE_INTERVAL
_MOST_HZ = 2**16  # of REQUEST_DATA_STREAM


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
        return whole and isinstance(self.found_hz, int | float) and 0 <= self.found_hz < _MOST_HZ

    def is_ours(self, interval_us: int) -> bool:
        """Whether an interval is the one that a companion asked for: then it is not the vehicle's own."""
        return is_same(interval_us, self.asked_us)


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
