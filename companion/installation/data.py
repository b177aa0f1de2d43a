"""Settings and bundled flights: inside an installed package, or at the top of a checkout."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Literal

from companion.model import InputError

DEMO = "demo"
"""The name of the bundled flight, in place of a path."""


def data_folder(name: Literal["config", "tlogs"]) -> Path:
    """The folder of settings or bundled flights. Raises InputError when the installation has neither."""
    package = Path(str(files("companion")))
    for folder in (package / "data" / name, package.parent / name):
        if folder.is_dir():
            return folder
    raise InputError(f"this installation has no {name}/ folder. Install companion again, or run it from a checkout.")


def log_path(name: str | Path) -> Path:
    """The path of a log: `demo` is the bundled flight, unless there is a file of that name."""
    if str(name) == DEMO and not Path(name).exists():
        return data_folder("tlogs") / "copter-demo-100hz.tlog"
    return Path(name)
