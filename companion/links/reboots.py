"""When a vehicle has started again: its clock, the time since boot, falls."""

from __future__ import annotations

from collections.abc import Mapping

from companion.mavlink import Messages

_REBOOT_S = 5.0  # a fall of the clock by more than this is a reboot, as in telemetry
_MOST_REBOOTS, _REBOOTS_S = 2, 10.0  # more in that time are no reboots: a flight controller needs seconds for one


class Reboots:
    """Watches one vehicle's clock."""

    def __init__(self) -> None:
        self.two_clocks = False  # reboots as fast as no vehicle can: nothing is a reboot any more
        self._boot_s = 0.0
        self._reboots: list[float] = []  # s, when the clock fell lately

    def hear(self, messages: Mapping[str, Messages], now: float) -> float | None:
        """Take what a vehicle sent: when it has started, s of the steady clock `now`, once after it has."""
        started = None
        for columns in messages.values():
            if "time_boot_ms" in columns.layout.fields and len(columns.rows):  # the session reads those it needs
                boot_s = float(columns["time_boot_ms"][-1]) * 1e-3
                if 0 < boot_s < self._boot_s - _REBOOT_S and not self.two_clocks:
                    self._reboots = [t for t in self._reboots if now - t < _REBOOTS_S] + [now]
                    self.two_clocks = len(self._reboots) > _MOST_REBOOTS
                    started = now - boot_s
                self._boot_s = boot_s
        return started
