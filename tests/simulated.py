"""Simulated vehicles that fly in this process, on real sockets."""

from __future__ import annotations

import contextlib
import functools
import socket
import threading
from collections.abc import Iterator
from typing import Any

from companion.mavlink import open_port, parse_address
from companion.simulate import Faults, Flown, SimulatedVehicle, fly, serve
from tests.waiting import LIMIT_S


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextlib.contextmanager
def flying(port: int, *, since: float = 0.0, **changes: Any) -> Iterator[SimulatedVehicle]:
    """A simulated vehicle that sends to a UDP port of this computer; it flew for `since` s before."""
    vehicle = SimulatedVehicle(_flown(changes.get("faults", Faults())), **changes)
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


@functools.lru_cache(maxsize=2)
def _flown(faults: Faults) -> Flown:
    """Longer than any test takes, on a busy machine too."""
    return fly(3 * LIMIT_S, faults=faults)
