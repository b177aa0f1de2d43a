"""A log that is piped in: `-` in place of its name. It is kept in a file while the command runs, for logs are read
more than once.
"""

from __future__ import annotations

import argparse
import contextlib
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import NoReturn

from companion.model import CompanionError, InputError, SettingsError

STDIN = "stdin"
"""What a log that is piped in is called."""

_PIECE_BYTES = 1 << 20
_ENDING = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
_EXAMPLE = "xz -dc flight.tlog.xz | companion analyze -"


@contextlib.contextmanager
def kept(arguments: argparse.Namespace, most: Callable[[argparse.Namespace], int]) -> Iterator[None]:
    """Where a command's log is `-`: stdin in a file of its user's own, which is gone when the command ends.

    The log is called STDIN from then on, and `arguments.piped` is that file. most: bytes that it may have.

    Raises InputError for a stdin that has nothing, too much or is a terminal; SettingsError where it is named twice.
    """
    named = [name for name in ("log", "b") if getattr(arguments, name, None) == "-"]
    several = [i for i, name in enumerate(getattr(arguments, "logs", ())) if name == "-"]
    if not named and not several:
        yield
        return
    if len(named) + len(several) > 1:
        raise SettingsError("- stands for the log on stdin, which is read once: name the other one by its path.")
    most_bytes = most(arguments)
    with _cleaned_up_on_signals(), tempfile.TemporaryDirectory(prefix="companion-") as folder:
        path = Path(folder) / STDIN
        _keep(path, most_bytes)
        arguments.piped = path
        for name in named:
            setattr(arguments, name, STDIN)
        for i in several:
            arguments.logs[i] = STDIN
        try:
            yield
        except CompanionError as error:  # nobody knows that file by its path, nor finds it any more
            error.args = tuple(str(part).replace(str(path), STDIN) for part in error.args)
            raise


def _keep(path: Path, most_bytes: int) -> None:
    """Copy stdin to a file."""
    if sys.stdin is None or sys.stdin.closed:
        raise InputError(f"- is the log on stdin, and stdin is closed: pipe a log in ({_EXAMPLE}), or name a file.")
    if sys.stdin.isatty():
        raise InputError(f"- is the log on stdin, and stdin is a terminal: pipe a log in ({_EXAMPLE}), or name a file.")
    size = 0
    try:
        with path.open("xb") as file:
            while piece := sys.stdin.buffer.read(_PIECE_BYTES):
                size += len(piece)
                if size > most_bytes:
                    raise InputError(
                        f"stdin has more than {most_bytes / 1e9:g} GB: take it as it is with --max-size GB, or save it "
                        "to a file, and name that."
                    )
                file.write(piece)
    except OSError as error:
        raise InputError(
            f"stdin cannot be kept in {path.parent.parent}: {error.strerror or error}. Save it to a file elsewhere, "
            "and name that."
        ) from None
    if not size:
        raise InputError("stdin is empty (0 bytes): the command before the pipe wrote nothing. See its messages.")


@contextlib.contextmanager
def _cleaned_up_on_signals() -> Iterator[None]:
    """SIGTERM and SIGHUP end the command as an error does: what is on the way out is done. One ignored stays so."""
    if threading.current_thread() is not threading.main_thread():  # which alone gets signals
        yield
        return
    before = {number: handler for number in _ENDING if (handler := signal.getsignal(number)) is signal.SIG_DFL}
    for number in before:
        signal.signal(number, _end)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _end(number: int, _frame: FrameType | None) -> NoReturn:
    raise SystemExit(128 + number)
