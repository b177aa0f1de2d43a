"""Simulated vehicles that fly in this process, on real sockets."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Iterator
from typing import Any

from companion.mavlink import open_port, parse_address
from companion.simulate import Faults, SimulatedVehicle, fly, serve


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextlib.contextmanager
def flying(port: int, *, since: float = 0.0, **changes: Any) -> Iterator[SimulatedVehicle]:
    """A simulated vehicle that sends to a UDP port of this computer for 2 min; it flew for `since` s before."""
    vehicle = SimulatedVehicle(fly(120.0, faults=changes.get("faults", Faults())), **changes)
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
