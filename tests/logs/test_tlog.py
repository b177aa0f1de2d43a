"""Whole logs: the same frames and values as pymavlink reads, on real recordings; and what bad input gets."""

from __future__ import annotations

import importlib
import math
import os
import tracemalloc
from collections import Counter, defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.logs import Log, read_tlog
from companion.model import InputError
from tests.recordings import BUNDLED, recording

pytestmark = pytest.mark.slow

Reader = Callable[[Path], dict[str, list[Any]]]

INTACT = [
    "sitl/copter-demo-100hz.tlog",
    "sitl/copter-mavlink1-50hz.tlog",
    "sitl/copter-signed.tlog",
    "sitl/two-vehicles.tlog",
    "public/Punit-154__BlackBox-Parser__mav.tlog",
    "public/squilter__gridlines__kresge_02.tlog",
    "px4/px4_gcs_default.tlog",
]
DAMAGED = [  # of two more the frames are those of the specification: see tests/mavlink/test_frames.py
    "public/langrind__Mavometer__test.tlog",  # changes from MAVLink 1 to 2; pymavlink loses a valid frame
    "public/4belito__uav-cyber-sim__537f370f_mav.tlog",
    "public/clydemcqueen__ardusub_log_tools__small.tlog",
]


@pytest.fixture
def pymavlink_reads(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], dict[str, list[Any]]]:
    """Every message that pymavlink recovers from a log, by name, in file order."""
    monkeypatch.setenv("MAVLINK20", "1")  # mavutil chooses the wire protocol of its dialect by the environment
    mavutil: Any = importlib.import_module("pymavlink.mavutil")
    mavutil.set_dialect("ardupilotmega")

    def read(path: Path) -> dict[str, list[Any]]:
        found: dict[str, list[Any]] = defaultdict(list)
        log = mavutil.mavlogfile(str(path), robust_parsing=True)
        while (message := log.recv_msg()) is not None:
            found[message.get_type()].append(message)
        log.close()
        return found

    return read


def _same(ours: Any, theirs: Any) -> bool:
    if isinstance(theirs, str | bytes | bytearray):
        text = theirs.encode(errors="surrogateescape") if isinstance(theirs, str) else bytes(theirs)
        return bytes(ours).rstrip(b"\0") == text.rstrip(b"\0")
    if isinstance(theirs, float) and math.isnan(theirs):
        return math.isnan(ours)
    return bool(ours == theirs)


@pytest.mark.parametrize("name", INTACT)
def test_every_frame_and_every_value_is_what_pymavlink_reads(pymavlink_reads: Reader, name: str) -> None:
    path = recording(name)
    log = read_tlog(path)
    theirs = pymavlink_reads(path)
    for message_name, messages in log.messages.items():
        reference = theirs[message_name]
        assert len(messages) == len(reference), message_name
        assert messages.sysid.tolist() == [m.get_srcSystem() for m in reference]
        assert messages.compid.tolist() == [m.get_srcComponent() for m in reference]
        assert messages.seq.tolist() == [m.get_seq() for m in reference]
        assert messages.crc.tolist() == [m.get_crc() for m in reference]
        for field in messages.layout.fields:
            for ours, message in zip(messages[field].tolist(), reference, strict=True):
                value = getattr(message, field)
                if isinstance(value, list | tuple):
                    assert all(_same(a, b) for a, b in zip(ours, value, strict=True))
                else:
                    assert _same(ours, value), (message_name, field)
    known = {name: len(found) for name, found in theirs.items() if not name.startswith(("BAD_DATA", "UNKNOWN_"))}
    assert known == {name: len(messages) for name, messages in log.messages.items()}


@pytest.mark.parametrize("name", DAMAGED)
def test_at_least_as_many_frames_of_each_type_as_pymavlink(pymavlink_reads: Reader, name: str) -> None:
    path = recording(name)
    log = read_tlog(path)
    for message_name, reference in pymavlink_reads(path).items():
        if not message_name.startswith(("BAD_DATA", "UNKNOWN_")):
            assert len(log.messages[message_name]) >= len(reference), message_name


def test_counts_account_for_every_byte() -> None:
    log = read_tlog(recording("sitl/copter-demo-100hz.tlog"))
    assert (log.bad_crc_frames, log.skipped_bytes, dict(log.unknown_frames)) == (0, 0, {})
    assert log.frames == sum(len(messages) for messages in log.messages.values())
    assert log.size_bytes == log.path.stat().st_size
    offsets = np.sort(np.concatenate([messages.offset for messages in log.messages.values()]))
    assert offsets[0] == 8
    assert len(np.unique(offsets)) == log.frames


def test_unknown_ids_are_skipped_by_length() -> None:
    log = read_tlog(recording("public/SemvdH__5g_drone_ROS2__src_mav.tlog"))
    assert log.unknown_frames == {8: 18, 410: 1, 411: 11}
    assert log.skipped_bytes == 0


def test_stamps_are_exact_to_the_microsecond() -> None:
    path = recording("sitl/two-vehicles.tlog")
    data = path.read_bytes()
    for messages in read_tlog(path).messages.values():
        stamps = [int.from_bytes(data[offset - 8 : offset], "big") for offset in messages.offset.tolist()]
        assert np.round(messages.log_time * 1e6).astype(int).tolist() == stamps


def test_absurd_stamps_are_no_time() -> None:
    log = read_tlog(recording("public/LucaGemma__MasterThesis__mav.tlog"))
    times = np.concatenate([messages.log_time for messages in log.messages.values()])
    assert np.isnan(times).any()
    assert np.nanmax(times) < 2**52 / 1e6


def test_only_the_rows_asked_for_are_read() -> None:
    path = recording("sitl/copter-demo-100hz.tlog")
    every, some = read_tlog(path), read_tlog(path, names={"ATTITUDE"})
    assert Counter({n: len(m) for n, m in every.messages.items()}) == {n: len(m) for n, m in some.messages.items()}
    np.testing.assert_array_equal(some.messages["ATTITUDE"]["roll"], every.messages["ATTITUDE"]["roll"])
    np.testing.assert_array_equal(some.messages["RAW_IMU"].log_time, every.messages["RAW_IMU"].log_time)
    with pytest.raises(KeyError, match="names"):
        some.messages["RAW_IMU"]["xacc"]
    with pytest.raises(KeyError, match="no field"):
        some.messages["ATTITUDE"]["rol"]


def test_select_takes_the_same_messages_from_every_column() -> None:
    attitude = read_tlog(recording("sitl/two-vehicles.tlog")).messages["ATTITUDE"]
    second = attitude.select(attitude.sysid == 2)
    assert 0 < len(second) < len(attitude)
    assert set(second.sysid.tolist()) == {2}
    np.testing.assert_array_equal(second["roll"], attitude["roll"][attitude.sysid == 2])


def test_another_dialect_reads_its_own_ids() -> None:
    log: Log = read_tlog(recording("px4/px4_gcs_default.tlog"), dialect="development")
    assert log.messages["CURRENT_MODE"].layout.id == 436
    assert 436 not in log.unknown_frames


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "empty"),
        (b"\xa3\x95\x80\x80" + b"x" * 200, "DataFlash"),
        (b"ULog\x01\x12\x35\x01" + b"x" * 200, "ULog"),
        (b"time,roll,pitch\n" * 50, "not a flight log: it is text"),
        (bytes(1000), "not a flight log: it is blank"),
    ],
)
def test_files_without_mavlink(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "some.tlog"
    path.write_bytes(content)
    with pytest.raises(InputError, match=says):
        read_tlog(path)


def test_a_run_of_magic_bytes_takes_little_memory(tmp_path: Path) -> None:
    """Each may begin a frame of MAVLink 1: looked at all together, 3 MB of them took 220 MB."""
    log = (BUNDLED / "copter-hover-100hz.tlog").read_bytes()
    path, run = tmp_path / "run.tlog", 1 << 20
    path.write_bytes(log + bytes([0xFE]) * run + log)
    whole = read_tlog(BUNDLED / "copter-hover-100hz.tlog", names=())
    tracemalloc.start()
    found = read_tlog(path, names=())
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found.frames == 2 * whole.frames
    assert (found.skipped_bytes, found.bad_crc_frames) == (run, 0)
    assert peak < 60 << 20


def test_files_that_cannot_be_opened(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no file"):
        read_tlog(tmp_path / "missing.tlog")
    with pytest.raises(InputError, match="directory"):
        read_tlog(tmp_path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names here")
def test_a_pipe_is_named_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(InputError, match="is a pipe or a device"):
            read_tlog(path)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_unreadable_file(tmp_path: Path) -> None:
    path = tmp_path / "secret.tlog"
    path.write_bytes(b"x")
    path.chmod(0)
    with pytest.raises(InputError, match="permissions"):
        read_tlog(path)
