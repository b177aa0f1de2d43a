"""Trajectory files that evo reads: `timestamp x y z qx qy qz qw`, one pose a line (TUM RGB-D benchmark)."""

from __future__ import annotations

from pathlib import Path
from typing import TextIO

import numpy as np

from companion.analysis import Replay
from companion.estimation import BestEstimate
from companion.export.table import Format
from companion.model import Array, Flight


def write_tum(folder: Path, flight: Flight, shown: Replay, best: BestEstimate | None = None) -> list[Path]:
    """autopilot.tum and imu.tum: the same times in both, those at which the autopilot's state is known.

    And best.tum where there is a best estimate, at every sample of its IMU.
    """
    known = shown.reference_valid
    paths = []
    for name, what, q, position in (
        ("autopilot", "the autopilot's estimate", shown.q_ref, shown.position_ref),
        ("imu", "the IMU alone, from the autopilot's state at each anchor", shown.q_imu, shown.position_imu),
    ):
        path = folder / f"{name}.tum"
        with path.open("w", encoding="utf-8", newline="\n") as file:
            _head(file, flight, f"{what}, {len(shown.anchors)} anchors", shown.has_position)
            np.savetxt(file, _rows(shown.t, q, position)[known], fmt="%.9f")
        paths.append(path)
    if best is not None:
        paths.append(write_estimate_tum(folder / "best.tum", flight, best))
    return paths


def write_estimate_tum(path: Path, flight: Flight, best: BestEstimate) -> Path:
    """The best estimate, carried to every sample of its IMU."""
    t = best.imu.t
    q, _, position = best.at(t)
    has_position = "gps_position" in best.residuals
    with path.open("w", encoding="utf-8", newline="\n") as file:
        _head(file, flight, f"best estimate from {', '.join([best.imu.source, *best.residuals])}", has_position)
        np.savetxt(file, _rows(t, q, position if has_position else np.zeros_like(position)), fmt="%.9f")
    return path


def _head(file: TextIO, flight: Flight, what: str, has_position: bool) -> None:
    epoch = f"add {flight.epoch.unix_s:.6f} for UNIX time" if flight.epoch else "the date is unknown"
    file.write(f"# {what}; vehicle {flight.vehicle}, boot {flight.boot}\n")
    file.write(f"# t: s of the vehicle's boot clock ({epoch})\n")
    file.write("# x y z: north, east, down, m; qx qy qz qw: Hamilton, turns FRD (forward, right, down) into NED\n")
    if not has_position:
        file.write("# the log has no position: x y z are 0 throughout, only the attitudes mean something\n")


def _rows(t: Array, q: Array, position: Array) -> Array:
    return np.column_stack([t, position, np.roll(q, -1, axis=1)])  # scalar last


FORMATS = (
    Format(
        "tum",
        "the trajectories for evo",
        lambda path, c: write_tum(path, c.flight, c.shown, c.assessment.best),
        is_folder=True,
    ),
)
