"""`companion fleet` on 200 logs: one worker against two, a killed worker, memory of a worker, a second run.

    python benchmarks/fleet.py [LOGS]

The ratio of one to two workers holds on a machine with two free processors or more: the load beforehand is printed.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil
import pyarrow.parquet as pq

ROOT = Path(__file__).resolve().parent.parent


def make_logs(folder: Path, count: int) -> None:
    """Copies of the bundled flights, each with bytes of its own changed."""
    contents = [bytearray(path.read_bytes()) for path in sorted((ROOT / "tlogs").glob("*.tlog"))]
    chance = random.Random(1)
    folder.mkdir()
    for i in range(count):
        content = contents[i % len(contents)]
        for _ in range(3):
            content[chance.randrange(len(content) // 2, len(content))] ^= 0x55
        (folder / f"flight{i:04}.tlog").write_bytes(content)


def fleet(logs: Path, out: Path, workers: int, *, kill: bool = False) -> tuple[float, int]:
    """Seconds of a whole run, and the most memory that one of its workers had, bytes."""
    began = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "companion", "fleet", str(logs), "-o", str(out), "--workers", str(workers)],
        stdout=subprocess.PIPE,
        text=True,
    )
    most = 0
    journal = out / "fleet.jsonl"
    while process.poll() is None:
        for worker in _workers(process.pid):
            try:
                most = max(most, worker.memory_info().rss)
                if kill and journal.read_bytes().count(b"\n") >= 20:
                    worker.send_signal(signal.SIGKILL)
                    kill = False
            except psutil.NoSuchProcess:
                continue
        time.sleep(0.1)
    seconds = time.perf_counter() - began
    assert process.returncode == 0, "the run has failed"
    return seconds, most


def _workers(pid: int) -> list[psutil.Process]:
    try:
        below = psutil.Process(pid).children(recursive=True)
        return [child for child in below if "spawn_main" in " ".join(child.cmdline())]
    except psutil.NoSuchProcess:
        return []


def rows(out: Path) -> str:
    """How many rows there are, and of how many logs; how many are errors."""
    table = pq.read_table(out / "flights.parquet")
    errors = table.num_rows - table["error"].null_count
    return f"{table.num_rows} rows of {len(set(table['log'].to_pylist()))} logs, {errors} errors"


def main() -> None:
    """Print the figures."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        logs = folder / "logs"
        make_logs(logs, count)
        print(
            f"{count} logs, {sum(path.stat().st_size for path in logs.iterdir()) / 1e6:.0f} MB, {os.cpu_count()} CPUs"
        )
        print(f"load before: {os.getloadavg()[0]:.2f}")
        two, memory = fleet(logs, folder / "two", 2)
        print(f"two workers: {two:.1f} s, {count / two:.1f} logs/s, {rows(folder / 'two')}")
        print(f"memory of a worker: {memory / 1e6:.0f} MB at most")
        again, _ = fleet(logs, folder / "two", 2)
        print(f"second run:  {again:.2f} s")
        one, _ = fleet(logs, folder / "one", 1)
        print(f"one worker:  {one:.1f} s, {count / one:.1f} logs/s; two are {one / two:.2f} x as fast")
        killed, _ = fleet(logs, folder / "killed", 2, kill=True)
        print(f"one of two killed on the way: {killed:.1f} s, {rows(folder / 'killed')}")
        print(f"load after: {os.getloadavg()[0]:.2f}")


if __name__ == "__main__":
    main()
