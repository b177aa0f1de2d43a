"""The command in a process of its own, as its users run it. No wait is without a limit, and none outlives its test."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from tests.waiting import LIMIT_S

COMPANION = (sys.executable, "-m", "companion")

Process = subprocess.Popen[str]


@contextlib.contextmanager
def started(*words: str | Path, **how: Any) -> Iterator[Process]:
    """A process whose output is read as text; killed at the end if it still runs."""
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(words, **pipes | how) as process:
        try:
            yield process
        finally:
            process.kill()


def next_line(process: Process, pipe: IO[str] | None) -> str:
    """The next line of its stdout or stderr. Fails when it says nothing and when it ends before."""
    assert pipe is not None
    silent = threading.Timer(LIMIT_S, process.kill)
    silent.start()
    try:
        line = pipe.readline()
    finally:
        silent.cancel()
    assert line, f"{process.args!r} has said no line within {LIMIT_S:g} s, or ended: {process.communicate()}"
    return line


def ended(process: Process, signal: int | None = None) -> tuple[str, str]:
    """What it says on stdout and stderr until it ends, by itself or of a signal."""
    if signal is not None:
        process.send_signal(signal)
    try:
        return process.communicate(timeout=LIMIT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        raise AssertionError(f"{process.args!r} does not end: {process.communicate()}") from None
