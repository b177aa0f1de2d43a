"""Simulated vehicles that fly in this process, on real sockets."""

from __future__ import annotations

import contextlib
import functools
import itertools
import os
import socket
import threading
from collections.abc import Iterator
from typing import Any

from companion.links import open_port, parse_address
from companion.simulate import Faults, Flown, SimulatedVehicle, fly, serve
from tests.waiting import LIMIT_S

_PORTS = range(20_000, 32_000)
"""Below those that systems hand out by themselves: nobody is given one while a test is about to open it, and no client
that waits for it to open connects to itself."""

_tried = itertools.count(97 * os.getpid())  # test processes have neighbouring numbers, and begin far apart


def free_port() -> int:
    """A port of this computer that nobody has, by UDP nor by TCP; another one each time."""
    for number in itertools.islice(_tried, len(_PORTS)):
        port = _PORTS[number % len(_PORTS)]
        with contextlib.suppress(OSError), contextlib.ExitStack() as probes:
            for kind in (socket.SOCK_DGRAM, socket.SOCK_STREAM):
                probes.enter_context(socket.socket(socket.AF_INET, kind)).bind(("127.0.0.1", port))
            return port
    raise AssertionError("no port is free on this machine")


@contextlib.contextmanager
def flying(port: int, *, since: float = 0.0, motion: str = "circle", **changes: Any) -> Iterator[SimulatedVehicle]:
    """A simulated vehicle that sends to a UDP port of this computer; it flew for `since` s before."""
    vehicle = SimulatedVehicle(_flown(changes.get("faults", Faults()), motion), **changes)
    end = open_port(parse_address(f"udpout:127.0.0.1:{port}"))
    vehicle.advance(since)
    over = threading.Event()
    thread = threading.Thread(target=serve, args=(vehicle, end), kwargs={"stop": over.is_set})
    thread.start()
    try:
        yield vehicle
    finally:
        over.set()
        thread.join()
        end.close()


def bursts(vehicle: SimulatedVehicle, until_s: float, each_s: float = 0.1) -> Iterator[tuple[float, bytes]]:
    """What the vehicle sends up to a time of its flight, a tenth of a second at a time: (when the last left, bytes).

    A link hands over several packets at once too, and to decode each alone takes ten times as long.
    """
    waiting: list[bytes] = []
    begin = at = 0.0
    for t, packet in vehicle.advance(until_s):
        if waiting and t > begin + each_s:
            yield at, b"".join(waiting)
            waiting.clear()
        begin = begin if waiting else t
        waiting.append(packet)
        at = t
    if waiting:
        yield at, b"".join(waiting)


@functools.lru_cache(maxsize=2)
def _flown(faults: Faults, motion: str) -> Flown:
    """Longer than any test takes, on a busy machine too."""
    return fly(3 * LIMIT_S, motion=motion, faults=faults)
