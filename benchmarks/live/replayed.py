"""How soon and how steadily a link is judged: `python benchmarks/live/replayed.py [NAME ...]`.

Recordings are handed to the live verdict as a link would hand them over: in pieces of 0.25 s, on a clock that also runs
while it judges. What takes the processor 1 s comes 1 s later, so that figures of a slow computer are worse; --cost 0
leaves that out. Printed, of each fault of benchmarks/live/faults.toml: how long after the onset the first alarm came
that names side, sensor and IMU; alarms before the onset, and those after it that named another before that; how often
an alarm went on or off or changed sides until the end; who was suspect at the end; how many of the verdicts could not
tell; the longest time that a verdict took the processor. Of healthy recordings every alarm is one too many. Without
names: all of them.
"""

from __future__ import annotations

import argparse
import lzma
import time
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.accuracy.labels import PACKED, SHARED
from companion.app.live import Judge, Pace, new_stream
from companion.app.running_verdict import Assignment, verdict_on
from companion.app.settings import Settings
from companion.mavlink import Decoder, load_dialect, log_time
from companion.model import Flight
from companion.verdict import Band, Cause, LiveVerdict, Verdict

FAULTS = Path(__file__).with_name("faults.toml")
_PIECE_S = 0.25
_WORDS = {"imu_suspect": "imu", "autopilot_suspect": "autopilot"}


class Fault(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A recording and what is known of it; times in s, boot clock."""

    log: str  # below the folder
    side: str = ""  # "imu", "autopilot"; "" for a healthy one
    sensor: str = ""
    imu: int | None = None
    onset: float = 0.0
    end: float | None = None  # None: it lasts to the end
    until: float | None = None  # s, where the recording is left
    what: str = ""


class _Faults(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    fault: tuple[Fault, ...]


@dataclass(frozen=True, slots=True)
class Told:
    """A verdict: when it was there (s, boot clock), what it was and who is suspect by it."""

    t: float
    newest: float
    took: float
    verdict: LiveVerdict
    cause: Cause | None


def pieces(path: Path) -> Iterator[tuple[bytes, float]]:
    """A recording as a link brings it: what arrives within a piece, and when, s UNIX."""
    data = lzma.decompress(path.read_bytes()) if path.suffix == ".xz" else path.read_bytes()
    frames = Decoder(load_dialect(), stamped=True).push(data)
    stamps = log_time(frames.stamp)
    piece = np.floor(np.maximum.accumulate(stamps) / _PIECE_S)
    edges = np.flatnonzero(np.diff(piece, prepend=-1.0, append=np.inf))
    for first, last in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        parts = (frames.data[s : s + n] for s, n in zip(frames.start[first:last], frames.size[first:last], strict=True))
        yield b"".join(part.tobytes() for part in parts), float((piece[first] + 1) * _PIECE_S)


def listened(path: Path, cost: float, until: float = np.inf) -> list[Told]:
    """Everything that is said of a recording."""
    assignment, ends, causes = Assignment(Settings()), [0.0], list[Cause | None]([None])
    judging = verdict_on(assignment)

    def noted(flight: Flight, imu: str | None) -> tuple[Verdict, Band]:
        ends[0] = flight.start + flight.duration
        verdict, band = judging(flight, imu)
        causes[0] = verdict.cause if verdict.status in _WORDS else None
        return verdict, band

    judge = Judge(noted, new_stream(assignment.settings.log.dialect))
    pace, now, out = Pace(judge), 0.0, list[Told]()
    for data, received in pieces(path):
        judge.receive(data, received)
        if received < now:
            continue
        now, before = received, time.process_time()
        causes[0] = None
        verdict = pace.step(now)
        took = time.process_time() - before
        now += cost * took
        if verdict is not None:
            out.append(Told(ends[0] + cost * took, ends[0], took, verdict, causes[0]))
            if ends[0] > until:
                break
    return out


def is_right(fault: Fault, one: Told) -> bool:
    """Whether an alarm names the side, the sensor and the IMU."""
    cause = one.cause
    if _WORDS.get(one.verdict.status) != fault.side or cause is None:
        return False
    whole = not cause.sensor  # a whole IMU that is frozen, or what is no sensor's
    return (whole or not fault.sensor or cause.sensor == fault.sensor) and (
        fault.imu is None or cause.imu is None or cause.imu == fault.imu
    )


def row(fault: Fault, said: Sequence[Told]) -> str:
    """A line of the table."""
    alarms = [one for one in said if one.verdict.status in _WORDS]
    early = [one for one in alarms if one.newest < fault.onset or not fault.side]
    after = [one for one in alarms if one.newest >= fault.onset and fault.side]
    right = next((one for one in after if is_right(fault, one)), None)
    wrong = [one for one in after if not is_right(fault, one) and (right is None or one.t < right.t)]
    states = [_WORDS.get(one.verdict.status, "") for one in said]
    changes = sum(a != b for a, b in zip(["", *states], states, strict=False))
    undecided = sum(one.verdict.status == "insufficient_data" for one in said)
    longest = max((one.took for one in said), default=0.0)
    soon = "" if not fault.side else "never" if right is None else f"{right.t - fault.onset:.1f}"
    last = (states or [""])[-1] or "-"
    return (
        f"{Path(fault.log).name:34}{soon:>8}{len(early):>7}{len(wrong):>7}{changes:>9}  {last:10}"
        f"{undecided:>4}/{len(said):<4}{longest:>6.1f}"
    )


def load(path: Path = FAULTS) -> tuple[Fault, ...]:
    """The table of recordings."""
    with path.open("rb") as file:
        return msgspec.convert(tomllib.load(file), _Faults).fault


def found(log: str) -> Path | None:
    """A recording, packed or not."""
    return next((path for suffix in ("", *PACKED) if (path := SHARED / f"{log}{suffix}").exists()), None)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="parts of the names of recordings")
    parser.add_argument("--cost", type=float, default=1.0, help="s of its clock for 1 s of the processor (default: 1)")
    parser.add_argument("--all", action="store_true", help="print every verdict too")
    arguments = parser.parse_args()
    print(
        f"{'recording':34}{'right, s':>8}{'early':>7}{'wrong':>7}{'changes':>9}  {'at the end':10}"
        f"{'unsure':>9}{'longest, s':>6}"
    )
    for fault in load():
        path = found(fault.log)
        if path is None or (arguments.names and not any(name in fault.log for name in arguments.names)):
            continue
        said = listened(path, arguments.cost, np.inf if fault.until is None else fault.until)
        if arguments.all:
            for one in said:
                print(f"  {one.newest:7.1f} {one.took:4.1f} {one.verdict.status:18}{one.verdict.text[:220]}")
        print(row(fault, said), flush=True)


if __name__ == "__main__":
    main()
