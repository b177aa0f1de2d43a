"""Run a simulated vehicle on a link at the pace of the clock, or write its whole flight into a tlog at once."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from companion.links import Port
from companion.model import InputError
from companion.simulate.vehicle import SimulatedVehicle

EPOCH = 1_700_000_000.0
"""UNIX time at which a flight written to a file begins, s: the same file for the same seed."""

_STEP_S = 0.005
"""Pause between sendings; ArduPilot's simulator sends in bursts too."""


def serve(
    vehicle: SimulatedVehicle, port: Port, *, speed: float = 1.0, stop: Callable[[], bool] = lambda: False
) -> None:
    """Fly the vehicle from where it is to its end, or until `stop()`, at `speed` times the pace of the clock."""
    begin = time.monotonic() - vehicle.t / speed
    while not vehicle.finished and not stop():
        port.wait(0.0)
        if data := port.read():
            vehicle.receive(data)
        for _, packet in vehicle.advance((time.monotonic() - begin) * speed):
            port.write(packet)
        time.sleep(_STEP_S)


def write_flight(vehicle: SimulatedVehicle, path: str | Path) -> None:
    """Fly the vehicle to its end and write what it sends as a tlog. Raises InputError if that cannot be written."""
    try:
        with Path(path).open("wb") as file:
            t = 0.0
            while not vehicle.finished:
                t += 1.0
                for sent, packet in vehicle.advance(t):
                    file.write(round((EPOCH + sent) * 1e6).to_bytes(8, "big") + packet)
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror}): choose another place.") from None
