"""PX4's log before .ulg."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import companion as c
from benchmarks.accuracy.cutting import cut
from tests.dataflash_writer import write_dataflash
from tests.recordings import recording

HZ, SECONDS, BOOT_US = 50, 4, 579_000_000
HOME = (404660000, -869697000)  # 1e-7°
TYPES = {
    "TIME": ("Q", "StartTime"),
    "IMU": ("fffffffff", "AccX,AccY,AccZ,GyroX,GyroY,GyroZ,MagX,MagY,MagZ"),
    "IMU1": ("fffffffff", "AccX,AccY,AccZ,GyroX,GyroY,GyroZ,MagX,MagY,MagZ"),
    "ATT": ("ffffff", "Roll,Pitch,Yaw,RollRate,PitchRate,YawRate"),
    "LPOS": ("ffffffLLfB", "X,Y,Z,VX,VY,VZ,RLat,RLon,RAlt,PFlg"),
    "GPS": ("QBffLLffffB", "GPSTime,Fix,EPH,EPV,Lat,Lon,Alt,VelN,VelE,VelD,nSat"),
    "SENS": ("fff", "BaroPres,BaroAlt,BaroTemp"),
    "STAT": ("B", "ArmS"),
    "PARM": ("Nf", "Name,Value"),
}


def written(path: Path, *, invalid_until: float = 0.0) -> Path:
    """It turns about the vertical by 0.1 rad/s on its way north, and is armed after a second."""
    rows: list[tuple[str, tuple[object, ...]]] = [("PARM", ("MAV_TYPE", 2.0)), ("PARM", ("MAV_SYS_ID", 7.0))]
    for i in range(SECONDS * HZ):
        t, wobble = i / HZ, 1e-3 * (i % 7)
        rows += [
            ("TIME", (BOOT_US + round(t * 1e6),)),
            ("IMU", (wobble, 0.0, -9.8, wobble, 0.0, 0.1, 0.2 + wobble, 0.0, 0.4)),
            ("IMU1", (0.0, wobble, -9.7, 0.0, wobble, 0.1, 0.2 + wobble, 0.0, 0.4)),
            ("ATT", (0.0, 0.0, 0.1 * t, 0.0, 0.0, 0.1)),
            (
                "LPOS",
                (2.0 * t, 0.0, -3.0, 2.0, 0.0, 0.0, 404660000, -869697000, 200.0, 63 if t >= invalid_until else 14),
            ),
        ]
        if i % 10 == 0:
            fix = (1_433_984_879_000_000 + round(t * 1e6), 3, 1.5, 2.5, HOME[0] + 20 * i, HOME[1], 203.0)
            rows += [("GPS", (*fix, 2.0, 0.0, 0.0, 11)), ("SENS", (985.0 + wobble, 234.0, 40.0))]
            rows += [("STAT", (2 if t >= 1.0 else 1,))]
    return write_dataflash(path, TYPES, rows)


def test_its_records_become_a_flight(tmp_path: Path) -> None:
    (flight,) = c.open_log(written(tmp_path / "old.px4log"))
    assert str(flight.vehicle) == "7:1"
    assert (flight.vehicle.autopilot, flight.vehicle.type) == ("PX4", "QUADROTOR")
    assert [(name, track.instance) for name, track in flight.imus.items()] == [("IMU", 0), ("IMU1", 1)]
    imu, attitude, position = flight.imu(), flight.require_attitude(), flight.position
    assert imu.rate_hz == pytest.approx(HZ)
    assert imu.t[0] == pytest.approx(579.0)
    assert imu.accel[:, 2] == pytest.approx(-9.8, rel=1e-6)
    yaw = 2.0 * np.arctan2(attitude.q_ned_frd[:, 3], attitude.q_ned_frd[:, 0])
    assert yaw == pytest.approx(0.1 * (attitude.t - 579.0), abs=1e-6)
    assert position is not None
    assert position.position[:, 0] == pytest.approx(2.0 * (position.t - 579.0), abs=1e-4)
    (gps,) = flight.gps
    assert np.degrees(gps.latitude[0]) == pytest.approx(40.466)
    assert gps.velocity[0] == pytest.approx([2.0, 0.0, 0.0])
    assert flight.barometers[0].pressure == pytest.approx(98500.0, abs=1.0)
    assert [one.instance for one in flight.compasses] == [0, 1]
    assert np.linalg.norm(flight.compasses[0].field[0]) == pytest.approx(0.447e-4, rel=0.01)
    assert [(e.kind, round(e.t, 1)) for e in flight.events] == [("armed", 580.0)]
    assert flight.epoch is not None
    assert flight.epoch.unix_s + flight.start == pytest.approx(1_433_984_879.0)


def test_a_position_that_calls_itself_invalid_is_none(tmp_path: Path) -> None:
    (flight,) = c.open_log(written(tmp_path / "old.px4log", invalid_until=2.0))
    assert flight.position is not None
    assert flight.position.t[0] == pytest.approx(581.0)


@pytest.mark.slow
def test_a_recorded_one_is_examined() -> None:
    (flight,) = c.open_log(recording("strangers/dronecrew__px4tools__01_07_59.px4log"))
    assert len(flight.imus) == 2
    begin = flight.imu().t[0]
    assert c.examine(cut(flight, begin, begin + 45.0)).assessment.drift.rows[0].windows > 30
