"""How a log is named."""

from __future__ import annotations

from pathlib import Path

import pytest

import companion as c


def test_demo_is_the_bundled_flight_unless_there_is_a_file_of_that_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (flight,) = c.open_log("demo")
    assert flight.imu().source == "RAW_IMU"
    Path("demo").write_bytes(b"no log")
    with pytest.raises(c.InputError, match="demo"):
        c.open_log("demo")
