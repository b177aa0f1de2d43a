"""A short run of every target, and logs that were once the end of a reader. `make fuzz` goes on for hours."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

import companion as c
from tests.fuzz import contents, logs
from tests.fuzz.cases import attempt, read_log, targets

pytestmark = pytest.mark.slow

CASES = {
    "tlog": 8, "bin": 8, "log": 8, "ulg": 8, "bent tlog": 5, "bent bin": 5, "bent ulg": 5, "toml": 60, "live": 8,
    "websocket": 500,
}  # fmt: skip


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # NumPy's, which the program does not show either
@pytest.mark.parametrize("name", CASES)
def test_whatever_is_changed_ends_in_a_result_or_a_clear_error(tmp_path: Path, name: str) -> None:
    suffix, good, change, read = targets(tmp_path)[name]
    random = np.random.default_rng(20)
    for i in range(CASES[name]):
        path = tmp_path / f"case{i}{suffix}"
        path.write_bytes(change(good, random))
        assert attempt(path, read) is None, f"case {i}"


def test_a_recording_is_written_out_again_as_it_was(tmp_path: Path) -> None:
    written = {".tlog": contents.of_tlog(), ".bin": contents.of_dataflash(tmp_path), ".ulg": contents.of_ulog(tmp_path)}
    for suffix, one in written.items():
        path = tmp_path / f"again{suffix}"
        path.write_bytes(one.write(one.rows, one.origin))
        (flight,) = c.open_log(path)
        assert flight.attitude
        assert flight.position
        assert len(flight.imu()) >= 200
        assert not [note for note in flight.notes if any(sign in note for sign in _DAMAGE)]


_DAMAGE = ("damaged", "time stamp", "time of the", "records left out", "samples left out", "treated as unknown")


@pytest.mark.parametrize("name", ["tlog", "bin", "log", "ulg"])
def test_the_logs_that_are_changed_are_good(tmp_path: Path, name: str) -> None:
    suffix, good, _, _ = targets(tmp_path)[name]
    path = tmp_path / f"good{suffix}"
    path.write_bytes(good)
    (flight,) = c.open_log(path)
    assert flight.duration == pytest.approx(logs.SECONDS, abs=0.1)
    assert flight.attitude
    assert flight.position
    assert len(flight.imu()) == logs.SECONDS * logs.HZ
    assert not [note for note in flight.notes if any(sign in note for sign in _DAMAGE)]


@pytest.mark.parametrize(("name", "size"), [("bin", 8), ("ulg", 8)])
def test_one_flipped_bit_of_a_time_stamp_costs_one_sample(tmp_path: Path, name: str, size: int) -> None:
    suffix, good, _, _ = targets(tmp_path)[name]
    stamp = round((20.0 + 100 / logs.HZ) * 1e6).to_bytes(size, "little")
    for bit in range(24, 64, 3):
        data = bytearray(good)
        data[good.index(stamp) + bit // 8] ^= 1 << bit % 8
        path = tmp_path / f"flipped{suffix}"
        path.write_bytes(data)
        (flight,) = c.open_log(path)
        assert flight.duration == pytest.approx(logs.SECONDS, abs=0.1)
        assert attempt(path, read_log) is None


@pytest.mark.parametrize("bit", range(24, 64, 3))
def test_a_sample_s_own_time_stays_near_that_of_its_record(tmp_path: Path, bit: int) -> None:
    """vehicle_imu has two times: when it was measured, and when it was published. Both may be damaged."""
    _, good, _, _ = targets(tmp_path)["ulg"]
    stamp = struct.pack("<QQ", 24_000_000, 24_000_000)
    data = bytearray(good)
    data[good.index(stamp) + 8 + bit // 8] ^= 1 << bit % 8
    path = tmp_path / "flipped.ulg"
    path.write_bytes(data)
    (flight,) = c.open_log(path)
    t = flight.imu().t
    assert t[-1] - t[0] == pytest.approx(logs.SECONDS, abs=0.1)
    assert [note for note in flight.notes if "vehicle_imu: 1 of 200 taken at the time of their publication" in note]
