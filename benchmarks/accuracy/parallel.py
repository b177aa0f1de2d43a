"""A function over many items, each in a process of its own that is ended when it takes too long."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkServerProcess
from typing import Any, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Failed:
    """Why an item has no result."""

    reason: str


@dataclass(frozen=True, slots=True)
class _Running:
    index: int
    process: ForkServerProcess
    until: float


def each(
    function: Callable[[Item], Result], items: Sequence[Item], *, workers: int | None = None, timeout: float = 120.0
) -> Iterator[tuple[int, Result | Failed]]:
    """Index and result of each item, as they come. `function` and the items have to be picklable.

    workers: how many at once, by default as many as there are processors. timeout: seconds for one item.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # more are in each other's way
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["companion.app.examination", "companion.app.recording"])
    waiting = list(enumerate(items))[::-1]
    running: dict[Connection, _Running] = {}
    try:
        while waiting or running:
            while waiting and len(running) < (workers or os.cpu_count() or 1):
                index, item = waiting.pop()
                ours, theirs = context.Pipe(duplex=False)
                process = context.Process(target=_work, args=(theirs, function, item), daemon=True)
                process.start()
                theirs.close()
                running[ours] = _Running(index, process, time.monotonic() + timeout)
            first = min(one.until for one in running.values())
            for ready in wait(list(running), max(0.0, first - time.monotonic())):
                assert isinstance(ready, Connection)
                yield running[ready].index, _received(ready, running.pop(ready).process)
            for late in [key for key, one in running.items() if one.until <= time.monotonic()]:
                one = running.pop(late)
                one.process.kill()
                yield one.index, Failed(f"no result within {timeout:g} s")
    finally:
        for one in running.values():
            one.process.kill()


def _received(connection: Connection, process: ForkServerProcess) -> Any:
    try:
        result = connection.recv()
    except EOFError:
        process.join()
        return Failed(f"its process ended with exit code {process.exitcode}")
    process.join()
    return result


def _work(connection: Connection, function: Callable[[Any], Any], item: object) -> None:
    try:
        result = function(item)
    except Exception as error:  # noqa: BLE001  (the border between processes: one bad log is a row)
        result = Failed(f"{type(error).__name__}: {error}")
    connection.send(result)
