"""The border of the program: what nobody foresaw becomes one sentence, a report to send in, and an exit code."""

from __future__ import annotations

import contextlib
import platform
import sys
import tempfile
import traceback
from collections.abc import Sequence
from pathlib import Path

EXIT_CODE = 70  # EX_SOFTWARE of sysexits.h


def report(error: BaseException, arguments: Sequence[str]) -> int:
    """Write the report and print its path. Returns the exit code."""
    what = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    if isinstance(error, MemoryError):
        what = f"there is not enough memory ({what})"
    try:
        path = _write(error, arguments)
    except Exception:  # noqa: BLE001  (there is nobody behind this border)
        path = None
    where = f"Send in {path} and, if you may, the log" if path else "The report of it cannot be written"
    with contextlib.suppress(OSError, ValueError, AttributeError):  # stderr is closed
        print(f"companion: internal error (a bug in companion): {what}. {where}.", file=sys.stderr, flush=True)
    return EXIT_CODE


def own_version() -> str:
    """As it was installed; "unknown" where the package's own description is gone."""
    from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415  (it takes a moment to load)

    try:
        return version("mavlink-companion")
    except PackageNotFoundError:
        return "unknown"


def _write(error: BaseException, arguments: Sequence[str]) -> Path | None:
    """The report, in a new file of the folder for temporary ones that only its owner can read."""
    trace = "".join(traceback.format_exception(error))
    about = f"companion {own_version()}, Python {platform.python_version()}, {platform.platform()}"
    text = f"{about}\ncommand: {' '.join(map(repr, arguments))}\n\n{trace}"
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="companion-report-", suffix=".txt", delete=False, encoding="utf-8", errors="replace"
        ) as file:
            file.write(text)
    except OSError:
        return None
    return Path(file.name)
