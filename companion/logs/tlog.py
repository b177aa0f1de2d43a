"""Read telemetry logs: MAVLink 1 and 2 frames, each after an 8-byte time stamp (or, for a recorded link, without).

Format: https://mavlink.io/en/file_formats/ ("tlog"): the stamp is big-endian µs since 1970, whose low two bits MAVProxy
replaces by the number of the link.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from companion.logs.logfile import HEAD_BYTES, MOST_BYTES, TEXT_BYTES, Contents, LogFile, log_format, read_head
from companion.mavlink import DEFAULT_DIALECT, MAGIC_1, MAGIC_2, Collected, Decoder, Dialect, Messages, load_dialect
from companion.model import InputError

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
    collected = Collected(spoken, names)
    contents = Contents(path, most_bytes)
    count = 0
    for frames in decoder.decode(piece for chunk in contents.watched(progress) for piece in _pieces(chunk)):
        count += len(frames)
        collected.add(frames, contents.position / contents.size_bytes)
    if count == 0:
        raise InputError(_no_mavlink(path, head, dialect))
    damage = decoder.damage
    return Log(
        **contents.facts,
        frames=count,
        bad_crc_frames=damage.bad_crc_frames,
        skipped_bytes=damage.skipped_bytes,
        unknown_frames=MappingProxyType(dict(damage.unknown_frames)),
        messages=MappingProxyType(dict(sorted(collected.messages().items(), key=lambda one: int(one[1].offset[0])))),
        dialect=spoken,
        kind="tlog" if decoder.stamped else "raw",
    )


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
    pieces = list(decoder.decode([beginning[:HEAD_BYTES]]))
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
    if other := _what_else(path, head):
        return f"{path} is not a flight log: it is {other}. Name a .tlog, .bin, .log or .ulg."
    return (
        f"{path} ({path.stat().st_size:,} bytes) holds no MAVLink frame of the dialect {dialect}; it begins with "
        f"{head[:8].hex(' ').upper()}. Check that it is a telemetry log (.tlog), or try another dialect."
    )


_OTHER_MAGIC = (
    (0, b"\x89PNG\r\n\x1a\n", "a PNG picture"),
    (0, b"\xff\xd8\xff", "a JPEG picture"),
    (0, b"GIF8", "a GIF picture"),
    (0, b"%PDF-", "a PDF document"),
    (0, b"\x7fELF", "a program (ELF)"),
    (0, b"MZ", "a program for Windows"),
    (0, b"SQLite format 3\0", "an SQLite database"),
    (0, b"#ROSBAG V", "a ROS bag"),
    (0, b"\x89MCAP0\r\n", "an MCAP recording"),
    (0, b"MATLAB 5.0 MAT-file", "a MATLAB file"),
    (0, b"\x89HDF\r\n\x1a\n", "an HDF5 file"),
    (0, b"PAR1", "a Parquet table"),
    (0, b"H Product:Blackbox", "a blackbox log of Betaflight or INAV"),
    (0, b"\xd4\xc3\xb2\xa1", "a network capture (pcap)"),
    (0, b"\n\r\r\n", "a network capture (pcapng)"),
    (0, b"version https://git-lfs", "a pointer of Git LFS in place of the file itself (git lfs pull fetches it)"),
    (4, b"ftyp", "a video (MP4)"),
    (8, b"WEBP", "a WebP picture"),
    (8, b"AVI ", "a video (AVI)"),
)
"""Where in a file, which bytes → what it is."""

_MARKUP = re.compile(rb"\s*(?:\xef\xbb\xbf)?<(?P<tag>!doctype html|html|\?xml|svg|kml|gpx)", re.IGNORECASE)
_TEXT_SHOWN = 40
_FOREIGN = 0.05  # of the letters, in another encoding than UTF-8
_NO_TEXT = re.compile(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f\x7f]")  # commands to a terminal, without ESC and blanks


def _what_else(path: Path, head: bytes) -> str:
    """What a file is: "a PNG picture", "blank, nothing but zeros"; "" where that is unknown.

    head: its first bytes, decompressed.
    """
    if kind := next((kind for at, magic, kind in _OTHER_MAGIC if head.startswith(magic, at)), ""):
        return kind
    if head.strip(head[:1]) == b"" and all(chunk.strip(head[:1]) == b"" for chunk in Contents(path).chunks()):
        filling = "zeros" if head[:1] == b"\0" else f"bytes of {head[:1].hex().upper()}"
        return f"blank, nothing but {filling}"
    return _text(head[:TEXT_BYTES])


def _text(head: bytes) -> str:
    if _NO_TEXT.search(head):
        return ""
    if markup := _MARKUP.match(head):
        tag = markup["tag"].decode("ascii").lower()
        return "a web page (HTML)" if "html" in tag else "an XML document"
    text = head.decode("utf-8", "replace")
    if text.count("\N{REPLACEMENT CHARACTER}") > _FOREIGN * len(text):
        return ""
    line = next((line.strip() for line in text.splitlines() if line.strip()), "")
    shown = "".join(letter for letter in line if letter.isprintable())[:_TEXT_SHOWN]
    return f'text that begins with "{shown}"' if shown else "blank, nothing but white space"
