"""What the user has chosen to be reckoned, and the worker that has it done while the picture keeps moving."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from companion.errors import CompanionError
from companion.strapdown import ImuModel, Sensor, correct
from companion.tracks import Flight
from companion.view.moment import Footage, Reckoning, footage

NO_BIAS = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class ReplayChoice:
    """How a flight is to be reckoned."""

    imu: str | None = None  # message name; None: the flight's default
    method: str = "rk4"  # euler, midpoint or rk4
    middle: str = "cubic"  # the sample in mid-step: linear or cubic
    reanchor_s: float | None = 10.0  # start again from the autopilot's state every so many s; None: run free
    start_s: float | None = None  # s, boot clock, of the first anchor; None: as early as possible
    segments: int = 1  # steps between two samples, 1 ... 64
    gravity: str | float = "standard"  # "standard" (9.80665), "normal" (WGS-84 where it flew), or m/s²
    gyro_bias: tuple[float, float, float] = NO_BIAS  # rad/s, FRD, taken off the readings
    accel_bias: tuple[float, float, float] = NO_BIAS  # m/s², FRD, taken off the readings


Recompute = Callable[[Flight, ReplayChoice], Reckoning]
"""Reckons a flight as chosen. Raises CompanionError when that cannot be done. Runs in a worker thread."""


def without_bias(flight: Flight, choice: ReplayChoice) -> Flight:
    """The flight with the chosen biases taken off the chosen IMU's readings."""
    if choice.gyro_bias == NO_BIAS and choice.accel_bias == NO_BIAS:
        return flight
    gyro, accel = Sensor(bias=np.array(choice.gyro_bias)), Sensor(bias=np.array(choice.accel_bias))
    imu = flight.imu(choice.imu)
    name = next(name for name, track in flight.imus.items() if track is imu)
    return replace(flight, imus={**flight.imus, name: correct(imu, ImuModel(gyro, accel))})


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """A request and what became of it: footage, or the reason why there is none."""

    flight: Flight
    choice: ReplayChoice
    result: Footage | CompanionError


class Recomputer:
    """One worker, one place in the queue: the newest request wins, those in between are never begun."""

    def __init__(self, recompute: Recompute) -> None:
        self._recompute = recompute
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="companion-recompute")
        self._running: Future[Outcome] | None = None
        self._waiting: tuple[Flight, ReplayChoice] | None = None

    @property
    def busy(self) -> bool:
        """Whether a result is still to come."""
        return self._running is not None or self._waiting is not None

    def request(self, flight: Flight, choice: ReplayChoice) -> None:
        """Ask for `choice`; whatever was asked before and is not done is no longer wanted."""
        self._waiting = (flight, choice)
        self._start_next()

    def poll(self) -> Outcome | None:
        """The newest result if it has just come. An error other than CompanionError is a bug, and is raised here."""
        if self._running is None or not self._running.done():
            return None
        outcome = self._running.result()
        self._running = None
        superseded = self._waiting is not None
        self._start_next()
        return None if superseded else outcome

    def close(self) -> None:
        """Wait for the running request, drop the waiting one, end the worker."""
        self._waiting = None
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _start_next(self) -> None:
        if self._running is None and self._waiting is not None:
            self._running = self._pool.submit(self._work, *self._waiting)
            self._waiting = None

    def _work(self, flight: Flight, choice: ReplayChoice) -> Outcome:
        return attempt(self._recompute, flight, choice)


def attempt(recompute: Recompute, flight: Flight, choice: ReplayChoice) -> Outcome:
    """Reckon `choice`: its footage, or the error that says why not."""
    try:
        return Outcome(flight, choice, footage(recompute(flight, choice)))
    except CompanionError as error:
        return Outcome(flight, choice, error)
