"""What is no flight log is called what it is, and not a log of another dialect."""

from __future__ import annotations

import gzip
import lzma
from pathlib import Path

import pytest

import companion as c

FILES = {
    "a PNG picture": b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + bytes(400),
    "a JPEG picture": b"\xff\xd8\xff\xe0\0\x10JFIF\0" + bytes(range(256)),
    "a WebP picture": b"RIFF\x10\0\0\0WEBPVP8 " + bytes(range(64)),
    "a video (MP4)": b"\0\0\0\x20ftypisom" + bytes(range(64)),
    "a PDF document": b"%PDF-1.7\n%\xe2\xe3\xcf\xd3\n",
    "a web page (HTML)": b"\n<!DOCTYPE html>\n<html><title>404</title></html>",
    "an XML document": b'<?xml version="1.0"?><kml></kml>',
    "a pointer of Git LFS": b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 9\n",
    'text that begins with "import sys"': b"\n\nimport sys\nprint(1)\n",
    'text that begins with "Wind 3 m/s, 20 °C"': "Wind 3 m/s, 20 °C\n".encode() * 1000,
    'text that begins with "Hüpfer"': "Hüpfer\n".encode() * 1000,
    "blank, nothing but zeros": bytes(5_000_000),
    "blank, nothing but bytes of FF": b"\xff" * 5000,
    "blank, nothing but white space": b" \n" * 500,
}


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("name", ["file.tlog", "file.ulg", "file.BIN.gz"])
def test_what_is_no_log_is_called_by_its_name(tmp_path: Path, kind: str, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(gzip.compress(FILES[kind]) if name.endswith(".gz") else FILES[kind])
    with pytest.raises(c.InputError, match="is not a flight log: it is") as raised:
        c.open_log(path)
    assert kind in str(raised.value)
    assert "dialect" not in str(raised.value)


@pytest.mark.parametrize("content", [bytes(range(256)) * 20, bytes(5000) + b"\x01", lzma.compress(b"")[:20] * 9])
def test_what_is_not_known_is_called_nothing(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "file.tlog"
    path.write_bytes(content)
    with pytest.raises(c.InputError) as raised:
        c.open_log(path)
    assert "is not a flight log: it is" not in str(raised.value)


def test_a_terminal_is_not_commanded_by_a_text(tmp_path: Path) -> None:
    path = tmp_path / "file.log"
    path.write_bytes(b"\x1b[2Jgone\n")
    with pytest.raises(c.InputError) as raised:
        c.open_log(path)
    assert "\x1b" not in str(raised.value)
