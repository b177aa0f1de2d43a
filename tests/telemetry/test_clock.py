"""The date of a flight: from the vehicle's own word, from GPS, from the stamps of the log."""

from __future__ import annotations

import time
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from companion.app.recording import open_log
from companion.model import Array, Epoch
from companion.telemetry.clock import Clock, gps_to_unix, steps_back
from tests.recordings import BUNDLED, recording
from tests.tlogs import EPOCH, Writer


def epoch(path: Path) -> Epoch | None:
    return open_log(path)[0].epoch


def test_the_stamps_of_a_log_date_it(tmp_path: Path) -> None:
    log = Writer(tmp_path / "log.tlog")
    log.rest(20.0, boot=300.0)
    found = epoch(log.close())
    assert found is not None
    assert found.source == "log stamps"
    assert found.unix_s == pytest.approx(EPOCH - 300.0, abs=2e-3)


def test_one_packet_with_a_boot_time_is_no_clock(tmp_path: Path) -> None:
    log = Writer(tmp_path / "log.tlog")
    for i in range(400):
        log.raw_imu(0.02 * i, 300.0 + 0.02 * i)
    log.send(4.0, "system_time", time_unix_usec=round(EPOCH * 1e6), time_boot_ms=304_000)
    log.heartbeat(8.0)
    (flight,) = open_log(log.close())
    assert flight.start == 300.0
    assert flight.duration == pytest.approx(7.98)


def test_the_vehicle_knows_better_than_the_stamps(tmp_path: Path) -> None:
    log = Writer(tmp_path / "log.tlog")
    log.rest(20.0, boot=300.0)
    for i in range(5):  # the first without a fix, counted from 1970
        unix = round((EPOCH + 3600.0 + i) * 1e6) if i else 5
        log.send(float(i), "system_time", time_unix_usec=unix, time_boot_ms=300_000 + 1000 * i)
    assert epoch(log.close()) == Epoch(EPOCH + 3600.0 - 300.0, "SYSTEM_TIME")


def test_stamps_that_run_at_another_pace_date_nothing(tmp_path: Path) -> None:
    log = Writer(tmp_path / "log.tlog")
    for i in range(200):  # a replay at thirty times the speed
        log.heartbeat(i / 30)
        log.attitude(i / 30, 300.0 + i)
    assert epoch(log.close()) is None


def test_both_logs_of_one_flight_are_of_the_same_time() -> None:
    """The telemetry log by SYSTEM_TIME, the on-board log by GPS week, leap seconds and all: 0.2 s apart at most."""
    told, measured = (
        epoch(path) for path in (BUNDLED / "copter-demo-100hz.tlog", recording("dataflash/sitl__copter-demo.BIN"))
    )
    assert told is not None
    assert measured is not None
    assert (told.source, measured.source) == ("SYSTEM_TIME", "GPS")
    assert measured.unix_s == pytest.approx(told.unix_s, abs=0.2)


@pytest.mark.parametrize(
    ("week", "seconds", "utc"),
    [  # https://www.ngs.noaa.gov/CORS/Gpscal.shtml, and the leap seconds of Bulletin C
        (1930, 0.0, datetime(2017, 1, 1, tzinfo=UTC)),
        (2295, 345_600.0, datetime(2024, 1, 4, tzinfo=UTC)),
        (1800, 86_400.0, datetime(2014, 7, 7, tzinfo=UTC)),
    ],
)
def test_gps_time_is_utc_with_leap_seconds(week: int, seconds: float, utc: datetime) -> None:
    leap = 16 if utc.year == 2014 else 18
    found = gps_to_unix(np.array([float(week)]), np.array([seconds + leap]))
    assert found[0] == utc.timestamp()


@pytest.mark.parametrize("leap", [15, 16, 17])
def test_a_leap_second_is_counted_when_it_has_happened(leap: int) -> None:
    """2012-07-01, 2015-07-01 and 2017-01-01: GPS runs on evenly, and UTC repeats a second there and no more."""
    midnight = {15: 1_341_100_800.0, 16: 1_435_708_800.0, 17: 1_483_228_800.0}[leap]
    utc = midnight + np.array([-3600.0, -0.5, 0.5, 3600.0])
    gps = utc - 315_964_800.0 + np.array([leap, leap, leap + 1, leap + 1])
    week = np.floor(gps / 604_800.0)
    assert gps_to_unix(week, gps - 604_800.0 * week) == pytest.approx(utc, abs=1e-6)


def along(*pieces: Array) -> Clock:
    t = np.concatenate(pieces)
    return Clock(np.arange(len(t)), t, 0.02 * np.arange(len(t), dtype=np.float64))


def test_a_clock_that_is_set_back_goes_on_from_there_and_a_late_packet_is_none() -> None:
    on = np.linspace(0.0, 9.9, 100)
    assert steps_back(along(100 + on, 108 + on, 117 + on)) == [100, 200]
    assert steps_back(along(100 + on, 108 + on[:3], 110 + on)) == []
    assert steps_back(along(100 + on, 108 + on[:4])) == [100], "the log ends while it goes on"
    assert steps_back(along(100 + on, 90 + on)) == [], "a reboot"


def test_packets_that_all_come_twice_take_no_longer_each_the_more_there_are() -> None:
    on = 100.0 + 0.02 * np.arange(150_000)
    begin = time.process_time()
    assert steps_back(along(np.column_stack([on + 1.0, on]).ravel())) == []
    assert time.process_time() - begin < 5.0, "by the square of their number it would be 15 s"
