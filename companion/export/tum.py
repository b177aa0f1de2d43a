"""The pair of trajectory files that evo reads: `timestamp x y z qx qy qz qw`, one pose a line (TUM RGB-D benchmark)."""

from __future__ import annotations

from pathlib import Path
from typing import TextIO

import numpy as np

from companion.analysis import Replay
from companion.tracks import Array, Flight


def write_tum(folder: Path, flight: Flight, shown: Replay) -> list[Path]:
    """autopilot.tum and imu.tum: the same times in both, those at which the autopilot's state is known."""
    known = shown.reference_valid
    paths = []
    for name, what, q, position in (
        ("autopilot", "the autopilot's estimate", shown.q_ref, shown.position_ref),
        ("imu", "the IMU alone, from the autopilot's state at each anchor", shown.q_imu, shown.position_imu),
    ):
        path = folder / f"{name}.tum"
        with path.open("w", encoding="utf-8", newline="\n") as file:
            _head(file, flight, shown, what)
            np.savetxt(file, _rows(shown.t, q, position)[known], fmt="%.9f")
        paths.append(path)
    return paths


def _head(file: TextIO, flight: Flight, shown: Replay, what: str) -> None:
    epoch = f"add {flight.epoch.unix_s:.6f} for UNIX time" if flight.epoch else "the log does not tell the date"
    file.write(f"# {what}; vehicle {flight.vehicle}, boot {flight.boot}, {len(shown.anchors)} anchors\n")
    file.write(f"# t: s of the vehicle's boot clock ({epoch})\n")
    file.write("# x y z: north, east, down, m; qx qy qz qw: Hamilton, turns FRD (forward, right, down) into NED\n")
    if not shown.has_position:
        file.write("# the log has no position: x y z are 0 throughout, only the attitudes mean something\n")


def _rows(t: Array, q: Array, position: Array) -> Array:
    return np.column_stack([t, position, np.roll(q, -1, axis=1)])  # scalar last
