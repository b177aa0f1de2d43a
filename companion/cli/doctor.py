"""`companion doctor`: what this installation has and lacks, and the command or the step that mends it.

`companion completion SHELL`: what a shell needs to complete commands, options and files.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rich.markup import escape

from companion.cli import options, tables
from companion.cli.main import commands_of, parser
from companion.installation import EXTRAS, Library, data_folder, install_command, libraries, log_path, own_version
from companion.links import state_folder
from companion.mavlink import load_dialect
from companion.model import CompanionError

_SIGNS = {"ok": "[green]ok[/]     ", "optional": "[yellow]not here[/]", "broken": "[red]broken[/]  "}
_DRAWN = "✗ σ ² ° │ ─"
"""Characters of the tables and verdicts."""


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that was looked at."""

    state: Literal["ok", "optional", "broken"]
    what: str
    remedy: str = ""


def doctor_options(parser: options.Parser) -> None:
    """The command's options."""
    options.add(parser, *options.SOURCE)


def run_doctor(arguments: argparse.Namespace) -> int:
    """Print a line for each check. Exit code: 2 where something is broken that commands need."""
    console = tables.console()
    console.lines(
        f"companion {own_version()}, Python {platform.python_version()}, {platform.system()} "
        f"{platform.machine()}, in {escape(sys.prefix)}"
    )
    checks = list(_checks(arguments))
    for check in checks:
        console.lines(f"{_SIGNS[check.state]}  {escape(check.what)}")
        if check.remedy:
            console.lines(f"          {escape(check.remedy)}")
    return 2 if any(check.state == "broken" for check in checks) else 0


def _checks(arguments: argparse.Namespace) -> Iterator[Check]:
    yield from of_libraries(libraries())
    try:
        data_folder("config")
        log_path("demo").stat()
        load_dialect(options.settings_of(arguments).log.dialect)
    except (CompanionError, OSError) as error:
        yield Check("broken", str(error))
    else:
        yield Check("ok", "settings, IMU parts and the demo flight are there")
    yield from (_writable(folder, what) for folder, what in _FOLDERS)
    yield from _serial_ports()
    encoding = getattr(sys.stdout, "encoding", None) or "ascii"
    try:
        _DRAWN.encode(encoding)
    except UnicodeEncodeError:
        remedy = "Windows: chcp 65001, or set PYTHONUTF8=1; else: export LANG=C.UTF-8"
        yield Check("optional", f"the terminal's encoding {encoding} lacks characters of the tables", remedy)
    else:
        yield Check("ok", f"the terminal's encoding {encoding} has the characters of the tables")


def of_libraries(known: tuple[Library, ...]) -> Iterator[Check]:
    """The core's libraries in one line, and one for each extra."""
    if not known:
        yield Check("optional", "companion runs from a folder and is not installed: its libraries are not checked")
        return
    for extra in ("", *EXTRAS):
        own = [library for library in known if library.extra == extra]
        lacking = [library for library in own if not library.fits]
        name = f"{extra}: {EXTRAS[extra]}" if extra else "what every command needs"
        if not lacking:
            yield Check("ok", name)
            continue
        which = ", ".join(f"{one.name}{one.bounds} (here: {one.installed or 'none'})" for one in lacking)
        remedy = install_command(extra) if extra else "python -m pip install --upgrade mavlink-companion"
        yield Check("optional" if extra else "broken", f"{name}. Needs {which}", remedy)


_FOLDERS = (
    (state_folder(), "what is remembered of vehicles' message rates"),
    (Path(tempfile.gettempdir()), "logs from stdin, and reports of unexpected errors"),
)


def _writable(folder: Path, what: str) -> Check:
    """Whether files can be made in a folder, or in the nearest above it that is there."""
    there = next(one for one in (folder, *folder.parents) if one.exists())
    if os.access(there, os.W_OK) and there.is_dir():
        return Check("ok", f"{folder} can be written: {what}")
    return Check("broken", f"{folder} cannot be written: {what}", "give yourself the right to write there")


def _serial_ports() -> Iterator[Check]:
    """On Linux, where a user needs a group for them; elsewhere nobody is refused."""
    ports = sorted(path for kind in ("ttyACM*", "ttyUSB*", "ttyAMA*") for path in Path("/dev").glob(kind))
    closed = [str(port) for port in ports if not os.access(port, os.R_OK | os.W_OK)]
    if closed:
        remedy = 'sudo usermod -aG dialout "$USER", then log in again'
        yield Check("optional", f"no permission for {', '.join(closed)}", remedy)
    elif ports:
        yield Check("ok", f"serial ports: {', '.join(map(str, ports))}")


SHELLS = ("bash", "zsh", "tcsh")
_FILE_WORDS = ("LOG", "LOG|LINK", "FILE", "FILE.tum", "FOLDER|PARQUET", "PATH", "A", "B")
_FOLDER_WORDS = ("DIR",)


def completion_options(parser: options.Parser) -> None:
    """The command's options."""
    parser.add_argument("shell", choices=SHELLS, help="the shell to print it for")


def run_completion(arguments: argparse.Namespace) -> int:
    """Print the script."""
    import shtab  # noqa: PLC0415  (needed for this command alone)

    top = parser()
    for command in commands_of(top).values():
        for action in command._actions:
            if action.metavar in _FILE_WORDS:
                action.complete = shtab.FILE  # type: ignore[attr-defined]
            elif action.metavar in _FOLDER_WORDS:
                action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
    print(shtab.complete(top, shell=arguments.shell))
    return 0
