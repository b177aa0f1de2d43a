"""A two-way stream of bytes that comes back after it went away: what a link stands on."""

from __future__ import annotations

import time
from typing import Protocol

from companion.model import InputError

_BACK_OFF_S = (0.2, 5.0)  # between attempts to come back: the first, doubled each time up to the last


class NotThereError(InputError):
    """What a link goes to is not there: a host, a device, a program. It may come later."""


class Port(Protocol):
    """A two-way stream of bytes. Reading and writing never block and never raise for a peer that has gone."""

    @property
    def problem(self) -> str:
        """Why nothing can be received at present, "" if something can."""

    def wait(self, timeout_s: float) -> bool:
        """Wait until there is something to read, at most `timeout_s`; tries to come back if the peer has gone."""

    def read(self) -> bytes:
        """What has arrived, b"" for nothing."""

    def write(self, data: bytes) -> bool:
        """Send all of it, or nothing: False when there is nobody to send to, or when the peer takes nothing now."""

    def close(self) -> None:
        """Give the port back."""


class BackOff:
    """When to try again."""

    def __init__(self) -> None:
        self._pause, self._longest = _BACK_OFF_S
        self._next = 0.0

    def due(self) -> bool:
        return time.monotonic() >= self._next

    def remaining(self) -> float:
        return max(self._next - time.monotonic(), 0.0)

    def failed(self) -> None:
        self._next = time.monotonic() + self._pause
        self._pause = min(2 * self._pause, self._longest)
