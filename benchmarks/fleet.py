"""`companion fleet` on many logs: two workers against one, memory of a worker as the run goes on, a run taken up again.

    python benchmarks/fleet.py [LOGS] [--small] [--brief]

--small: of the smallest bundled flight alone; --brief: two workers alone, as for a thousand logs. The ratio of one to
two workers holds on a machine with two free processors or more: the load beforehand is printed.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import psutil
import pyarrow.parquet as pq

ROOT = Path(__file__).resolve().parent.parent


def make_logs(folder: Path, count: int, *, small: bool) -> None:
    """Copies of the bundled flights, each with bytes of its own changed."""
    flights = sorted((ROOT / "tlogs").glob("*.tlog"), key=lambda path: path.stat().st_size)
    contents = [bytearray(path.read_bytes()) for path in flights[: 1 if small else None]]
    chance = random.Random(1)
    folder.mkdir()
    for i in range(count):
        content = contents[i % len(contents)]
        for _ in range(3):
            content[chance.randrange(len(content) // 2, len(content))] ^= 0x55
        (folder / f"flight{i:04}.tlog").write_bytes(content)


@dataclass(frozen=True)
class Run:
    """A whole run, or one that was ended on the way."""

    seconds: float
    peaks_mb: list[float]  # the most that a worker had, in each quarter of the logs


def fleet(logs: Path, out: Path, workers: int, *, kill_one_at: int = 0, end_at: int = 0) -> Run:
    """kill_one_at, end_at: logs after which a worker is killed, or the whole is interrupted as by Ctrl-C."""
    began, count = time.perf_counter(), sum(1 for _ in logs.iterdir())
    process = subprocess.Popen(
        [sys.executable, "-m", "companion", "fleet", str(logs), "-o", str(out), "--workers", str(workers)],
        stdout=subprocess.PIPE,
        text=True,
    )
    peaks, journal = [0.0] * 4, out / "fleet.jsonl"
    while process.poll() is None:
        done = journal.read_bytes().count(b"\n") if journal.exists() else 0
        if end_at and done >= end_at:
            process.send_signal(signal.SIGINT)
            end_at = 0
        for worker in _workers(process.pid):
            try:
                quarter = min(4 * done // count, 3)
                peaks[quarter] = max(peaks[quarter], worker.memory_info().rss / 1e6)
                if kill_one_at and done >= kill_one_at:
                    worker.send_signal(signal.SIGKILL)
                    kill_one_at = 0
            except psutil.NoSuchProcess:
                continue
        time.sleep(0.1)
    assert process.returncode in (0, 130), "the run has failed"
    return Run(time.perf_counter() - began, peaks)


def _workers(pid: int) -> list[psutil.Process]:
    """Processes that the fork server has made."""
    try:
        return [worker for child in psutil.Process(pid).children() for worker in child.children()]
    except psutil.NoSuchProcess:
        return []


def rows(out: Path) -> str:
    """How many rows there are, and of how many logs; how many are errors."""
    table = pq.read_table(out / "flights.parquet")
    errors = table.num_rows - table["error"].null_count
    return f"{table.num_rows} rows of {len(set(table['log'].to_pylist()))} logs, {errors} errors"


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("logs", type=int, nargs="?", default=24)
    parser.add_argument("--small", action="store_true")
    parser.add_argument("--brief", action="store_true")
    arguments = parser.parse_args()
    count = arguments.logs
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        logs = folder / "logs"
        make_logs(logs, count, small=arguments.small)
        megabytes = sum(path.stat().st_size for path in logs.iterdir()) / 1e6
        print(f"{count} logs, {megabytes:.0f} MB, {os.cpu_count()} CPUs; load before: {os.getloadavg()[0]:.2f}")
        two = fleet(logs, folder / "two", 2)
        print(f"two workers: {two.seconds:.1f} s, {count / two.seconds:.2f} logs/s, {rows(folder / 'two')}")
        peaks = ", ".join(f"{peak:.0f}" for peak in two.peaks_mb)
        print(f"memory of a worker, at most in each quarter of the run: {peaks} MB")
        print(f"second run:  {fleet(logs, folder / 'two', 2).seconds:.2f} s")
        if not arguments.brief:
            one = fleet(logs, folder / "one", 1)
            print(f"one worker:  {one.seconds:.1f} s; two are {one.seconds / two.seconds:.2f} x as fast")
            killed = fleet(logs, folder / "killed", 2, kill_one_at=count // 3)
            print(f"one of two killed on the way: {killed.seconds:.1f} s, {rows(folder / 'killed')}")
            first = fleet(logs, folder / "ended", 2, end_at=count // 2)
            rest = fleet(logs, folder / "ended", 2)
            again = f"{first.seconds:.1f} s and {rest.seconds:.1f} s"
            print(f"interrupted half way and taken up again: {again}, {rows(folder / 'ended')}")
        print(f"load after: {os.getloadavg()[0]:.2f}")


if __name__ == "__main__":
    main()
