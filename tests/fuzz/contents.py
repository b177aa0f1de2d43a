"""Logs that are valid and say what no vehicle would: one message or one field of a recording is bent, or is missing.

A recording is read into rows per message, which are changed and written out again, with right checksums.
"""

from __future__ import annotations

import lzma
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.logs import read_dataflash, read_tlog, read_ulog
from companion.telemetry.dataflash.flight import RECORDS
from tests.recordings import BUNDLED, ROOT
from tests.tlogs import packed
from tests.ulogs import ulog

Random = np.random.Generator
Rows = npt.NDArray[np.void]
Index = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Contents:
    """The rows of every message, and from which row of the recording each is."""

    rows: Mapping[str, Rows]
    origin: Mapping[str, Index]
    write: Callable[[Mapping[str, Rows], Mapping[str, Index]], bytes]

    def bent(self, random: Random) -> bytes:
        """The log after one to three mutations."""
        rows, origin = dict(self.rows), dict(self.origin)
        for _ in range(int(random.integers(1, 4))):
            name = str(random.choice(sorted(rows)))
            mutate = MUTATIONS[int(random.integers(len(MUTATIONS)))]
            if len(rows[name]) and (kept := mutate(rows[name], random)) is not None:
                rows[name], origin[name] = kept[0], origin[name][kept[1]]
        return self.write(rows, origin)


def _fields(rows: Rows, random: Random) -> list[str]:
    """One field, or all of them: numbers alone, and now and then without the first, which is a time."""
    names = [name for name in rows.dtype.names or () if rows[name].dtype.kind in "iufb"]
    if len(names) > 1 and random.integers(2):
        names = names[1:]
    return names if random.integers(4) == 0 else [str(random.choice(names))] if names else []


def _since(rows: Rows, random: Random) -> slice:
    """From somewhere to somewhere, or all."""
    begin, end = sorted(random.integers(0, len(rows) + 1, 2).tolist())
    return slice(None) if random.integers(2) else slice(begin, end)


Mutated = tuple[Rows, Any]
"""The rows, and which of those before they are."""


def drop(rows: Rows, random: Random) -> Mutated:
    """Left out from somewhere to somewhere, or all but one or two."""
    kept = np.ones(len(rows), np.bool_)
    kept[_since(rows, random)] = False
    kept[: int(random.integers(4))] = True
    return rows[kept], kept


def thin(rows: Rows, random: Random) -> Mutated:
    """Every so manyth alone."""
    kept = slice(int(random.integers(3)), None, int(random.choice([2, 5, 20, 100])))
    return rows[kept], kept


def _changed(rows: Rows, random: Random, change: Callable[[npt.NDArray[Any]], npt.NDArray[Any]]) -> Mutated:
    """The rows with some fields changed for some time, as far as their types go."""
    out, part = rows.copy(), _since(rows, random)
    for field in _fields(rows, random):
        values = out[field][part]
        if not values.size:
            continue
        with np.errstate(all="ignore"):
            new = change(values)
            if values.dtype.kind in "iu":
                limits = np.iinfo(values.dtype)
                new = np.clip(np.nan_to_num(new), limits.min, limits.max)
            out[field][part] = new.astype(values.dtype)
    return out, slice(None)


def freeze(rows: Rows, random: Random) -> Mutated:
    return _changed(rows, random, lambda values: np.broadcast_to(values[:1], values.shape))


def zero(rows: Rows, random: Random) -> Mutated:
    return _changed(rows, random, np.zeros_like)


def negate(rows: Rows, random: Random) -> Mutated:
    return _changed(rows, random, lambda values: -values.astype(np.float64))


def maximise(rows: Rows, random: Random) -> Mutated:
    most = float(random.choice([1e3, 1e9, 1e30, np.inf, -1e30, np.nan]))
    return _changed(rows, random, lambda values: np.full(values.shape, most))


def shift(rows: Rows, random: Random) -> Mutated:
    """By some of what the field goes through, or of what it is."""
    by = float(random.choice([-100.0, -1.0, 0.5, 2.0, 1000.0]))
    return _changed(rows, random, lambda values: values + by * max(float(np.ptp(values.astype(float))), 1e-3))


def swap(rows: Rows, random: Random) -> Mutated:
    """Two fields exchanged, or the order of the rows."""
    names = _fields(rows, random)
    if not names or random.integers(3) == 0:
        return rows[::-1].copy(), slice(None)
    alike = [name for name in rows.dtype.names or () if rows.dtype[name] == rows.dtype[names[0]]]
    out, other = rows.copy(), str(random.choice(alike))
    out[names[0]], out[other] = rows[other], rows[names[0]]
    return out, slice(None)


MUTATIONS: tuple[Callable[[Rows, Random], Mutated], ...] = (drop, thin, freeze, zero, negate, maximise, swap, shift)


_DATAFLASH = ROOT / "tests" / "data" / "copter-takeoff.bin.xz"
_ULOG = ROOT / "tests" / "telemetry" / "logs" / "px4_two_imus.ulg.xz"
_DECLARATIONS = {"FMT", "FMTU", "UNIT", "MULT"}
_WINDOW_S = (70.0, 90.0)  # of the tlog, boot clock: from before it takes off
_SELDOM = ("PARAM_VALUE", "STATUSTEXT")


@cache
def of_tlog() -> Contents:
    """Twenty seconds of a telemetry log, from before it takes off."""
    read = read_tlog(BUNDLED / "copter-demo-100hz.tlog").messages
    boot = read["ATTITUDE"].log_time[0] - read["ATTITUDE"]["time_boot_ms"][0] * 1e-3
    begin, end = (boot + t for t in _WINDOW_S)
    messages = {
        name: one if name in _SELDOM else one.select((one.log_time >= begin) & (one.log_time < end))
        for name, one in read.items()
    }

    def write(rows: Mapping[str, Rows], origin: Mapping[str, Index]) -> bytes:
        kept = [replace(messages[name].select(origin[name]), rows=rows[name]) for name in rows if len(rows[name])]
        return packed(kept)

    return _contents({name: one.rows for name, one in messages.items() if len(one)}, write)


@cache
def of_dataflash(folder: Path) -> Contents:
    """Eight seconds of an ArduPilot log, with its take-off: what is read of it, and what that means."""
    read = read_dataflash(_unpacked(_DATAFLASH, folder)).messages
    records = {name: one for name, one in read.items() if name in RECORDS | _DECLARATIONS}

    def write(rows: Mapping[str, Rows], origin: Mapping[str, Index]) -> bytes:
        parts = []
        for name, one in records.items():
            head = bytes([0xA3, 0x95, one.layout.type])
            offsets = one.offset[origin[name]].tolist()
            parts += [(at, head + row.tobytes()) for at, row in zip(offsets, rows[name], strict=True)]
        return b"".join(record for _, record in sorted(parts))

    return _contents({name: one.rows for name, one in records.items()}, write)


@cache
def of_ulog(folder: Path) -> Contents:
    """Fifty seconds of a PX4 log with two IMUs, but for topics within topics."""
    log = read_ulog(_unpacked(_ULOG, folder))
    flat = (one for one in log.topics if not any(kind.base.names for kind, *_ in (one.declared.fields or {}).values()))
    topics = {f"{one.name}:{one.instance}": one.rows for one in flat}

    def write(rows: Mapping[str, Rows], origin: Mapping[str, Index]) -> bytes:
        del origin
        fields = {
            name: {field: np.ascontiguousarray(one[field]) for field in one.dtype.names or ()}
            for name, one in rows.items()
            if len(one)
        }
        return ulog(fields, {name: x for name, x in log.parameters.items() if isinstance(x, int | float)})

    return _contents(topics, write)


def _contents(rows: Mapping[str, Rows], write: Callable[[Mapping[str, Rows], Mapping[str, Index]], bytes]) -> Contents:
    return Contents(rows, {name: np.arange(len(one)) for name, one in rows.items()}, write)


def _unpacked(path: Path, folder: Path) -> Path:
    """A packed recording, unpacked into a folder."""
    out = folder / path.stem
    out.write_bytes(lzma.decompress(path.read_bytes()))
    return out
