"""Preflight checks of recordings that stand: `python benchmarks/accuracy/preflight.py LOG...`.

First each log as it is: what is no-go (of healthy logs that is a false alarm). Then the same with one fault of twice
its limit injected into one sensor: whether that line is no-go.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from companion.app.recording import read_recording
from companion.app.sensors import imu_spec_of
from companion.constants import harm, healthy
from companion.model import STANDARD_GRAVITY, CompanionError, Flight, GpsTrack, ImuTrack
from companion.verdict import Preflight, preflight

_GYRO = healthy.USUAL_BIAS["gyro"]
_ACCEL = float(np.hypot(healthy.USUAL_BIAS["accel"], healthy.USUAL_SCALE * STANDARD_GRAVITY))
Inject = Callable[[Flight], Flight]


def _imu(change: Callable[[ImuTrack], ImuTrack]) -> Inject:
    """Of the first IMU: every message of it."""

    def inject(flight: Flight) -> Flight:
        instance = flight.each_imu()[0].instance
        changed = {n: change(t) if t.instance == instance else t for n, t in flight.imus.items()}
        return replace(flight, imus=changed)

    return inject


def _frozen(track: ImuTrack) -> ImuTrack:
    still = np.tile(track.gyro[0], (len(track), 1)), np.tile(track.accel[0], (len(track), 1))
    return replace(track, gyro=still[0], accel=still[1], gyro_step=0.0, accel_step=0.0)


def _gps(**factors: float) -> Inject:
    def changed(gps: GpsTrack) -> GpsTrack:
        columns: dict[str, Any] = {name: np.full(len(gps), value) for name, value in factors.items()}
        return replace(gps, **columns)

    def inject(flight: Flight) -> Flight:
        return replace(flight, gps=tuple(map(changed, flight.gps)))

    return inject


def _iron(flight: Flight) -> Flight:
    off = 2e-6 * healthy.USUAL_IRON
    fields = (c.field * (1.0 + off / np.linalg.norm(c.field, axis=1)[:, None]) for c in flight.compasses)
    compasses = tuple(replace(c, field=field) for c, field in zip(flight.compasses, fields, strict=True))
    return replace(flight, compasses=compasses)


_LEAN = STANDARD_GRAVITY * np.tan(2.0 * harm.AP_ERROR["tilt"])
_WARMING = 2.0 * _GYRO / harm.WARMING_S
_X, _Z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
FAULTS: dict[str, Inject] = {
    "gyro_bias": _imu(lambda t: replace(t, gyro=t.gyro + 2.0 * _GYRO * np.sign(t.gyro.mean(axis=0)) * _X)),
    "gyro_warming": _imu(lambda t: replace(t, gyro=t.gyro + (_WARMING * (t.t - t.t[0]))[:, None] * _X)),
    "gyro_frozen": _imu(_frozen),
    "accel_size": _imu(lambda t: replace(t, accel=t.accel - 2.0 * _ACCEL * _Z)),
    "accel_direction": _imu(lambda t: replace(t, accel=t.accel + _LEAN * _X)),
    "gps_satellites": _gps(satellites=4.0),
    "gps_horizontal_sigma": _gps(horizontal_sigma=2.0 * harm.GPS_POOR["horizontal_sigma"]),
    "gps_speed_sigma": _gps(speed_sigma=2.0 * harm.GPS_POOR["speed_sigma"]),
    "compass_field": _iron,
}
"""Line → what makes it twice its limit."""


def checked(flight: Flight) -> Preflight:
    """The checks, with the specifications that the flight names."""
    return preflight(flight, partial(imu_spec_of, flight))


def main() -> int:
    """A line for each log, and the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("logs", nargs="+", type=Path)
    outcomes, lines, wrong_lines = Counter[str](), 0, 0
    seen, found = Counter[str](), Counter[str]()
    for path in parser.parse_args().logs:
        try:
            flight = read_recording(path).flights[0]
            clean = checked(flight)
        except (CompanionError, IndexError):
            continue
        bad = [f"{c.name} of {c.sensor}" for c in clean.checks if c.outcome == "no_go"]
        outcomes[clean.outcome] += 1
        lines, wrong_lines = lines + len(clean.checks), wrong_lines + len(bad)
        print(f"{path.name[:60]:60} {clean.outcome:8} {', '.join(bad)}", flush=True)
        for name, inject in FAULTS.items():
            if any(c.name == name for c in clean.checks) or name == "gyro_frozen":
                made = checked(inject(flight))
                seen[name] += 1
                found[name] += any(c.name == name and c.outcome == "no_go" for c in made.checks)
    print(f"logs: {dict(outcomes)}; lines no-go: {wrong_lines} of {lines}")
    for name, count in seen.items():
        print(f"{name:22} found {found[name]} of {count}")
    print(f"all: found {found.total()} of {seen.total()}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
