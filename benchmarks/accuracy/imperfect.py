"""Healthy flights made as imperfect as real ones: `python benchmarks/accuracy/imperfect.py [LOG_OR_FOLDER ...]`.

Nothing is broken, but the GPS wanders, the compass feels the motors, biases drift with temperature, scales are a per
cent off, the IMU shakes, the log has gaps. The small EKF (ekf.py) lives with it as a real one would. Nobody is to be
blamed, unless the EKF's estimate really went off by more than an estimator in order does.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from benchmarks.accuracy.answer import Answer, answer
from benchmarks.accuracy.cutting import at, attitude_at, every_imu, gps_moved
from benchmarks.accuracy.injected import (
    FAST_HZ,
    NO_LOGS,
    STANDARD,
    as_logged,
    estimator,
    flown,
    followed,
    is_slow,
    logs_of,
    vehicle_of,
)
from benchmarks.accuracy.parallel import Failed, each
from companion.app.recording import read_recording
from companion.model import STANDARD_GRAVITY, Array, Flight, ImuTrack, rows
from companion.strapdown import quaternion

Random = np.random.Generator
Change = Callable[[Flight, Random], Flight]
Result = Literal["clear", "cannot tell", "false alarm", "off indeed", "failed"]

_SHAKES_HZ = 87.0  # a propeller's
_OFF = (np.radians(2.0), np.radians(8.0), 1.0, 4.0)  # tilt, heading, m/s, m: an estimator in order is off by less


@dataclass(frozen=True, slots=True)
class Row:
    """One imperfection of one flight, and what was said."""

    vehicle: str
    log: str
    rate: str  # "full" or "25 Hz"
    imperfection: str
    seed: int
    result: Result
    said: str


def wandering(t: Array, sigma: float, lasting_s: float, random: Random, count: int) -> Array:
    """(N, count) Gauss-Markov errors of first order at times t (N,)."""
    keep = np.exp(-np.diff(t, prepend=t[0]) / lasting_s)
    fresh = random.normal(0.0, sigma, (len(t), count)) * np.sqrt(1.0 - keep**2)[:, None]
    values = np.empty((len(t), count))
    values[0] = random.normal(0.0, sigma, count)
    for i in range(1, len(t)):
        values[i] = keep[i] * values[i - 1] + fresh[i]
    return values


def _gps(sigma: float, lasting_s: float, velocity: float) -> Change:
    """Position wanders by sigma (m; half as much again in height) for lasting_s, velocity by as many m/s for 3 s."""

    def change(flight: Flight, random: Random) -> Flight:
        changed = []
        for gps in flight.gps:
            away = wandering(gps.t, sigma, lasting_s, random, 3)
            told = gps.velocity + wandering(gps.t, velocity, 3.0, random, 3)
            changed.append(replace(gps_moved(gps, away[:, :2]), height=gps.height + 1.5 * away[:, 2], velocity=told))
        return replace(flight, gps=tuple(changed))

    return change


def _compass(flight: Flight, random: Random) -> Flight:
    """The motors' current turns the heading by about 5° in a hover."""
    imu, changed = flight.imu(), []
    width = max(round(imu.rate_hz), 1)
    throttle = np.convolve(-imu.accel[:, 2], np.full(width, 1.0 / width), "same") / STANDARD_GRAVITY
    for compass in flight.compasses:
        towards = random.normal(size=3)
        size = 0.5 * np.sin(np.radians(5.0)) * float(np.median(np.linalg.norm(compass.field, axis=1)))
        felt = np.clip(np.interp(compass.t, imu.t, throttle), 0.0, 2.0)[:, None]
        changed.append(replace(compass, field=compass.field + felt * size * towards / np.linalg.norm(towards)))
    return replace(flight, compasses=tuple(changed))


def _barometer(flight: Flight, random: Random) -> Flight:
    changed = []
    for one in flight.barometers:
        wind = wandering(one.t, 1.0, 15.0, random, 1)[:, 0]
        changed.append(replace(one, altitude=one.altitude + wind, pressure=one.pressure - 12.0 * wind))
    return replace(flight, barometers=tuple(changed))


def _imu(change: Callable[[ImuTrack, Random], ImuTrack]) -> Change:
    return lambda flight, random: every_imu(flight, lambda track: change(track, random))


def _warming(track: ImuTrack, random: Random) -> ImuTrack:
    grown = ((track.t - track.t[0]) / max(float(np.ptp(track.t)), 1.0))[:, None]
    gyro, accel = random.normal(0.0, 1.5e-3, 3), random.normal(0.0, 0.03, 3)
    return replace(track, gyro=track.gyro + grown * gyro, accel=track.accel + grown * accel)


def _misaligned(track: ImuTrack, random: Random) -> ImuTrack:
    """Scales and axes of a part that is not calibrated: 1 % and 0.6° of the gyro, half of that of the accelerometer."""
    gyro, accel = (np.eye(3) + random.normal(0.0, size, (3, 3)) for size in (0.01, 0.005))
    return replace(track, gyro=track.gyro @ gyro.T, accel=track.accel @ accel.T)


def _shaken(size: float) -> Callable[[ImuTrack, Random], ImuTrack]:
    """By the propellers, with the thrust: a line and as much white noise, m/s² and 0.03 rad/s for each of them."""

    def change(track: ImuTrack, random: Random) -> ImuTrack:
        thrust = np.clip(-track.accel[:, 2] / STANDARD_GRAVITY, 0.0, 2.0)[:, None]
        turns = np.cumsum((_SHAKES_HZ + 3.0 * np.sin(0.3 * track.t)) * np.gradient(track.t))

        def shake(phase: float) -> Array:
            line = np.sin(2.0 * np.pi * turns + phase)[:, None] * random.normal(1.0, 0.3, 3)
            return np.asarray(thrust * size * (line + random.normal(size=(len(turns), 3))))

        return replace(track, accel=track.accel + shake(0.0), gyro=track.gyro + 0.03 * shake(1.0))

    return change


def _lossy(flight: Flight, random: Random) -> Flight:
    """The log lacks 5 % of the samples of the IMU and 1.5 s of all of them; the estimator had them."""
    begin = flight.start + 0.6 * flight.duration

    def lose(track: ImuTrack) -> ImuTrack:
        kept = np.random.default_rng(len(track.t)).random(len(track.t)) > 0.05  # an IMU's messages lose the same
        return rows(track, kept & ((track.t < begin) | (track.t > begin + 1.5)))

    del random
    return every_imu(flight, lose)


def _all(*changes: Change) -> Change:
    def change(flight: Flight, random: Random) -> Flight:
        for one in changes:
            flight = one(flight, random)
        return flight

    return change


@dataclass(frozen=True, slots=True)
class Imperfection:
    """One way to be imperfect."""

    change: Change
    sensed: bool = True  # the estimator has to live with it; otherwise the log alone has it


IMPERFECTIONS: dict[str, Imperfection] = {
    "GPS wanders by 1.5 m for 60 s": Imperfection(_gps(1.5, 60.0, 0.05)),
    "GPS wanders by 3 m for 60 s": Imperfection(_gps(3.0, 60.0, 0.15)),
    "GPS wanders by 1 m for 5 s": Imperfection(_gps(1.0, 5.0, 0.1)),
    "motors turn the compass by 5°": Imperfection(_compass),
    "IMU warms": Imperfection(_imu(_warming)),
    "IMU not calibrated": Imperfection(_imu(_misaligned)),
    "IMU shaken by 2 m/s²": Imperfection(_imu(_shaken(2.0))),
    "IMU shaken by 4 m/s²": Imperfection(_imu(_shaken(4.0))),
    "samples and 1.5 s lost": Imperfection(_lossy, sensed=False),
    "wind at the barometer": Imperfection(_barometer),
    "all at once": Imperfection(
        _all(_gps(1.5, 60.0, 0.05), _compass, _imu(_warming), _imu(_misaligned), _imu(_shaken(2.0)), _barometer)
    ),
}


@dataclass(frozen=True, slots=True)
class Case:
    """One imperfection in the flights of a log."""

    log: str
    imperfection: str
    seed: int


def judged(case: Case) -> list[Row]:
    """What is said of each flight of the log, at its full rate and at 25 Hz."""
    rows = []
    for whole in read_recording(case.log).flights:
        flight = flown(whole) if whole.imus else None
        if flight is None:
            continue
        known, healthy = estimator(flight)
        slow = is_slow(flight)
        before = flight if slow or healthy is None else healthy
        imperfection, random = IMPERFECTIONS[case.imperfection], np.random.default_rng(case.seed)
        if imperfection.sensed:
            made = followed(imperfection.change(flight, random), flight, known, healthy)
        else:
            made = imperfection.change(before, random)
        for thin in [False] * (not slow) + [True] * (slow or flight.imu().rate_hz >= FAST_HZ):
            said = answer(as_logged(made, thin=thin))
            result = _result(said, made, before)
            rate = "25 Hz" if thin else "full"
            words = said.side if result == "clear" else said.summary
            path = Path(case.log)
            rows.append(Row(vehicle_of(path), path.name, rate, case.imperfection, case.seed, result, words))
    return rows


def _result(said: Answer, made: Flight, before: Flight) -> Result:
    if said.side == "none":
        return "clear"
    if said.side == "cannot_tell":
        return "cannot tell"
    return "off indeed" if said.side == "autopilot" and is_off(made, before, said) else "false alarm"


def is_off(made: Flight, before: Flight, said: Answer) -> bool:
    """Whether the estimate is off, against that of the flight before, in the time that is said."""
    begin = -np.inf if said.onset is None else said.onset - 0.5
    end = np.inf if said.end is None else said.end + 0.5
    attitude, there = made.require_attitude(), before.require_attitude()
    q = attitude_at(attitude.t, there.t, there.q_ned_frd)
    turn = quaternion.log(quaternion.multiply(attitude.q_ned_frd, quaternion.conjugate(q)))
    turn = turn[(attitude.t >= begin) & (attitude.t <= end)]
    off = [np.linalg.norm(turn[:, :2], axis=1), np.abs(turn[:, 2])]
    if made.position is not None and before.position is not None:
        t, home = made.position.t, before.position
        inside = (t >= begin) & (t <= end)
        for name in ("velocity", "position"):
            moved = getattr(made.position, name) - at(t, home.t, getattr(home, name))
            off.append(np.linalg.norm(moved[inside], axis=1))
    return any(len(one) > 0 and float(one.max()) > most for one, most in zip(off, _OFF, strict=False))


def table(rows: Sequence[Row]) -> str:
    """How often what was said, by imperfection."""
    results: tuple[Result, ...] = ("clear", "cannot tell", "off indeed", "false alarm", "failed")
    lines = ["| | " + " | ".join(results) + " |", "|---|" + "---|" * len(results)]
    shown = [name for name in IMPERFECTIONS if any(row.imperfection == name for row in rows)]
    for name in [*shown, "all of these"]:
        count = Counter(row.result for row in rows if name in (row.imperfection, "all of these"))
        lines.append(f"| {name} | " + " | ".join(str(count[result] or "") for result in results) + " |")
    return "\n".join(lines)


def main() -> int:
    """Print the table, and every false alarm."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", type=Path, help="healthy logs, or folders of them")
    parser.add_argument("--seeds", type=int, default=1, help="of each imperfection in each flight (default: 1)")
    parser.add_argument("--only", choices=tuple(IMPERFECTIONS), help="only this one")
    parser.add_argument("--workers", type=int, help="processes, default: one for each processor")
    parser.add_argument("--json", type=Path, help="write every row there")
    chosen = parser.parse_args()
    paths = logs_of(chosen.logs, STANDARD)
    if not paths:
        parser.error(NO_LOGS)
    names = [chosen.only] if chosen.only else list(IMPERFECTIONS)
    todo = [Case(str(path), name, seed) for path in paths for name in names for seed in range(1, chosen.seeds + 1)]
    rows: list[Row] = []
    for index, result in each(judged, todo, workers=chosen.workers, timeout=600.0):
        case = todo[index]
        if isinstance(result, Failed):
            new = [Row("", Path(case.log).name, "", case.imperfection, case.seed, "failed", result.reason)]
        else:
            new = result
        rows += new
        for row in new:
            if row.result in ("false alarm", "off indeed", "failed"):
                print(f"{row.result}: {row.log}, {row.rate}, {row.imperfection}: {row.said}", file=sys.stderr)
    print(table(rows))
    print(f"{len(rows)} verdicts")
    if chosen.json:
        chosen.json.write_bytes(msgspec.json.format(msgspec.json.encode(rows)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
