"""Where the recordings are that tests read: the project's own, and what lies beside the project."""

from __future__ import annotations

import atexit
import functools
import lzma
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent
BUNDLED = ROOT / "tlogs"
SHARED = ROOT.parent / "shared" / "tlogs"

_PACKED = Path(__file__).with_name("data")
_WITHOUT = "no ../shared: more recordings, which only widen what is tested"
_ALL = os.environ.get("RECORDINGS") == "all"
_PLAIN = (".tlog", ".bin", ".ulg")
_SMALL, _BEGINNING = 1_500_000, 400_000  # bytes
_LARGE = "recordings of ../shared above 1.5 MB: RECORDINGS=all reads them too"
_ALIKE = "recordings like others that are read: RECORDINGS=all reads them too"


@functools.cache
def recording(name: str) -> Path:
    """A recording by its name in ../shared/tlogs: the project's own copy or cut of it, or else the whole.

    Without either the test is skipped.
    """
    packed = _PACKED / f"{name.replace('/', '__')}.xz"
    if not packed.exists():
        return whole(name)
    return _unpack(packed, name)


def _unpack(packed: Path, name: str) -> Path:
    path = _unpacked() / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(lzma.decompress(packed.read_bytes()))
    return path


def whole(name: str) -> Path:
    """A recording uncut: the project's own copy, or that in ../shared/tlogs. Without, the test is skipped."""
    copy = BUNDLED / Path(name).name
    return copy if name.startswith("sitl/") and copy.exists() else shared(name)


def shared(name: str) -> Path:
    """A recording that is not part of the project. Without it the test is skipped."""
    path = SHARED / name
    if path.exists():
        return path
    packed = SHARED / f"{name}.xz"
    if not packed.exists():
        pytest.skip(_WITHOUT)
    return _unpack(packed, name)


def all_shared(*endings: str) -> list[Any]:
    """Every recording beside the project as a parameter, or those with such endings; without any, one that is skipped.

    What lies there may be any amount: the large ones are skipped too, but where the environment says RECORDINGS=all.
    """
    found = sorted(p for p in SHARED.rglob("*") if p.name.lower().endswith(endings or _PLAIN))
    most = float("inf") if _ALL else _SMALL
    marks = [[] if p.stat().st_size <= most else [pytest.mark.skip(_LARGE)] for p in found]
    return [pytest.param(p, id=p.name, marks=m) for p, m in zip(found, marks, strict=True)] or [
        pytest.param(SHARED, marks=pytest.mark.skip(_WITHOUT))
    ]


def beginning(path: Path, folder: Path) -> Path:
    """The first 400 kB of a telemetry log, at 4 Hz a quarter of an hour; the whole of others, or if RECORDINGS=all."""
    if _ALL or path.suffix != ".tlog" or path.stat().st_size <= _BEGINNING:
        return path
    start = folder / path.name
    with path.open("rb") as file:
        start.write_bytes(file.read(_BEGINNING))
    return start


def alike(*names: str) -> list[Any]:
    """Recordings as parameters, of kinds that others are read of too: skipped unless RECORDINGS=all."""
    return [pytest.param(name, marks=[] if _ALL else [pytest.mark.skip(_ALIKE)]) for name in names]


@functools.cache
def _unpacked() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="companion-recordings-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
