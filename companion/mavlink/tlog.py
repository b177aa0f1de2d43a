"""Read telemetry logs: MAVLink 1 and 2 frames, each after an 8-byte time stamp (or, for a recorded link, without).

Format: https://mavlink.io/en/file_formats/ ("tlog"): the stamp is big-endian µs since 1970, whose low two bits MAVProxy
replaces by the number of the link.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from companion.errors import InputError
from companion.mavlink.crc import Index
from companion.mavlink.dialect import DEFAULT_DIALECT, Dialect, load_dialect
from companion.mavlink.frames import Decoder, Frames
from companion.mavlink.messages import Messages, gather_rows, log_time

CHUNK_BYTES = 4 << 20  # large enough for NumPy's overhead to vanish, small enough for the cache
_HEAD_BYTES = 1 << 18  # looked at to tell a stamped log from a bare stream

_OTHER_FORMATS = (
    (b"\xa3\x95", "an ArduPilot DataFlash log (.bin)", "read it as one"),
    (b"ULog\x01\x12\x35", "a PX4 ULog (.ulg)", "read it as one"),
)


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """A log in memory, as columns per message type."""

    path: Path
    size_bytes: int
    frames: int  # valid ones, of known ids
    bad_crc_frames: int  # known ids whose CRC is wrong: damage, or a sender with another dialect
    skipped_bytes: int  # bytes that belong to no valid frame, stamp or unknown frame
    unknown_frames: Mapping[int, int]  # id -> frames of ids that the dialect does not have
    first_log_time: float  # s UNIX, the first and last believable stamp in file order; NaN if there is none
    last_log_time: float
    messages: Mapping[str, Messages]  # by name, in order of first appearance
    dialect: Dialect
    kind: str = "tlog"  # "tlog", or "raw" for a stream without stamps


def read_tlog(path: str | Path, *, dialect: str = DEFAULT_DIALECT, names: Collection[str] | None = None) -> Log:
    """Read a telemetry log, as far as it can be read.

    `names`: the message types whose fields are wanted (None: all); of the others only the header columns are kept.
    A damaged log is never an error: see `Log.bad_crc_frames` and `Log.skipped_bytes`.

    Raises InputError if the file cannot be opened or has no MAVLink frame in it, SettingsError for an unknown dialect.
    """
    path = Path(path)
    spoken = load_dialect(dialect)
    head = _head(path)
    decoder = Decoder(spoken, stamped=_is_stamped(head, spoken))
    columns = _Columns(spoken, names)
    for chunk in _chunks(path):
        columns.add(decoder.push(chunk))
    columns.add(decoder.finish())
    if columns.count == 0:
        raise InputError(_no_mavlink(path, head, dialect))
    damage = decoder.damage
    messages, first, last = columns.messages()
    return Log(
        path=path,
        size_bytes=path.stat().st_size,
        frames=columns.count,
        bad_crc_frames=damage.bad_crc_frames,
        skipped_bytes=damage.skipped_bytes,
        unknown_frames=MappingProxyType(dict(damage.unknown_frames)),
        first_log_time=first,
        last_log_time=last,
        messages=MappingProxyType(messages),
        dialect=spoken,
        kind="tlog" if decoder.stamped else "raw",
    )


class _Columns:
    """Collects frames chunk by chunk: header columns in file order, rows per type."""

    def __init__(self, dialect: Dialect, names: Collection[str] | None) -> None:
        self._dialect = dialect
        self._names = names
        self._headers: list[tuple[npt.NDArray[np.generic], ...]] = []
        self._rows: dict[int, list[npt.NDArray[np.void]]] = {}
        self.count = 0

    def add(self, frames: Frames) -> None:
        if len(frames) == 0:
            return
        self.count += len(frames)
        self._headers.append((
            frames.id.astype(np.uint16 if len(self._dialect.crc_extra) <= 1 << 16 else np.uint32),
            frames.offset, frames.stamp, frames.sysid, frames.compid, frames.seq, frames.crc,
        ))  # fmt: skip
        for number, index in _by_id(self._headers[-1][0]):
            layout = self._dialect.by_id[number]
            pieces = self._rows.setdefault(number, [])
            if self._names is None or layout.name in self._names:
                pieces.append(gather_rows(frames, index, layout))

    def messages(self) -> tuple[dict[str, Messages], float, float]:
        """Everything by message name, and the first and last stamp. Empties the collection, to hold rows once only."""
        number, offset, stamp, sysid, compid, seq, crc = (
            np.concatenate([piece[column] for piece in self._headers]) for column in range(7)
        )
        self._headers.clear()
        times = log_time(stamp.astype(np.uint64, copy=False))
        believable = np.flatnonzero(np.isfinite(times))
        first, last = (float(times[believable[end]]) if len(believable) else float("nan") for end in (0, -1))
        found = {}
        for key, index in sorted(_by_id(number), key=lambda group: int(group[1][0])):
            layout = self._dialect.by_id[key]
            pieces = self._rows.pop(key)
            found[layout.name] = Messages(
                layout=layout,
                offset=offset[index],
                log_time=times[index],
                sysid=sysid[index],
                compid=compid[index],
                seq=seq[index],
                crc=crc[index],
                rows=np.concatenate(pieces) if pieces else np.empty(0, layout.dtype),
            )
        return found, first, last


def _by_id(number: npt.NDArray[np.generic]) -> Iterator[tuple[int, Index]]:
    """Each id with the indices where it stands, ascending."""
    order = np.argsort(number, kind="stable")
    ordered = number[order]
    edges = np.flatnonzero(ordered[1:] != ordered[:-1]) + 1
    for index in np.split(order, edges):
        yield int(number[index[0]]), index


def _chunks(path: Path) -> Iterator[bytes]:
    with path.open("rb") as file:
        while chunk := file.read(CHUNK_BYTES):
            yield chunk


def _head(path: Path) -> bytes:
    """The beginning of a file; every reason why it cannot be read becomes an InputError."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except FileNotFoundError:
        raise InputError(f"There is no file {path}: check the path.") from None
    except IsADirectoryError:
        raise InputError(f"{path} is a directory, not a log: name one of the files in it.") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): check its permissions.") from None
    if not head:
        raise InputError(f"{path} is empty (0 bytes): nothing was recorded, or the copy failed. Copy it again.")
    return head


def _is_stamped(head: bytes, dialect: Dialect) -> bool:
    """Whether the frames of a log have time stamps before them, by the commonest distance between two of them."""
    decoder = Decoder(dialect, stamped=True)
    found = [decoder.push(head), decoder.finish()]
    begin = np.concatenate([frames.offset for frames in found])
    end = begin + np.concatenate([frames.size for frames in found])
    if len(begin) == 1:
        return bool(begin[0] > 0)
    gaps = begin[1:] - end[:-1]
    return int((gaps == 0).sum()) <= int((gaps == 8).sum())


def _no_mavlink(path: Path, head: bytes, dialect: str) -> str:
    for magic, name, remedy in _OTHER_FORMATS:
        if head.startswith(magic):
            return f"{path} is {name}, not a telemetry log: {remedy}."
    return (
        f"{path} ({path.stat().st_size:,} bytes) holds no MAVLink frame of the dialect {dialect}; it begins with "
        f"{head[:8].hex(' ').upper()}. Check that it is a telemetry log (.tlog), or try another dialect."
    )
