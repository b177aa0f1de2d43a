"""What we write any tool reads back, and what is written while we read arrives whole."""

from __future__ import annotations

import errno
import gzip
import os
import time
from pathlib import Path

import numpy as np
import pytest

from companion.links import Recorder
from companion.logs import log_format, read_tlog
from companion.mavlink import Decoder, Packer, load_dialect
from companion.model import InputError
from tests.links.link import link_frames, stamped

DIALECT = load_dialect()
EPOCH = 1_700_000_000.0


def test_a_payload_that_is_laid_out_already_makes_the_same_frame() -> None:
    packer, other = Packer(7, 9), Packer(7, 9)
    for name in ("RAW_IMU", "SYS_STATUS", "ADSB_VEHICLE", "DEVICE_OP_READ"):  # trimmed, and an id of three bytes
        layout = DIALECT.by_name[name]
        for value in (0, 3, 117):
            fields = {field: value for field in layout.fields if layout.dtype[field].kind in "iuf"}
            row = np.zeros(1, layout.dtype)
            for field in fields:
                row[field] = value
            assert packer.frame(layout, row.tobytes()) == other.pack(name, fields)


def test_a_link_recorded_as_it_comes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frames = list(link_frames(100, signed=True))
    decoder = Decoder(DIALECT, stamped=False)
    times = iter(EPOCH + index / 10 for index in range(len(frames)))
    monkeypatch.setattr(time, "time", lambda: next(times))
    with Recorder(tmp_path / "link.tlog") as recorder:
        for frame in frames:
            recorder.write(decoder.push(frame))
    expected = b"".join(stamped(frame, round((EPOCH + i / 10) * 1e6)) for i, frame in enumerate(frames))
    assert (tmp_path / "link.tlog").read_bytes() == expected


def test_what_was_recorded_is_with_the_operating_system_before_the_next_is(tmp_path: Path) -> None:
    decoder, path = Decoder(DIALECT, stamped=False), tmp_path / "a.tlog"
    with Recorder(path) as recorder:
        for frame in link_frames(50):
            recorder.write(decoder.push(frame))
            assert path.stat().st_size == recorder.size_bytes
            assert path.read_bytes().endswith(frame), "what kill -9 would leave"
    assert recorder.frames == 50


def test_a_recording_of_nothing_is_not_left_behind(tmp_path: Path) -> None:
    with Recorder(tmp_path / "a.tlog"):
        assert (tmp_path / "a.tlog").is_file()
    assert not (tmp_path / "a.tlog").exists()


def test_a_file_that_has_taken_the_place_of_a_deleted_recording_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.tlog"
    with Recorder(path):
        path.unlink()
        path.write_text("somebody else's")
    assert path.read_text() == "somebody else's"


def test_a_file_system_that_goes_ends_the_recording_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(_: int) -> os.stat_result:
        raise OSError(errno.ENOTCONN, "Transport endpoint is not connected")

    (frame,) = link_frames(1)
    decoder = Decoder(DIALECT, stamped=False)
    with Recorder(tmp_path / "a.tlog") as recorder:
        recorder.write(decoder.push(frame))
        recorder._looked -= 2.0  # it is time to look whether the file is there
        monkeypatch.setattr(os, "fstat", gone)
        recorder.write(decoder.push(frame))
        assert recorder.frames == 2
        recorder._end("the disk has gone")
        monkeypatch.undo()


def test_two_that_begin_in_one_second_record_beside_each_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(time, "strftime", lambda _: "2026-01-01 12-00-00")
    frames = Decoder(DIALECT, stamped=False).push(next(link_frames(1)))
    with Recorder() as one, Recorder() as two:
        one.write(frames)
        two.write(frames)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "2026-01-01 12-00-00 2.tlog",
        "2026-01-01 12-00-00.tlog",
    ]


def test_streams_without_stamps_have_no_log_time(tmp_path: Path) -> None:
    path = tmp_path / "link.raw"
    path.write_bytes(b"".join(link_frames(70)))
    log = read_tlog(path)
    assert (log.kind, log.frames) == ("raw", 70)
    assert all(np.isnan(messages.log_time).all() for messages in log.messages.values())


def test_formats_are_told_by_content(tmp_path: Path) -> None:
    path = tmp_path / "misnamed.tlog"
    path.write_bytes(gzip.compress(b"\xa3\x95\x80\x80" + bytes(100)))
    assert log_format(path) == "dataflash"
    path.write_bytes(b"ULog\x01\x12\x35\x01" + bytes(100))
    assert log_format(path) == "ulog"


def test_nothing_that_can_be_decompressed(tmp_path: Path) -> None:
    path = tmp_path / "cut.gz"
    path.write_bytes(gzip.compress(b"x" * 1000)[:11])
    with pytest.raises(InputError, match="decompressed"):
        read_tlog(path)


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        Recorder(tmp_path / "no" / "such.tlog")
