"""What a format of `companion export` is. Each stands with its writer: `FORMATS` of the package finds them there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec

from companion.analysis import Assessment, Replay
from companion.export.table import Table
from companion.model import Flight


@dataclass(frozen=True, slots=True)
class Contents:
    """What there is to be written of a flight."""

    flight: Flight
    assessment: Assessment
    shown: Replay
    tables: Mapping[str, Table]
    document: Callable[[], msgspec.Struct]  # that of `companion analyze --json`, made when it is asked for


@dataclass(frozen=True, slots=True)
class Format:
    """One format. `bare` writes the tables of a log that cannot be examined; None where that would be nothing."""

    name: str
    what: str
    write: Callable[[Path, Contents], list[Path]]
    bare: Callable[[Path, Mapping[str, Table]], list[Path]] | None = None
    is_folder: bool = False
