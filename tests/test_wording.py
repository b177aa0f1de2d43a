"""Names as people write them."""

from __future__ import annotations

import pytest

from companion.model import words


@pytest.mark.parametrize(
    ("name", "written"),
    [
        ("gps_position", "GPS position"),
        ("between_imus", "between IMUs"),
        ("imu_suspect", "IMU suspect"),
        ("accel_bias", "accelerometer bias"),
        ("compass_turn", "compass turn"),
    ],
)
def test_an_identifier_is_written_as_the_field_writes_it(name: str, written: str) -> None:
    assert words(name) == written
