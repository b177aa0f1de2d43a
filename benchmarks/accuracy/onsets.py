"""How soon the live verdict tells of a fault: `python benchmarks/accuracy/onsets.py [--onsets 20] [--hours 10]`.

Simulated flights with every aiding sensor, a fault at a random time; each time the last 40 s are judged, as on a
link, with more and more of the fault in them. Printed is the least of it with which the right side is suspect, the
median over the onsets. On a link the time to the next look (0.25 s at most, where the newest windows stand out; see
docs/live.md) and that of one analysis come on top. Then healthy flights are judged every four seconds for so many
hours in all, each estimate going on from the one before: how often is somebody suspect?
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import TypeVar

import numpy as np

from benchmarks.accuracy.parallel import Failed, each
from benchmarks.accuracy.verdicts import SECONDS, Fault, flight, none
from companion.app.live import HORIZON_S, PAUSE_S
from companion.comparison import ImuSpec
from companion.model import (
    Array,
    AttitudeTrack,
    BarometerTrack,
    CompassTrack,
    Flight,
    GpsTrack,
    ImuTrack,
    PositionTrack,
)
from companion.strapdown import quaternion
from companion.verdict import assess

AFTER_S = (1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 12.0)
_EARTH_M = 6_378_137.0
Random = np.random.Generator
Track = TypeVar("Track", ImuTrack, AttitudeTrack, PositionTrack, GpsTrack, CompassTrack, BarometerTrack)


@dataclass(frozen=True)
class Onset:
    """One fault: which side it is of, how soon it has to be told, and what it does to a flight from a time on."""

    name: str
    status: str
    limit_s: float
    spoil: Callable[[Flight, float, Random], Flight]


def _direction(rng: Random) -> Array:
    axis = rng.normal(size=3)
    return np.asarray(axis / np.linalg.norm(axis))


def _imu(one: Flight, change: Callable[[ImuTrack], ImuTrack]) -> Flight:
    return replace(one, imus={name: change(track) for name, track in one.imus.items()})


def gyro_step(one: Flight, begin: float, rng: Random) -> Flight:
    bias = 0.02 * _direction(rng)
    return _imu(one, lambda imu: replace(imu, gyro=imu.gyro + bias * (imu.t >= begin)[:, None]))


def accel_step(one: Flight, begin: float, rng: Random) -> Flight:
    bias = 0.5 * _direction(rng)
    return _imu(one, lambda imu: replace(imu, accel=imu.accel + bias * (imu.t >= begin)[:, None]))


def stuck_axis(one: Flight, begin: float, rng: Random) -> Flight:
    axis = int(rng.integers(2))

    def held(imu: ImuTrack) -> ImuTrack:
        gyro, after = imu.gyro.copy(), imu.t >= begin
        gyro[after, axis] = gyro[np.argmax(after), axis]
        return replace(imu, gyro=gyro)

    return _imu(one, held)


def position_jump(one: Flight, begin: float, rng: Random) -> Flight:
    del rng
    assert one.position
    moved = one.position.position + (one.position.t >= begin)[:, None] * [6.0, 8.0, 0.0]
    return replace(one, position=replace(one.position, position=moved))


def gps_jump(one: Flight, begin: float, rng: Random) -> Flight:
    (gps,) = one.gps
    after = gps.t >= begin
    north, east = np.degrees([6.0 / _EARTH_M, 8.0 / _EARTH_M / np.cos(np.radians(gps.latitude[0]))])
    moved = replace(gps, latitude=gps.latitude + north * after, longitude=gps.longitude + east * after)
    return replace(position_jump(one, begin, rng), gps=(moved,))


def heading_step(one: Flight, begin: float, rng: Random) -> Flight:
    del rng
    attitude = one.require_attitude()
    q, after = attitude.q_ned_frd.copy(), attitude.t >= begin
    q[after] = quaternion.multiply(quaternion.exp(np.array([0.0, 0.0, np.radians(15.0)])), q[after])
    return replace(one, attitude=replace(attitude, q_ned_frd=q))


ONSETS = (
    Onset("gyro step of 20 mrad/s", "imu_suspect", 6.0, gyro_step),
    Onset("accelerometer step of 0.5 m/s²", "imu_suspect", 4.0, accel_step),
    Onset("stuck gyro axis", "imu_suspect", 2.0, stuck_axis),
    Onset("position jumps 10 m", "autopilot_suspect", 2.0, position_jump),
    Onset("position and GPS jump 10 m", "autopilot_suspect", 2.0, gps_jump),
    Onset("heading steps 15°", "autopilot_suspect", 5.0, heading_step),
)


def until(one: Flight, end: float) -> Flight:
    """The last seconds before `end`, as a live verdict has them."""
    begin = end - HORIZON_S

    def part(track: Track) -> Track:
        inside = (track.t >= begin) & (track.t < end)
        arrays = {field.name: getattr(track, field.name) for field in fields(track)}
        return replace(track, **{n: a[inside] for n, a in arrays.items() if np.shape(a)[:1] == track.t.shape})

    assert one.position
    return replace(
        one,
        start=begin,
        duration=HORIZON_S,
        imus={name: part(track) for name, track in one.imus.items()},
        attitude=part(one.require_attitude()),
        position=part(one.position),
        gps=tuple(map(part, one.gps)),
        compasses=tuple(map(part, one.compasses)),
        barometers=tuple(map(part, one.barometers)),
    )


def told_after(onset: Onset, seed: int) -> tuple[float, str]:
    """How many seconds of the fault the verdict needed (infinite: more than were tried), and who else was suspect."""
    rng = np.random.default_rng(seed)
    built, imu_spec = flight(rng, Fault("healthy", "", (), none, lively=True))
    begin = built.start + HORIZON_S + float(rng.uniform(0.0, 3.0))
    spoilt = onset.spoil(built, begin, rng)
    blamed = ""
    for after in AFTER_S:
        status = _status(until(spoilt, begin + after), imu_spec)
        if status == onset.status:
            return after, blamed
        if status.endswith("suspect"):
            blamed = status
    return np.inf, blamed


def _status(one: Flight, imu_spec: ImuSpec) -> str:
    return assess(one, imu_spec).verdict.status


def alarms(seed: int) -> tuple[float, Counter[str], list[str]]:
    """A healthy flight listened to: seconds of verdicts, how many there were of each status, and the alarms' texts."""
    rng = np.random.default_rng(seed)
    built, imu_spec = flight(rng, Fault("healthy", "", (), none, lively=bool(seed % 2)))
    said: Counter[str] = Counter()
    told: list[str] = []
    suspect, before = False, None
    ends = np.arange(built.start + HORIZON_S, built.start + built.duration, PAUSE_S)
    for end in ends.tolist():
        assessed = assess(until(built, end), imu_spec, before=before)
        verdict, before = assessed.verdict, assessed.best
        said[verdict.status] += 1
        if verdict.status.endswith("suspect") and not suspect:
            told.append(f"flight {seed}, {end - built.start:.0f} s: {verdict.summary}")
        suspect = verdict.status.endswith("suspect")
    return PAUSE_S * len(ends), said, told


def _listened(hours: float, workers: int | None) -> None:
    """False alarms of healthy flights."""
    flights = range(5000, 5000 + max(1, math.ceil(3600.0 * hours / (SECONDS - HORIZON_S))))
    seconds, said = 0.0, Counter[str]()
    told: list[str] = []
    for number, result in each(alarms, flights, workers=workers):
        if isinstance(result, Failed):
            told.append(f"flight {flights[number]}: {result.reason}")
            continue
        seconds, said = seconds + result[0], said + result[1]
        told += result[2]
    print(f"\nhealthy, {seconds / 3600.0:.2f} h: {len(told)} false alarms; of {said.total()} verdicts: {dict(said)}")
    print(*told, sep="\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--onsets", type=int, default=20, help="of each fault (default: 20)")
    parser.add_argument("--hours", type=float, default=0.5, help="of healthy flight (default: 0.5)")
    parser.add_argument("--workers", type=int, help="processes for these, default: one for each processor")
    arguments = parser.parse_args()
    print(f"{'fault':34}{'median, s':>10}{'worst, s':>10}{'limit, s':>10}   wrong side")
    for onset in ONSETS if arguments.onsets else ():
        told = [told_after(onset, 1000 + seed) for seed in range(arguments.onsets)]
        after = np.array([one for one, _ in told])
        wrong = sum(bool(blamed) for _, blamed in told)
        print(
            f"{onset.name:34}{np.median(after):>10.1f}{after.max():>10.1f}{onset.limit_s:>10.1f}   {wrong}", flush=True
        )
    _listened(arguments.hours, arguments.workers)


if __name__ == "__main__":
    main()
