"""What a link is called, and what it stands on: a two-way stream of bytes that comes back after it went away."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol, TypeVar

from companion.model import InputError, nearest_word

Kind = Literal["udpin", "udpout", "tcp", "tcpin", "serial"]

DEFAULT_BAUD = 115_200
"""What USB flight controllers ignore and most telemetry ports of the boards use; SiK radios are set to 57600."""

_NETWORK = re.compile(r"(udpin|udpout|udp|tcpin|tcp):(?:(.*):)?(\d+)")
_KINDS: dict[str, Kind] = {"udpin": "udpin", "udpout": "udpout", "udp": "udpin", "tcpin": "tcpin", "tcp": "tcp"}
_PLACE = re.compile(r"(.*:)?\d+")
_SERIAL = re.compile(r"(?:serial:)?(/.+?|COM\d+)(?::(\d+))?", re.IGNORECASE)
_MEANT = re.compile(r"(udp|tcp)\w*(:|$)|serial:|/dev/(tty|serial/|cu|rfcomm)|COM\d+(:|$)", re.IGNORECASE)
_FORMS = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT or a device like /dev/ttyACM0:115200"


@dataclass(frozen=True, slots=True)
class Address:
    """Where a link goes."""

    kind: Kind
    host: str = ""  # a name or number; for the kinds that wait for others, the own address to wait at
    port: int = 0
    device: str = ""  # of a serial link
    baud: int = DEFAULT_BAUD

    def __str__(self) -> str:
        return f"{self.device}:{self.baud}" if self.kind == "serial" else f"{self.kind}:{self.host}:{self.port}"

    @property
    def bytes_per_second(self) -> float | None:
        """What a serial line carries (8N1: ten bits a byte); None for a network."""
        return self.baud / 10 if self.kind == "serial" else None


def is_link(text: str) -> bool:
    """Whether a word on the command line is meant as a link, not as a file."""
    return _MEANT.match(text) is not None


def meant_link(text: str) -> str:
    """The link that was probably meant: udp:14550 for upd:14550. "" where it does not look like one."""
    scheme, _, rest = text.partition(":")
    near = nearest_word(scheme, _KINDS) if _PLACE.fullmatch(rest) else ""
    return f"{near}:{rest}" if near else ""


def parse_address(text: str) -> Address:
    """The address that a text names. `udp:` is `udpin:`, as in pymavlink. Raises InputError for one that is none."""
    if match := _NETWORK.fullmatch(text):
        kind, host, port = match[1], match[2] or "", int(match[3])
        if not 0 <= port <= 65535:
            raise InputError(f"{text} has no port between 0 and 65535.")
        if not port and kind in ("udpout", "tcp"):
            raise InputError(f"{text} names no port to send to: 0 is none.")
        if not host:
            host = "0.0.0.0" if kind in ("udp", "udpin", "tcpin") else "127.0.0.1"
        return Address(_KINDS[kind], host.strip("[]"), port)
    if match := _SERIAL.fullmatch(text):
        if not (baud := int(match[2] or DEFAULT_BAUD)):
            raise InputError(f"{text} names no baud rate: 0 is none.")
        return Address("serial", device=match[1], baud=baud)
    meant = meant_link(text)
    raise InputError(f"{text!r} is not a link: " + (f"did you mean {meant}?" if meant else f"use {_FORMS}."))


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


Connection = TypeVar("Connection")


class BackOff:
    """When to try again."""

    def __init__(self) -> None:
        self._pause, self._next = _BACK_OFF_S[0], 0.0

    def attempt(self, connect: Callable[[], Connection], timeout_s: float) -> Connection | None:
        """Try to come back; None where that fails, or after a sleep where it is too early for it."""
        if (left := self._next - time.monotonic()) > 0:
            time.sleep(min(timeout_s, left))
            return None
        try:
            connected = connect()
        except (OSError, ValueError):  # pyserial's are both
            self._next = time.monotonic() + self._pause
            self._pause = min(2 * self._pause, _BACK_OFF_S[1])
            return None
        self._pause, self._next = _BACK_OFF_S[0], 0.0
        return connected
