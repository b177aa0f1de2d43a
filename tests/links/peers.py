"""The other ends of links, for tests: real sockets and pseudo-terminals that remember what they got."""

from __future__ import annotations

import contextlib
import os
import pty
import socket
import tty
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from companion.links import Link
from companion.mavlink import Frames
from tests.waiting import LIMIT_S, wait_for


class UdpPeer:
    """Sends to a port and hears the answers."""

    def __init__(self, port: int) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(LIMIT_S)
        self._to = ("127.0.0.1", port)

    def send(self, data: bytes) -> None:
        self.socket.sendto(data, self._to)

    def heard(self) -> bytes:
        """Everything that has been sent to it: waits for the first datagram, and until no other follows."""
        data = self.socket.recv(65536)
        while more := self.heard_late():
            data += more
        return data

    def heard_late(self) -> bytes:
        """What still comes, b"" for nothing."""
        self.socket.settimeout(0.1)
        try:
            return self.socket.recv(65536)
        except TimeoutError:
            return b""
        finally:
            self.socket.settimeout(LIMIT_S)


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
        server.settimeout(LIMIT_S)
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


def deaf(data: bytes) -> None:
    """In place of a simulated vehicle's `receive`: nothing reaches it any more."""


def frames_until(link: Link, count: int) -> list[Frames]:
    """Receive until `count` frames have come."""
    found: list[Frames] = []

    def come() -> bool:
        found.append(link.receive(0.05))
        return sum(map(len, found)) >= count

    wait_for(come, f"{count} frames on {link}")
    return found


def ids(found: list[Frames]) -> list[int]:
    """Message ids in order."""
    return np.concatenate([frames.id for frames in found]).tolist() if found else []
