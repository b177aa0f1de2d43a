"""Where the time and memory of `companion analyze` go, stage by stage, and how both grow with the length of a flight.

    python benchmarks/analyze.py [--minutes 1 10 60] [--keep FOLDER]

The bundled flight, one with a fault, and simulated ones of 100 Hz, written in pieces of ten minutes: take-off, squares,
landing, armed all the while, one boot. Each is analysed in a process of its own. Its CPU time (user and system) is
asked for every 5 ms of it and counted to the stage whose functions are on the stack then; peak memory is the most that
was resident during a stage, the interpreter and the libraries (the last column of the first line) included.
Last comes what a second thread would gain.

Ten hours: `--minutes 600`, which takes ten times as long as an hour.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import msgspec
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "companion"

STAGES: dict[str, tuple[str, ...]] = {
    "telemetry": ("telemetry",),
    "read": ("logs", "mavlink"),
    "evidence": (
        "estimation/search.py", "estimation/scan.py", "estimation/evidence.py", "estimation/identifiability.py",
        "estimation/differences.py",
    ),
    "smooth": ("estimation", "noise"),
    "masks": ("verdict/findings", "comparison/phases.py"),
    "drift": ("comparison", "verdict", "strapdown"),
    "present": ("present", "cli", "documents"),
}  # fmt: skip
"""Stage → the files of companion/ that it is; a stack with functions of several is of the first of them. Readers are
called by what makes tracks, the estimate by the analysis, and everything by the command line."""
ORDER = ("read", "telemetry", "smooth", "evidence", "masks", "drift", "present")

PIECE_S = 600.0
STREAMS = {
    "RAW_IMU": 100.0, "ATTITUDE": 50.0, "SCALED_IMU2": 25.0, "LOCAL_POSITION_NED": 20.0, "SCALED_PRESSURE": 10.0,
    "GPS_RAW_INT": 5.0, "EKF_STATUS_REPORT": 2.0, "VIBRATION": 2.0,
}  # fmt: skip
ARMED = 128  # MAV_MODE_FLAG_SAFETY_ARMED
EVERY_S = 0.005


class Measured(msgspec.Struct):
    """One analysis of one log."""

    cpu_s: dict[str, float]  # by stage
    peak_mb: dict[str, float]  # by stage
    imported_mb: float  # before anything is read
    samples: int  # of the IMU that is judged
    status: str

    @property
    def total_s(self) -> float:
        return sum(self.cpu_s.values())


class StageClock:
    """Counts the CPU time of this process by stage while it is entered."""

    def __init__(self) -> None:
        self.cpu: dict[str, float] = {}
        self.peak: dict[str, float] = {}
        self._names = [*STAGES, "present"]  # what is of none is the command line's: libraries that print
        self._ranks: dict[CodeType, int] = {}
        self._last = 0.0

    def __enter__(self) -> StageClock:
        self._last = time.process_time()
        signal.signal(signal.SIGPROF, self._tick)
        signal.setitimer(signal.ITIMER_PROF, EVERY_S, EVERY_S)
        return self

    def __exit__(self, *_: object) -> None:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        self._tick(0, None)

    def _tick(self, _: int, frame: FrameType | None) -> None:
        now, rank = time.process_time(), len(STAGES)
        while frame is not None and rank:
            rank = min(rank, self._rank(frame.f_code))
            frame = frame.f_back
        stage = self._names[rank]
        self.cpu[stage] = self.cpu.get(stage, 0.0) + now - self._last
        self.peak[stage] = max(self.peak.get(stage, 0.0), resident_mb())
        self._last = now

    def _rank(self, code: CodeType) -> int:
        if code not in self._ranks:
            path = Path(code.co_filename)
            own = path.relative_to(PACKAGE) if path.is_relative_to(PACKAGE) else None
            mine = (i for i, parts in enumerate(STAGES.values()) if own and any(own.is_relative_to(p) for p in parts))
            self._ranks[code] = next(mine, len(STAGES))
        return self._ranks[code]


def resident_mb() -> float:
    """Memory of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE") / 1e6


def measure(path: Path) -> Measured:
    """One analysis in this process, with what it prints thrown away."""
    from companion.app.examination import Examination  # noqa: PLC0415  (a child's imports are no part of its time)
    from companion.cli import analyze, main  # noqa: PLC0415

    seen: list[Examination] = []
    screen = analyze.first_screen
    analyze.first_screen = lambda examined, width: seen.append(examined) or screen(examined, width)  # type: ignore[func-returns-value]
    imported = resident_mb()
    with Path(os.devnull).open("w") as nowhere, contextlib.redirect_stdout(nowhere), StageClock() as clock:
        if code := main(["analyze", str(path)]):
            raise SystemExit(f"analyze of {path} has failed: {code}")
    (examined,) = seen
    assessment = examined.assessment
    samples = len(assessment.comparison.track)
    return Measured(clock.cpu, clock.peak, imported, samples, assessment.verdict.status)


def in_a_process(path: Path, repeats: int) -> Measured:
    """The one of several whose CPU time is the median."""
    command = [sys.executable, __file__, "--measure", str(path)]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    runs = [
        msgspec.json.decode(
            subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout, type=Measured
        )
        for _ in range(repeats)
    ]
    middle = statistics.median_low(run.total_s for run in runs)
    return next(run for run in runs if run.total_s == middle)


def write_piece(piece: int, seconds: float, out: Path, *, faulty: bool = False) -> None:
    """Append a piece of a flight of many to a tlog: its clock goes on from the one before, its noise is its own."""
    from companion.logs import read_tlog  # noqa: PLC0415
    from companion.simulate import Faults, SimulatedVehicle, fly, write_flight  # noqa: PLC0415
    from tests.tlogs import packed  # noqa: PLC0415

    faults = Faults(imu_bias=(seconds / 2, 0.02)) if faulty else Faults()
    flown = fly(seconds, motion="square", seed=piece, faults=faults)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "piece.tlog"
        write_flight(SimulatedVehicle(flown, streams=STREAMS, send_parameters=piece == 0), path)
        read = read_tlog(path).messages
    begin, later = piece * PIECE_S, []
    for messages in read.values():
        rows = messages.rows.copy()
        for name, unit in (("time_boot_ms", 1e-3), ("time_usec", 1e-6)):
            if name in messages.layout.fields:
                rows[name] += rows.dtype[name].type(round(begin / unit))
        if "base_mode" in messages.layout.fields and not faulty:
            rows["base_mode"] |= ARMED
        later.append(replace(messages, log_time=messages.log_time + begin, rows=rows))
    with out.open("ab") as file:
        file.write(packed(later))


def write_log(minutes: float, out: Path) -> None:
    """A flight of that length, in pieces."""
    left, piece = 60.0 * minutes, 0
    while left > 1.0:
        write_piece(piece, min(left, PIECE_S), out)
        left, piece = left - PIECE_S, piece + 1


def logs_in(folder: Path, minutes: list[float]) -> dict[str, Path]:
    """Name of the row → log; those that are there already are used."""
    logs = {"demo": ROOT / "tlogs" / "copter-demo-100hz.tlog"}

    def made(name: str, write: Callable[[Path], None]) -> None:
        logs[name] = folder / f"{name.replace(' ', '-')}.tlog"
        if not logs[name].exists():
            part = logs[name].with_suffix(".part")
            part.unlink(missing_ok=True)
            write(part)
            part.rename(logs[name])

    made("faulty 2 min", lambda out: write_piece(0, 120.0, out, faulty=True))
    for length in minutes:
        made(f"{length:g} min", lambda out, length=length: write_log(length, out))  # type: ignore[misc]
    return logs


def print_tables(found: dict[str, Measured]) -> None:
    """CPU s and peak MB by stage, then how cost grows."""
    for title, column in (("CPU s", "cpu_s"), ("peak MB", "peak_mb")):
        print(f"\n{title:14}" + "".join(f"{stage:>11}" for stage in ORDER) + f"{'all':>9}")
        for name, one in found.items():
            by_stage: dict[str, float] = getattr(one, column)
            whole = one.total_s if column == "cpu_s" else max(one.peak_mb.values())
            digits = 2 if column == "cpu_s" else 0
            print(f"{name:14}" + "".join(f"{by_stage.get(s, 0):11.{digits}f}" for s in ORDER) + f"{whole:9.{digits}f}")
    cheapest = min(1e6 * one.total_s / one.samples for one in found.values())
    print(f"\n{'growth':14}{'samples':>11}{'µs/sample':>11}{'x cheapest':>11}{'B/sample':>11}   verdict")
    for name, one in found.items():
        each = 1e6 * one.total_s / one.samples
        room = 1e6 * (max(one.peak_mb.values()) - one.imported_mb) / one.samples
        print(f"{name:14}{one.samples:11,}{each:11.1f}{each / cheapest:11.2f}{room:11.0f}   {one.status}")


def print_threads() -> None:
    """What a second thread would gain where the most time of a long flight goes: each half of the blocks or samples."""
    from companion.strapdown import motions, preintegrate  # noqa: PLC0415

    blocks = np.random.default_rng(0).standard_normal((1200, 24, 24))
    definite = blocks @ blocks.swapaxes(1, 2) + np.eye(24)
    imu = motions.coning(np.arange(360_000) / 100.0).imu
    jobs: dict[str, tuple[Callable[[Any], object], Any]] = {
        "products": (lambda part: part @ part, blocks),
        "roots": (np.linalg.cholesky, definite),
        "integration": (preintegrate, imu),
    }
    print(f"\n{'two threads':14}{'one, ms':>11}{'two, ms':>11}{'x as fast':>11}")
    with ThreadPoolExecutor(2) as threads:
        for name, (run, whole) in jobs.items():
            middle, one, two = len(whole) // 2, list[float](), list[float]()
            for _ in range(21):
                for took, parts in ((one, (whole,)), (two, (whole[:middle], whole[middle:]))):
                    begin = time.perf_counter()
                    list(threads.map(run, parts))
                    took.append(1e3 * (time.perf_counter() - begin))
            alone, both = statistics.median(one), statistics.median(two)
            print(f"{name:14}{alone:11.1f}{both:11.1f}{alone / both:11.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, nargs="+", default=[1.0, 10.0, 60.0])
    parser.add_argument("--repeats", type=int, default=3, help="of what is shorter than an hour")
    parser.add_argument("--keep", type=Path, help="folder of the simulated logs; they are made once")
    parser.add_argument("--measure", type=Path, metavar="LOG", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure:
        print(msgspec.json.encode(measure(arguments.measure)).decode())
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        found: dict[str, Measured] = {}
        for name, path in logs_in(folder, arguments.minutes).items():
            found[name] = in_a_process(path, 1 if path.stat().st_size > 20e6 else arguments.repeats)
        print(f"load: {os.getloadavg()[0]:.1f} on {os.cpu_count()} CPUs; imported: {found['demo'].imported_mb:.0f} MB")
        print_tables(found)
        print_threads()


if __name__ == "__main__":
    main()
