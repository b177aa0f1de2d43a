"""The other ends of links, for tests: real sockets and pseudo-terminals that remember what they got."""

from __future__ import annotations

import contextlib
import os
import pty
import socket
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from companion.mavlink import Frames, Link


class UdpPeer:
    """Sends to a port and hears the answers."""

    def __init__(self, port: int) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(2.0)
        self._to = ("127.0.0.1", port)

    def send(self, data: bytes) -> None:
        self.socket.sendto(data, self._to)

    def heard(self, within_s: float = 0.2) -> bytes:
        """Everything that arrives within a time."""
        return b"".join(_datagrams(self.socket, within_s))


def _datagrams(end: socket.socket, within_s: float) -> Iterator[bytes]:
    until = time.monotonic() + within_s
    while (left := until - time.monotonic()) > 0:
        end.settimeout(left)
        with contextlib.suppress(TimeoutError):
            yield end.recv(65536)


@contextlib.contextmanager
def udp_peer(port: int) -> Iterator[UdpPeer]:
    peer = UdpPeer(port)
    try:
        yield peer
    finally:
        peer.socket.close()


@contextlib.contextmanager
def listener(port: int = 0) -> Iterator[socket.socket]:
    """A TCP server on loopback."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        server.bind(("127.0.0.1", port))
        server.listen(1)
        server.settimeout(5.0)
        yield server


@contextlib.contextmanager
def serial_cable(device: Path) -> Iterator[int]:
    """A pseudo-terminal that appears as `device` and vanishes at the end: the vehicle's end of the cable."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    device.symlink_to(os.ttyname(theirs))
    os.close(theirs)
    try:
        yield ours
    finally:
        device.unlink()
        os.close(ours)


def frames_until(link: Link, count: int, within_s: float = 5.0) -> list[Frames]:
    """Receive until `count` frames have come. Fails after `within_s`."""
    found: list[Frames] = []
    until = time.monotonic() + within_s
    while sum(map(len, found)) < count:
        assert time.monotonic() < until, f"{sum(map(len, found))} of {count} frames in {within_s} s; {link.problem}"
        found.append(link.receive(0.05))
    return found


def ids(found: list[Frames]) -> list[int]:
    """Message ids in order."""
    return np.concatenate([frames.id for frames in found]).tolist() if found else []


def wait_for(happened: Callable[[], object], within_s: float = 5.0) -> None:
    """Fails unless something becomes true within a time."""
    until = time.monotonic() + within_s
    while not happened():
        assert time.monotonic() < until, f"not within {within_s} s"
        time.sleep(0.01)
