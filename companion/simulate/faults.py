"""What may go wrong with a simulated vehicle and its link."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from companion.model import SettingsError


@dataclass(frozen=True, slots=True)
class Faults:
    """Faults of a simulated flight; times in s since it began."""

    reboot: tuple[float, ...] = ()  # s, the autopilot starts again: clock, sequence and intervals are gone
    silence: tuple[tuple[float, float], ...] = ()  # (begin, end) s, nothing is sent
    drop: float = 0.0  # share of packets that get lost
    duplicate: float = 0.0  # share of packets that arrive twice
    reorder: float = 0.0  # share of packets that arrive after the next
    garbage: float = 0.0  # share of packets with noise in front of them
    denied: frozenset[str] = frozenset()  # messages whose interval may not be set; "*": none may
    never: frozenset[str] = frozenset()  # messages that are promised and never come, as PX4 does without a source
    turned_down: tuple[float, ...] = ()  # s, another ground station asks for every stream at 2 Hz
    imu_bias: tuple[float, float] | None = None  # from s on, rad/s about z: a gyro bias
    imu_stuck: float | None = None  # from s on, every axis reads the same
    imu_clip: tuple[float, float] | None = None  # (begin, end) s, vibration beyond the accelerometer's range
    gps_glitch: tuple[float, float, float] | None = None  # (begin, end) s, m east: the estimate follows a false GPS
    ekf_reset: tuple[float, float] | None = None  # from s on, m north: the estimate jumps

    def __post_init__(self) -> None:
        for name in ("drop", "duplicate", "reorder", "garbage"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise SettingsError(f"the fault {name} is a share between 0 and 1, got {getattr(self, name)}")

    def silent(self, t: float) -> bool:
        """Whether nothing is sent at t s."""
        return any(begin <= t < end for begin, end in self.silence)


class Channel:
    """A bad link: loses, doubles, swaps and soils packets at random, the same way for the same seed."""

    def __init__(self, faults: Faults, seed: int) -> None:
        self._faults = faults
        self._rng = np.random.default_rng(seed)
        self._late: tuple[float, bytes] | None = None

    def carry(self, packets: Iterable[tuple[float, bytes]]) -> Iterator[tuple[float, bytes]]:
        """The packets that arrive, each with its time."""
        faults = self._faults
        if not (faults.silence or faults.drop or faults.duplicate or faults.reorder or faults.garbage):
            yield from packets
            return
        for t, packet in packets:
            lost, twice, late, soiled = self._rng.random(4)
            if faults.silent(t) or lost < faults.drop:
                continue
            arriving = self._rng.bytes(20) + packet if soiled < faults.garbage else packet
            if self._late is None and late < faults.reorder:
                self._late = (t, arriving)
                continue
            yield t, arriving
            if twice < faults.duplicate:
                yield t, arriving
            if self._late is not None:
                yield t, self._late[1]
                self._late = None
