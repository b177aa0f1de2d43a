"""Read telemetry logs: MAVLink 1 and 2 frames, each after an 8-byte time stamp (or, for a recorded link, without).

Format: https://mavlink.io/en/file_formats/ ("tlog"): the stamp is big-endian µs since 1970, whose low two bits MAVProxy
replaces by the number of the link.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Self

import numpy as np

from companion.logs.logfile import (
    HEAD_BYTES,
    MOST_BYTES,
    Contents,
    LogFile,
    log_format,
    read_head,
    what_else,
)
from companion.mavlink import (
    DEFAULT_DIALECT,
    MAGIC_1,
    MAGIC_2,
    Decoder,
    Dialect,
    Frames,
    Growing,
    Messages,
    grouped,
    load_dialect,
    log_time,
)
from companion.model import InputError


class Collected:
    """The frames of a file so far. names: the message types whose rows are gathered (None: all)."""

    def __init__(self, dialect: Dialect, names: Collection[str] | None) -> None:
        self._dialect = dialect
        self._names = names
        self._types: dict[str, Growing] = {}
        self.count = 0
        self.first_log_time = self.last_log_time = math.nan  # s UNIX, of those that can be believed

    def add(self, frames: Frames, share: float) -> None:
        """Take over what `frames` holds; their bytes are not kept. share: how much of the file has been read, 0 to 1.

        0 where that is not known.
        """
        self.count += len(frames)
        times = log_time(frames.stamp)
        believable = np.isfinite(times)
        if believable.any():
            self.last_log_time = float(times[len(times) - 1 - int(np.argmax(believable[::-1]))])
            if math.isnan(self.first_log_time):
                self.first_log_time = float(times[int(np.argmax(believable))])
        for layout, index in grouped(frames, self._dialect):
            if layout.name not in self._types:
                needed = self._names is None or layout.name in self._names
                self._types[layout.name] = Growing(layout, with_rows=needed)
            self._types[layout.name].add(frames, index, times, share)

    def messages(self) -> dict[str, Messages]:
        """Everything by message name, in order of first appearance."""
        several = [one.messages() for one in self._types.values()]
        return {one.name: one for one in sorted(several, key=lambda one: int(one.offset[0]))}


_SAMPLE = 61  # every so many bytes of a chunk are looked at
_FULL = 0.125  # of the bytes are magic; in a log of the shortest frames it is a twentieth
_PIECE_BYTES = 1 << 18

_OTHER_FORMATS = {
    "dataflash": "an ArduPilot DataFlash log (.bin)",
    "dataflash text": "an ArduPilot DataFlash log in text (.log)",
    "ulog": "a PX4 ULog (.ulg)",
}


@dataclass(frozen=True, slots=True, eq=False)
class Log(LogFile):
    """A log in memory, as columns per message type."""

    bad_crc_frames: int  # known ids whose CRC is wrong: damage, or a sender with another dialect
    unknown_frames: Mapping[int, int]  # id -> frames of ids that the dialect does not have
    first_log_time: float  # s UNIX, the first and last believable stamp in file order; NaN if there is none
    last_log_time: float
    messages: Mapping[str, Messages]  # by name, in order of first appearance
    dialect: Dialect
    kind: str = "tlog"  # "tlog", or "raw" for a stream without stamps


def read_tlog(
    path: str | Path,
    *,
    dialect: str = DEFAULT_DIALECT,
    names: Collection[str] | None = None,
    progress: Callable[[int], None] | None = None,
    most_bytes: int = MOST_BYTES,
) -> Log:
    """Read a telemetry log, as far as it can be read.

    `names`: the message types whose fields are requested (None: all); of the others only the header columns are kept.
    `progress` gets the bytes of the file that each chunk took.
    A damaged log is never an error: see `Log.bad_crc_frames` and `Log.skipped_bytes`.

    Raises InputError if the file cannot be opened or has no MAVLink frame in it, SettingsError for an unknown dialect.
    """
    path = Path(path)
    spoken = load_dialect(dialect)
    head = read_head(path)
    decoder = Decoder(spoken, stamped=_is_stamped(head, spoken))
    columns = Collected(spoken, names)
    contents = Contents(path, most_bytes)
    for chunk in contents.watched(progress):
        for piece in _pieces(chunk):
            columns.add(decoder.push(piece), contents.position / contents.size_bytes)
    columns.add(decoder.finish(), 1.0)
    if columns.count == 0:
        raise InputError(_no_mavlink(path, head, dialect))
    damage = decoder.damage
    return Log(
        path=path,
        size_bytes=contents.size_bytes,
        content_bytes=contents.content_bytes,
        trouble=contents.trouble,
        frames=columns.count,
        bad_crc_frames=damage.bad_crc_frames,
        skipped_bytes=damage.skipped_bytes,
        unknown_frames=MappingProxyType(dict(damage.unknown_frames)),
        first_log_time=columns.first_log_time,
        last_log_time=columns.last_log_time,
        messages=MappingProxyType(columns.messages()),
        dialect=spoken,
        kind="tlog" if decoder.stamped else "raw",
    )


class TlogWriter:
    """Records the frames of a live link as they come, byte for byte (signatures and unknown extensions too)."""

    def __init__(self, path: str | Path) -> None:
        """path: a new file. Raises InputError if there is one, or it cannot be written."""
        try:
            self._file = Path(path).open("xb", buffering=0)  # noqa: SIM115  (closed by `close`)
        except OSError as error:
            raise InputError(f"{path} cannot be written ({error.strerror}): choose another place.") from None

    def write(self, frames: Frames, received: float) -> None:
        """Add frames that were received at `received` s UNIX, and hand them to the operating system at once."""
        stamp = round(received * 1e6).to_bytes(8, "big")
        data = b"".join(
            stamp + frames.data[start : start + size].tobytes()
            for start, size in zip(frames.start.tolist(), frames.size.tolist(), strict=True)
        )
        view = memoryview(data)
        while view:  # a disk that is nearly full takes a part
            view = view[self._file.write(view) :]

    def cut(self, size: int) -> None:
        """Take off what is behind so many bytes: the part of a frame that a full disk has taken."""
        self._file.truncate(size)

    @property
    def deleted(self) -> bool:
        """Whether the file has been removed from its folder, so that nobody can open what is written any more."""
        return os.fstat(self._file.fileno()).st_nlink == 0

    def close(self) -> None:
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _pieces(chunk: bytes) -> Iterator[bytes]:
    """The chunk, in pieces where it is full of magic bytes: what may begin a frame takes memory until that is known."""
    some = np.frombuffer(chunk, np.uint8)[::_SAMPLE]
    full = np.count_nonzero((some == MAGIC_1) | (some == MAGIC_2)) > _FULL * len(some)
    size = _PIECE_BYTES if full else len(chunk)
    for begin in range(0, len(chunk), size):
        yield chunk[begin : begin + size]


def _is_stamped(beginning: bytes, dialect: Dialect) -> bool:
    """Whether the frames of a log have time stamps before them, by the commonest distance between two of them."""
    decoder = Decoder(dialect, stamped=True)
    pieces = [decoder.push(beginning[:HEAD_BYTES]), decoder.finish()]
    begin = np.concatenate([frames.offset for frames in pieces])
    end = begin + np.concatenate([frames.size for frames in pieces])
    if len(begin) == 1:
        return bool(begin[0] > 0)
    gaps = begin[1:] - end[:-1]
    return int((gaps == 0).sum()) <= int((gaps == 8).sum())


def _no_mavlink(path: Path, head: bytes, dialect: str) -> str:
    kind = _OTHER_FORMATS.get(log_format(path))
    if kind:
        return f"{path} is {kind}, not a telemetry log: read it as one."
    if other := what_else(path, head):
        return f"{path} is not a flight log: it is {other}. Name a .tlog, .bin, .log or .ulg."
    return (
        f"{path} ({path.stat().st_size:,} bytes) holds no MAVLink frame of the dialect {dialect}; it begins with "
        f"{head[:8].hex(' ').upper()}. Check that it is a telemetry log (.tlog), or try another dialect."
    )
