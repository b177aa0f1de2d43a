"""What we write any tool reads back, and what is written while we read arrives whole."""

from __future__ import annotations

import gzip
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pymavlink.dialects.v20.ardupilotmega as mavlink
import pytest

from companion.links import Recorder
from companion.logs import TlogWriter, follow_tlog, log_format, read_tlog, write_tlog
from companion.mavlink import Decoder, Messages, Packer, encode, load_dialect, make_messages, split_messages
from companion.model import InputError
from tests.links.link import link_frames, stamped
from tests.recordings import recording
from tests.waiting import LIMIT_S

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


def test_made_messages_are_read_back_by_pymavlink() -> None:
    t = EPOCH + np.arange(300) / 100
    imu = make_messages(DIALECT.by_name["RAW_IMU"], t, {"time_usec": np.arange(300) * 10_000, "zacc": -1000.9}, sysid=7)
    attitude = make_messages(
        DIALECT.by_name["ATTITUDE"], t + 0.001, {"roll": np.linspace(-1, 1, 300), "yaw": 0.5}, sysid=7
    )
    parameter = make_messages(DIALECT.by_name["PARAM_VALUE"], t[:1], {"param_id": b"AHRS_TRIM_X", "param_value": 0.25})
    data = encode([imu, attitude, parameter], stamped=False, renumber=True).tobytes()
    parser: Any = mavlink.MAVLink(None)
    messages = parser.parse_buffer(data)
    assert parser.total_receive_errors == 0
    assert len(messages) == 601
    one = [m for m in messages if m.get_type() == "PARAM_VALUE"]
    assert [(m.param_id, m.param_value, m.get_srcSystem()) for m in one] == [("AHRS_TRIM_X", 0.25, 1)]
    vehicle = [m for m in messages if m.get_srcSystem() == 7]
    assert [m.get_type() for m in vehicle[:4]] == ["RAW_IMU", "ATTITUDE", "RAW_IMU", "ATTITUDE"]
    assert [m.get_seq() for m in vehicle] == [i % 256 for i in range(600)]
    assert {m.zacc for m in vehicle[::2]} == {-1000}  # towards zero, as autopilots convert
    np.testing.assert_array_equal(
        np.array([m.roll for m in vehicle[1::2]], np.float32), np.linspace(-1, 1, 300).astype(np.float32)
    )


@pytest.mark.parametrize("name", ["sitl/two-vehicles.tlog", "public/clydemcqueen__ardusub_log_tools__small.tlog"])
def test_a_log_written_again_is_the_same_log(tmp_path: Path, name: str) -> None:
    first = read_tlog(recording(name))
    write_tlog(tmp_path / "again.tlog", list(first.messages.values()))
    again = read_tlog(tmp_path / "again.tlog")
    assert list(again.messages) == list(first.messages)
    assert (again.bad_crc_frames, again.skipped_bytes) == (0, 0)
    for key, messages in first.messages.items():
        copy = again.messages[key]
        for column in ("log_time", "sysid", "compid", "seq"):
            np.testing.assert_array_equal(getattr(copy, column), getattr(messages, column))
        assert copy.rows.tobytes() == messages.rows.tobytes()


def test_frames_of_mavlink_2_are_written_byte_for_byte() -> None:
    """As long as their sender trimmed its zeros, which pymavlink does."""
    data = b"".join(stamped(frame, 1_700_000_000_000_000 + i) for i, frame in enumerate(link_frames(700)))
    messages = split_messages(Decoder(DIALECT, stamped=True).push(data), DIALECT)
    assert encode(list(messages.values())).tobytes() == data


def test_a_link_recorded_as_it_comes(tmp_path: Path) -> None:
    frames = list(link_frames(100, signed=True))
    decoder = Decoder(DIALECT, stamped=False)
    with TlogWriter(tmp_path / "link.tlog") as writer:
        for index, frame in enumerate(frames):
            writer.write(decoder.push(frame), EPOCH + index / 10)
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


def test_following_a_log_while_it_grows(tmp_path: Path) -> None:
    path = tmp_path / "growing.tlog"
    frames = list(link_frames(400))
    data = b"".join(stamped(frame, 1_700_000_000_000_000) for frame in frames)
    path.write_bytes(data[:1777])
    read = threading.Event()

    def write() -> None:
        with path.open("ab", buffering=0) as file:
            for begin in range(1777, len(data), 1777):  # at any byte of a frame
                read.wait(LIMIT_S)
                file.write(data[begin : begin + 1777])
                time.sleep(0.005)

    writer = threading.Thread(target=write)
    writer.start()
    batches: list[dict[str, Messages]] = []
    offsets: list[int] = []
    for batch in follow_tlog(path, poll_s=0.001, idle_s=LIMIT_S):
        batches.append(batch)
        read.set()
        offsets += [offset for messages in batch.values() for offset in messages.offset.tolist()]
        if len(offsets) >= len(frames):
            break
    writer.join()
    assert len(batches) > 1
    assert len(set(offsets)) == len(offsets) == len(frames)
    path.write_bytes(data)
    whole = read_tlog(path)
    for name, messages in whole.messages.items():
        parts = [batch[name] for batch in batches if name in batch]
        assert b"".join(part.rows.tobytes() for part in parts) == messages.rows.tobytes()
        np.testing.assert_array_equal(np.concatenate([part.offset for part in parts]), messages.offset)


def test_a_followed_log_that_begins_anew_is_read_anew(tmp_path: Path) -> None:
    path = tmp_path / "growing.tlog"
    data = b"".join(stamped(frame, 1_700_000_000_000_000) for frame in link_frames(100))
    path.write_bytes(data)
    batches = follow_tlog(path, poll_s=0.001, idle_s=0.5)
    first = next(batches)
    path.write_bytes(data[: len(data) // 2])
    second = next(batches)
    assert {name: one.offset[0] for name, one in first.items()} == {n: one.offset[0] for n, one in second.items()}
    assert list(batches) == []


def test_streams_without_stamps_have_no_log_time(tmp_path: Path) -> None:
    path = tmp_path / "link.raw"
    path.write_bytes(b"".join(link_frames(70)))
    log = read_tlog(path)
    assert (log.kind, log.frames) == ("raw", 70)
    assert np.isnan(log.first_log_time)
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
        write_tlog(tmp_path, [])
    with pytest.raises(InputError, match="cannot be written"):
        TlogWriter(tmp_path / "no" / "such.tlog")


def test_a_field_that_no_message_has() -> None:
    with pytest.raises(KeyError, match="no field"):
        make_messages(DIALECT.by_name["ATTITUDE"], np.zeros(1), {"rol": 1.0})
