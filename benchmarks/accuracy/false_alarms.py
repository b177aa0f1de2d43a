"""How often the live verdict is wrongly suspect: `python benchmarks/accuracy/false_alarms.py [--flights 60] [TLOG...]`.

Simulated flights of 10 minutes without a fault, each of another seed, motion and part of config/imu, or recordings
without a fault, are given to the live judge as a link would, a tenth of a second at a time, with looks and judgements
in turn (`companion.app.live.Pace`) by the flight's own clock, as fast as the computer can. Printed is each flight with
its alarms as it ends, and the sum so far: it may be stopped at any time.
"""

from __future__ import annotations

import argparse
import lzma
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.accuracy.parallel import Failed, each
from companion.app.running_verdict import Assignment, judges_of
from companion.app.sensors import load_imu_spec
from companion.app.settings import Settings
from companion.cli.senders import model_of
from companion.mavlink import Decoder, load_dialect
from companion.simulate import SimulatedVehicle, fly
from companion.verdict import Alarm

EPOCH = 1_700_000_000.0  # s UNIX, when a simulated flight begins
PIECE_S = 0.1
MOTIONS = ("square", "circle")
PARTS = ("icm-42688-p", "bmi270")
STREAMS = {
    "RAW_IMU": 100.0, "SCALED_IMU2": 50.0, "ATTITUDE": 50.0, "LOCAL_POSITION_NED": 20.0, "GPS_RAW_INT": 5.0,
    "SCALED_PRESSURE": 10.0, "EKF_STATUS_REPORT": 2.0, "VIBRATION": 2.0, "GLOBAL_POSITION_INT": 5.0,
    "EXTENDED_SYS_STATE": 1.0,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Watched:
    """What was said of a flight."""

    seconds: float
    judged: int
    consistent: int  # how often of those
    alarms: tuple[Alarm, ...]
    busy_s: float  # of the processor


def simulated(seed: int, seconds: float) -> Iterator[tuple[float, bytes]]:
    """A healthy flight in pieces: (s UNIX when it arrived, bytes)."""
    model = model_of(load_imu_spec(PARTS[seed // 2 % len(PARTS)]), seed)
    flown = fly(seconds, motion=MOTIONS[seed % len(MOTIONS)], model=model, filter_hz=20.0, seed=seed)
    vehicle = SimulatedVehicle(flown, streams=STREAMS, send_parameters=True, seed=seed)
    for end in np.arange(PIECE_S, seconds, PIECE_S):
        yield EPOCH + end, b"".join(packet for _, packet in vehicle.advance(end))


def recorded(path: Path) -> Iterator[tuple[float, bytes]]:
    """A tlog in pieces, likewise."""
    data = lzma.decompress(path.read_bytes()) if path.suffix == ".xz" else path.read_bytes()
    decoder = Decoder(load_dialect(), stamped=True)
    waiting: list[bytes] = []
    begin = 0.0
    for frames in (decoder.push(data), decoder.finish()):
        for stamp, start, size in zip(frames.stamp.tolist(), frames.start.tolist(), frames.size.tolist(), strict=True):
            t = stamp * 1e-6
            if waiting and not begin <= t < begin + PIECE_S:
                yield begin, b"".join(waiting)
                waiting.clear()
            begin = begin if waiting else t
            waiting.append(frames.data[start : start + size].tobytes())
    if waiting:
        yield begin, b"".join(waiting)


def watch(given: tuple[int, float] | Path) -> Watched:
    """Judge a flight as a link is judged: a seed and a length in s, or a tlog."""
    judges = judges_of(Assignment(Settings()))
    judged, consistent = 0, 0
    alarms: tuple[Alarm, ...] = ()
    first = last = 0.0
    for received, packets in recorded(given) if isinstance(given, Path) else simulated(*given):
        judges.receive(packets, received)
        first, last = first or received, received
        said = judges.step(received)
        if said is not None:
            judged, consistent = judged + 1, consistent + (said.status == "consistent")
            alarms = said.alarms
    return Watched(last - first, judged, consistent, alarms, time.process_time())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("logs", nargs="*", type=Path, metavar="TLOG", help="healthy recordings, in place of flights")
    parser.add_argument("--flights", type=int, default=60)
    parser.add_argument("--minutes", type=float, default=10.0, help="of each flight")
    parser.add_argument("--seed", type=int, default=0, help="of the first flight")
    parser.add_argument("--workers", type=int)
    arguments = parser.parse_args()
    seeds = range(arguments.seed, arguments.seed + arguments.flights)
    given: list[tuple[int, float] | Path] = arguments.logs or [(seed, 60.0 * arguments.minutes) for seed in seeds]
    hours, alarms, judged, consistent = 0.0, 0, 0, 0
    for i, one in each(watch, given, workers=arguments.workers, timeout=7200.0):
        name = given[i].name if isinstance(given[i], Path) else f"seed {given[i][0]}"  # type: ignore[union-attr,index]
        if isinstance(one, Failed):
            print(f"{name}: {one.reason}", flush=True)
            continue
        hours, alarms = hours + one.seconds / 3600.0, alarms + len(one.alarms)
        judged, consistent = judged + one.judged, consistent + one.consistent
        print(
            f"{name}: {one.seconds:.0f} s, judged {one.judged} times, {one.consistent} consistent, "
            f"{len(one.alarms)} alarms, {one.busy_s:.0f} s of CPU; in all {alarms} in {hours:.2f} h, "
            f"{consistent / max(judged, 1):.1%} consistent",
            flush=True,
        )
        for alarm in one.alarms:
            print(f"    {alarm.last - alarm.first:.0f} s: {alarm.status}: {alarm.text}", flush=True)


if __name__ == "__main__":
    main()
