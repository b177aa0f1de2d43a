"""Whether a verdict stays where it has to: `python benchmarks/accuracy/invariance.py [LOG ...]`.

What is no different flight may get no different verdict: the same without its first or last seconds, with fewer samples
of the IMU, the attitude or the GPS, with a little more noise, or with a second IMU that reads as the first does.
"Cannot tell" is no flip: with less to see less is told. Without arguments: recordings of ../shared/tlogs with and
without faults.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.accuracy.answer import Answer, answer
from benchmarks.accuracy.cutting import cut, every_imu
from benchmarks.accuracy.injected import NO_LOGS, logs_of
from benchmarks.accuracy.parallel import Failed, each
from companion.app.recording import read_recording
from companion.model import Flight, ImuTrack, rows

STANDARD = (
    "sitl/copter-demo-100hz.tlog",
    "sitl/copter-biased-imu-100hz.tlog",
    "ap_witness/gyro1_z_15mrad.tlog.xz",
    "ap_witness/clean_cruise.tlog.xz",
    "px4_faults/q_accel_step.tlog.xz",
    "px4_faults/q_gps_creep.tlog.xz",
    "ap_turn3/l_imu2gyr.tlog.xz",
    "real/JAParedes__ulogPX4QuadcopterAnimation__TestFlight1.ulg",
)
_CUT_S = 5.0


def _thin(flight: Flight, every: int) -> Flight:
    return every_imu(flight, lambda track: rows(track, slice(None, None, every)))


def _noisier(flight: Flight) -> Flight:
    """A tenth more of the scatter from one sample to the next."""
    rng = np.random.default_rng(0)

    def louder(track: ImuTrack) -> ImuTrack:
        more = {
            name: read
            + np.sqrt(1.1**2 - 1.0) * np.diff(read, axis=0).std(axis=0) / np.sqrt(2.0) * rng.normal(size=read.shape)
            for name, read in (("gyro", track.gyro), ("accel", track.accel))
        }
        return replace(track, gyro=more["gyro"], accel=more["accel"])

    return every_imu(flight, louder)


def _attitude(flight: Flight, hz: float) -> Flight:
    if flight.attitude is None:
        return flight
    every = max(1, round((len(flight.attitude) - 1) / max(np.ptp(flight.attitude.t), 1e-9) / hz))
    return replace(flight, attitude=rows(flight.attitude, slice(None, None, every)))


def _gps(flight: Flight) -> Flight:
    """One fix a second."""
    return replace(flight, gps=tuple(
        rows(one, np.flatnonzero(np.diff(np.floor(one.t), prepend=-1.0) > 0)) for one in flight.gps
    ))  # fmt: skip


def _second_imu(flight: Flight) -> Flight:
    """One that reads what the first does, and its own noise."""
    own, rng = flight.imu(), np.random.default_rng(1)
    instance = 1 + max(track.instance for track in flight.imus.values())
    twin = replace(
        own,
        source="TWIN",
        instance=instance,
        gyro=own.gyro + 1e-3 * rng.normal(size=own.gyro.shape),
        accel=own.accel + 0.02 * rng.normal(size=own.accel.shape),
    )
    return replace(flight, imus={**flight.imus, "TWIN": twin})


CHANGES: dict[str, Callable[[Flight], Flight]] = {
    "as it is": lambda flight: flight,
    "without its first 5 s": lambda f: cut(f, f.start + _CUT_S, f.start + f.duration + 1.0),
    "without its last 5 s": lambda f: cut(f, f.start, f.start + f.duration - _CUT_S),
    "every second IMU sample": lambda f: _thin(f, 2),
    "a tenth more noise": _noisier,
    "attitude at 5 Hz": lambda f: _attitude(f, 5.0),
    "attitude at 1 Hz": lambda f: _attitude(f, 1.0),
    "GPS at 1 Hz": _gps,
    "a twin as second IMU": _second_imu,
}


@dataclass(frozen=True, slots=True)
class Row:
    """A flight with one change, and what is said of it."""

    log: str
    change: str
    said: Answer


def judged(path: Path) -> list[Row]:
    """Every change of the longest flight of a recording."""
    flight = max(read_recording(path).flights, key=lambda one: one.duration)
    return [Row(path.name, name, answer(change(flight))) for name, change in CHANGES.items()]


def flips(judgements: list[Row]) -> list[Row]:
    """Those of which another status is told than of the flight as it is, but for "cannot tell"; or another cause."""
    first = judgements[0].said
    return [
        row
        for row in judgements[1:]
        if "cannot_tell" not in (row.said.side, first.side)
        and (row.said.side, row.said.cause) != (first.side, first.cause)
    ]


def main() -> int:
    """Print what flips."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", type=Path)
    parser.add_argument("--workers", type=int, help="processes, default: one for each processor")
    chosen = parser.parse_args()
    paths = logs_of(chosen.logs, STANDARD)
    if not paths:
        parser.error(NO_LOGS)
    counts: Counter[str] = Counter()
    for index, judgements in each(judged, paths, workers=chosen.workers, timeout=1200.0):
        if isinstance(judgements, Failed):
            print(f"{paths[index].name}: {judgements.reason}", file=sys.stderr)
            continue
        first = judgements[0].said
        print(f"{judgements[0].log}: {first.side} {first.cause}")
        turned = flips(judgements)
        counts.update(["changes"] * (len(judgements) - 1), flips=len(turned))
        counts["cannot tell"] += sum(r.said.side == "cannot_tell" != first.side for r in judgements[1:])
        for row in turned:
            print(f"  {row.change}: {row.said.side} {row.said.cause}: {row.said.summary}")
    print(f"{counts['flips']} flips of {counts['changes']}; cannot tell any more: {counts['cannot tell']}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
