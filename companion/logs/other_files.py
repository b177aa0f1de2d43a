"""What a file is that holds no flight log, by its content, so that it can be said."""

from __future__ import annotations

import re
from pathlib import Path

from companion.logs.logfile import Contents

_MAGIC = {
    b"\x89PNG\r\n\x1a\n": "a PNG picture",
    b"\xff\xd8\xff": "a JPEG picture",
    b"GIF8": "a GIF picture",
    b"%PDF-": "a PDF document",
    b"\x7fELF": "a program (ELF)",
    b"MZ": "a program for Windows",
    b"SQLite format 3\0": "an SQLite database",
    b"#ROSBAG V": "a ROS bag",
    b"\x89MCAP0\r\n": "an MCAP recording",
    b"MATLAB 5.0 MAT-file": "a MATLAB file",
    b"\x89HDF\r\n\x1a\n": "an HDF5 file",
    b"PAR1": "a Parquet table",
    b"H Product:Blackbox": "a blackbox log of Betaflight or INAV",
    b"\xd4\xc3\xb2\xa1": "a network capture (pcap)",
    b"\n\r\r\n": "a network capture (pcapng)",
    b"version https://git-lfs": "a pointer of Git LFS in place of the file itself (git lfs pull fetches it)",
}
"""First bytes → what begins so."""

_WITHIN = {  # at another place than the beginning: where, bytes
    b"ftyp": (4, "a video (MP4)"),
    b"WEBP": (8, "a WebP picture"),
    b"AVI ": (8, "a video (AVI)"),
}

_MARKUP = re.compile(rb"\s*(?:\xef\xbb\xbf)?<(?P<tag>!doctype html|html|\?xml|svg|kml|gpx)", re.IGNORECASE)
_TEXT_BYTES, _TEXT_SHOWN = 4096, 40
_FOREIGN = 0.05  # of the letters, in another encoding than UTF-8
_NO_TEXT = re.compile(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f\x7f]")  # commands to a terminal, without ESC and blanks


def what_else(path: Path, head: bytes) -> str:
    """What a file is: "a PNG picture", "blank, nothing but zeros"; "" where that is unknown.

    head: its first bytes, decompressed.
    """
    if kind := next((kind for magic, kind in _MAGIC.items() if head.startswith(magic)), ""):
        return kind
    if kind := next((kind for magic, (at, kind) in _WITHIN.items() if head.startswith(magic, at)), ""):
        return kind
    if head.strip(head[:1]) == b"" and _is_blank(path, head[:1]):
        filling = "zeros" if head[:1] == b"\0" else f"bytes of {head[:1].hex().upper()}"
        return f"blank, nothing but {filling}"
    return _text(head[:_TEXT_BYTES])


def _is_blank(path: Path, filling: bytes) -> bool:
    return all(chunk.strip(filling) == b"" for chunk in Contents(path).chunks())


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
