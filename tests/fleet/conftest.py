"""A folder of logs, and a cluster of its own beside the test process."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.recordings import BUNDLED
from tests.tlogs import Writer
from tests.waiting import LIMIT_S, wait_for

DASK = str(Path(sys.executable).with_name("dask"))

# Dask looks at itself a hundred times a second, which on a busy machine is most of what an idle cluster does.
_QUIET = {
    "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False",
    "DASK_DISTRIBUTED__ADMIN__TICK__INTERVAL": "1s",
    "DASK_DISTRIBUTED__ADMIN__SYSTEM_MONITOR__INTERVAL": "10s",
}
if sys.platform == "linux":  # as `companion fleet` starts its own workers
    _QUIET["DASK_DISTRIBUTED__WORKER__MULTIPROCESSING_METHOD"] = "forkserver"
# A worker that a log called deadly.tlog kills, as one does that needs more memory than there is.
_DEADLY = """
import os, signal
import companion.fleet.task as task
read = getattr(task.read_recording, "original", task.read_recording)
def read_recording(path, **how):
    if "deadly" in str(path):
        os.kill(os.getpid(), signal.SIGKILL)
    return read(path, **how)
read_recording.original = read
task.read_recording = read_recording
"""


def copies(folder: Path, count: int, name: str = "copter-mission-default-rates") -> list[Path]:
    """Copies of a bundled flight, each with one byte changed, so that each has a content of its own."""
    folder.mkdir(parents=True, exist_ok=True)
    content = bytearray((BUNDLED / f"{name}.tlog").read_bytes())
    paths = [folder / f"flight{i:03}.tlog" for i in range(count)]
    for i, path in enumerate(paths):
        content[len(content) // 2 + 7 * i] ^= 0x55
        path.write_bytes(content)
    return paths


def table(folder: Path, name: str = "flights") -> list[dict[str, Any]]:
    """The rows of a table."""
    import pyarrow.parquet as pq  # noqa: PLC0415

    rows: list[dict[str, Any]] = pq.read_table(folder / f"{name}.parquet").to_pylist()
    return rows


@pytest.fixture(scope="session", autouse=True)
def _quiet() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for name, value in _QUIET.items():
            patch.setenv(name, value)
        yield


@pytest.fixture(scope="session")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six good flights in five logs, and two logs without any."""
    folder = tmp_path_factory.mktemp("logs")
    copies(folder, 3)
    (folder / "demo.tlog").write_bytes((BUNDLED / "copter-demo-100hz.tlog").read_bytes())
    writer = Writer(folder / "two boots.tlog")
    writer.rest(20.0, boot=300.0)
    writer.rest(20.0, begin=60.0, boot=2.0)
    writer.close()
    (folder / "empty.tlog").write_bytes(b"")
    (folder / "garbage.tlog").write_bytes(b"no telemetry in here\n" * 100)
    return folder


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a scheduler with two workers, as docs/fleet.md starts them.

    Idle it still takes a tenth of a core, so it ends with its module, and by itself where the tests were killed.
    """
    folder = tmp_path_factory.mktemp("cluster")
    (folder / "deadly.py").write_text(_DEADLY)
    environment = os.environ | {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0"}
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": environment, "cwd": folder}
    file = folder / "scheduler.json"
    started: list[subprocess.Popen[bytes]] = []
    try:
        options = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
        options += ["--idle-timeout", "900 s"]
        started.append(subprocess.Popen([DASK, "scheduler", *options], **silent))  # type: ignore[call-overload]

        def begun() -> bool:
            assert started[0].poll() is None, "the scheduler has ended"
            return file.exists() and bool(file.read_text())

        wait_for(begun, "the scheduler starts")
        address: str = json.loads(file.read_text())["address"]
        workers = ["--nworkers", "2", "--nthreads", "1", "--host", "127.0.0.1", "--no-dashboard"]
        started.append(
            subprocess.Popen([DASK, "worker", address, *workers, "--preload", "deadly.py"], **silent)  # type: ignore[call-overload]
        )
        yield with_workers(address)
    finally:
        for process in reversed(started):
            process.terminate()
            try:
                process.wait(timeout=LIMIT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@pytest.fixture
def scheduler(cluster: str) -> str:
    """Its address, once both workers are there: one that a log has killed takes a while to come again."""
    return with_workers(cluster)


def with_workers(address: str) -> str:
    from distributed import Client  # noqa: PLC0415

    with Client(address, timeout=LIMIT_S, set_as_default=False) as client:  # type: ignore[no-untyped-call]
        client.wait_for_workers(2, timeout=LIMIT_S)
    return address
