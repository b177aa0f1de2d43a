"""From a file to its flights: the one way in for logs, whatever their format."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from companion.mavlink import DEFAULT_DIALECT, Contents, Log, load_dialect, log_format, read_dataflash, read_tlog
from companion.telemetry import NEEDED, Bystander, dataflash_flight, flights, ulog_flight
from companion.tracks import Flight


@dataclass(frozen=True, slots=True)
class Source:
    """What was read, and what of it could not be."""

    path: Path
    format: str  # "tlog", "raw" (MAVLink without stamps), "dataflash" or "ulog"
    size_bytes: int  # of the file
    frames: int  # MAVLink frames with a right checksum, or messages of an on-board log
    content_bytes: int = 0  # of what is in it, which is more where it is compressed
    trouble: str = ""  # why the rest of it could not be decompressed
    bad_crc_frames: int = 0
    skipped_bytes: int = 0  # that belong to no frame
    unknown_frames: Mapping[int, int] = field(default_factory=dict)  # message id that the dialect lacks → count
    speakers: Mapping[str, Mapping[str, int]] = field(default_factory=dict)  # SYSID:COMPID → message → count


@dataclass(frozen=True, slots=True)
class Recording:
    """A log and the flights found in it."""

    source: Source
    flights: tuple[Flight, ...]
    bystanders: tuple[Bystander, ...] = ()  # who speaks in it and is no vehicle


def read_recording(
    path: str | Path,
    *,
    dialect: str = DEFAULT_DIALECT,
    dequantise: bool = False,
    every_message: bool = False,
    progress: Callable[[int], None] | None = None,
) -> Recording:
    """The flights of a .tlog, an ArduPilot .bin or a PX4 .ulg: one per vehicle and boot, in SI units, FRD and NED.

    The format is told by the file's first bytes, compressed (.gz, .zst) or not. A damaged log is read as far as
    possible; `Recording.source` has the counts. dequantise: see `config/default.toml`. every_message: read
    the fields of messages too that no track is made of, so that `Flight.messages` knows their rates by the vehicle's
    own clock. progress: told the bytes of each piece of a .tlog that was read.

    Raises InputError when there is no such file or nothing in it that can be read, SettingsError for an unknown
    dialect.
    """
    path = Path(path)
    names = load_dialect(dialect)
    kind = log_format(path)
    if kind == "ulog":
        types = {v: n.removeprefix("MAV_TYPE_") for v, n in names.enum_names("MAV_TYPE").items()}
        file = Contents(path)
        px4 = ulog_flight(path, file.read(), types)
        count = sum(stats.count for stats in px4.messages.values())
        read = Source(path, kind, file.size_bytes, count, file.content_bytes, file.trouble)
        return Recording(read, (px4,))
    if kind == "dataflash":
        board = read_dataflash(path)
        flight = dataflash_flight(board, names)
        read = Source(
            path, kind, board.size_bytes, board.frames, board.content_bytes, board.trouble,
            skipped_bytes=board.skipped_bytes,
        )  # fmt: skip
        return Recording(read, (flight,) if flight else ())
    log = read_tlog(path, dialect=dialect, names=None if every_message else NEEDED, progress=progress)
    source, taken = _source(log), dict(log.messages)
    del log  # `flights` lets go of what it has read
    found, others = flights(taken, names, dequantise=dequantise)
    return Recording(source, tuple(found), tuple(others))


def open_log(path: str | Path, *, dialect: str = DEFAULT_DIALECT, dequantise: bool = False) -> list[Flight]:
    """The flights of a log, as `read_recording` gives them: an empty list when no vehicle speaks in it."""
    return list(read_recording(path, dialect=dialect, dequantise=dequantise).flights)


def _source(log: Log) -> Source:
    speakers: dict[str, dict[str, int]] = {}
    for name, messages in log.messages.items():
        counts = np.bincount(messages.sysid.astype(np.uint16) << 8 | messages.compid)
        for who in np.flatnonzero(counts).tolist():
            speakers.setdefault(f"{who >> 8}:{who & 255}", {})[name] = int(counts[who])
    return Source(
        path=log.path,
        format=log.kind,
        size_bytes=log.size_bytes,
        frames=log.frames,
        content_bytes=log.content_bytes,
        trouble=log.trouble,
        bad_crc_frames=log.bad_crc_frames,
        skipped_bytes=log.skipped_bytes,
        unknown_frames=log.unknown_frames,
        speakers=speakers,
    )
