"""When the boot clock was zero in the world's time: what the vehicle says, else what the recording computer stamped."""

from __future__ import annotations

import numpy as np

from companion.mavlink import Messages
from companion.model import Array, Epoch
from companion.telemetry.clock import Clock

_BELIEVABLE_S = (1e9, 2.0**32)  # 2001 to 2106: an autopilot without a fix counts from 1970 or from its build
_STEADY_S = 5.0
"""Stamps that run away from the boot clock by more than this are of a replay or of a simulation that ran faster."""

_GPS_EPOCH_S = 315_964_800.0  # 1980-01-06 00:00 UTC, as UNIX time
_WEEK_S = 604_800.0
_LEAP_SECONDS = ((1_483_228_800.0, 18), (1_435_708_800.0, 17), (1_341_100_800.0, 16), (1_230_768_000.0, 15))
"""UNIX time → GPS minus UTC from then on, s (IERS Bulletin C; none has been announced since 2017)."""


def system_epoch(system_time: Messages | None, clock: Clock) -> Epoch | None:
    """By SYSTEM_TIME, which ArduPilot and PX4 set from GPS; else by the stamps of a telemetry log."""
    if system_time is not None and len(system_time.rows) == len(system_time):
        unix, boot = (system_time[n] * s for n, s in (("time_unix_usec", 1e-6), ("time_boot_ms", 1e-3)))
        if (epoch := epoch_of(unix, boot, "SYSTEM_TIME")) is not None:
            return epoch
    stamped = np.isfinite(clock.log_time)
    ahead = clock.log_time[stamped] - clock.t[stamped]
    if not len(ahead) or float(np.subtract(*np.percentile(ahead, [95, 5]))) > _STEADY_S:
        return None
    # A packet is never stamped before it was sent, so the earliest are the most punctual; the very first may be damage
    return epoch_of(clock.log_time[stamped], clock.t[stamped], "log stamps", percentile=1)


def epoch_of(unix: Array, boot: Array, source: str, *, percentile: float = 50) -> Epoch | None:
    """From pairs (N,) of world and boot time, s; None when none of them is a believable date."""
    good = (unix > _BELIEVABLE_S[0]) & (unix < _BELIEVABLE_S[1])
    return Epoch(float(np.percentile((unix - boot)[good], percentile)), source) if good.any() else None


def gps_to_unix(week: Array, seconds: Array) -> Array:
    """GPS week and seconds of the week (N,) as UNIX time, s: UTC, so without the leap seconds since 1980."""
    unix = _GPS_EPOCH_S + week * _WEEK_S + seconds
    leap = np.zeros(len(unix))
    for since, count in reversed(_LEAP_SECONDS):
        leap[unix >= since + count] = count
    return np.asarray(unix - leap)
