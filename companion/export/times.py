"""The two times of every exported row, and the name of its table."""

from __future__ import annotations

import re

import numpy as np

from companion.export.table import Column
from companion.model import Array, Flight

BOOT_CLOCK = "seconds of the vehicle's boot clock"


def table_name(message: str) -> str:
    """The name of an IMU's table: raw_imu, imu_0 for IMU[0]."""
    return re.sub(r"[^a-z0-9]+", "_", message.lower()).strip("_")


def series_name(key: str) -> str:
    """The name of a series' table: gps, gps_gps2_raw; of another estimator's attitude other_attitude."""
    return table_name(f"other_{key}" if key.partition(":")[0] == "attitude" else key)


def times(flight: Flight, t: Array, *, prefix: str = "") -> tuple[Column, Column]:
    unix = np.full(len(t), np.nan) if flight.epoch is None else flight.epoch.unix_s + t
    source = f"since 1970, UTC, by {flight.epoch.source}" if flight.epoch else "since 1970, UTC: not known"
    return Column(f"{prefix}t_s", t, "s", BOOT_CLOCK), Column(f"{prefix}unix_s", unix, "s", source)
