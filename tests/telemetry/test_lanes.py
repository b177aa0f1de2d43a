"""Every core of an on-board log becomes a lane: its attitude, where it was, its IMU, and which of them flew."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import companion as c
from companion.model import Flight, from_euler
from tests.dataflash_writer import write_dataflash
from tests.recordings import recording
from tests.tlogs import Writer
from tests.ulogs import Fields, ulog

TYPES = {
    "XKQ": ("QBffff", "TimeUS,C,Q1,Q2,Q3,Q4"),
    "XKF1": ("QBccCfffffffhhh", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ"),
    "XKF4": ("QBHB", "TimeUS,C,SS,PI"),
    "XKFS": ("QBBBBB", "TimeUS,C,MI,BI,GI,AI"),
    "AHR2": ("Qccc", "TimeUS,Roll,Pitch,Yaw"),
    "PARM": ("QNf", "TimeUS,Name,Value"),
}
YAW = (0.3, 0.4)  # rad, of the cores


def two_cores(folder: Path) -> Flight:
    """20 s of two cores that stand and differ in heading and position; the second takes over after 12 s."""
    rows: list[tuple[str, tuple[object, ...]]] = [("PARM", (0, name, value)) for name, value in PARAMETERS.items()]
    for i in range(200):
        t = 100_000 * i + 1_000_000
        for core, yaw in enumerate(YAW):
            q = from_euler(np.zeros(1), np.zeros(1), np.array([yaw]))[0].tolist()
            rows.append(("XKF1", (t, core, 0, 0, 0, 1.0, 0.0, 0.0, 0.0, 5.0 * core, 2.0, -10.0, 0, 0, 0)))
            rows.append(("XKQ", (t + 300, core, *q)))
            rows.append(("XKF4", (t + 500, core, 831, int(i >= 110))))
            rows.append(("XKFS", (t + 600, core, core, 0, 0, 0)))
        rows.append(("AHR2", (t + 900, 0, 200, 4500)))
    return c.open_log(write_dataflash(folder / "two.bin", TYPES, rows))[0]


PARAMETERS = {"AHRS_EKF_TYPE": 3.0, "EK3_IMU_MASK": 6.0}


def test_each_core_is_a_lane(tmp_path: Path) -> None:
    flight = two_cores(tmp_path)
    first, second, dcm = flight.lanes
    assert [one.name for one in flight.lanes] == ["EKF3 core 0", "EKF3 core 1", "DCM"]
    assert (first.core, second.core, dcm.core) == (0, 1, None)
    assert (first.imu, second.imu) == (1, 2)  # the bits of EK3_IMU_MASK
    for one, yaw in zip((first, second), YAW, strict=True):
        assert 2.0 * np.arctan2(one.q_ned_frd[:, 3], one.q_ned_frd[:, 0]) == pytest.approx(yaw, abs=1e-6)
    assert second.position[5] == pytest.approx([5.0, 2.0, -10.0])
    assert second.velocity[5] == pytest.approx([1.0, 0.0, 0.0])
    assert not dcm.has_position
    assert second.sensors["compass"].changes[0][1] == 1
    assert flight.lane_in_use is not None
    assert flight.lane_in_use.t == pytest.approx([1.0005, 12.0005])
    assert flight.lane_in_use.instance.tolist() == [0, 1]


@pytest.mark.slow
def test_the_cores_of_a_simulated_flight_are_told_from_one_another_by_its_truth() -> None:
    """One reads the accelerometer that is off by 3 m/s², the other does not."""
    flight = c.open_log(recording("dataflash/sitl__copter-imu1-fail.BIN"))[0]
    truth = flight.truth
    assert truth is not None
    off = []
    for one in flight.lanes[:2]:
        velocity = np.column_stack([np.interp(one.t, truth.t, column) for column in truth.velocity.T])
        off.append(float(np.nanmax(np.linalg.norm(one.velocity - velocity, axis=1))))
    assert off[0] > 5.0
    assert off[1] < 0.2


@pytest.mark.parametrize("attitudes", ["estimator_attitude", "estimator_states"])
def test_each_instance_of_px4_is_a_lane(tmp_path: Path, attitudes: str) -> None:
    t = np.arange(1_000_000, 11_000_000, 500_000, dtype=np.uint64)
    level, one = np.tile(np.array([1, 0, 0, 0], np.float32), (len(t), 1)), np.ones(len(t), np.float32)
    valid = dict.fromkeys(("xy_valid", "z_valid", "v_xy_valid", "v_z_valid"), np.ones(len(t), np.bool_))
    place = {name: one.astype(np.float64) for name in ("ref_lat", "ref_lon")} | {"ref_alt": one}

    def moved(north: float) -> Fields:
        numbers = {"x": north, "y": 0.0, "z": -5.0, "vx": 1.0, "vy": 0.0, "vz": 0.0}
        return {"timestamp": t, **{name: np.float32(v) * one for name, v in numbers.items()}, **valid, **place}

    states = np.zeros((len(t), 24), np.float32)
    states[:, 0], states[:, 4], states[:, 7], states[:, 9] = 1.0, 1.0, 7.0, -5.0
    estimated = level if "attitude" in attitudes else states
    topics: dict[str, Fields] = {
        f"{attitudes}{suffix}": {"timestamp": t, "q" if "attitude" in attitudes else "states": estimated}
        for suffix in ("", ":1")
    }
    topics |= {"estimator_local_position": moved(1.0), "estimator_local_position:1": moved(7.0)}
    primary: Fields = {"timestamp": t, "primary_instance": np.where(t > 6_000_000, 1, 0).astype(np.uint8)}
    path = tmp_path / "two.ulg"
    path.write_bytes(ulog(topics | {"estimator_selector_status": primary}))
    flight = c.open_log(path)[0]
    assert [(lane.name, lane.core) for lane in flight.lanes] == [("EKF2 instance 0", 0), ("EKF2 instance 1", 1)]
    assert flight.lanes[1].velocity[4] == pytest.approx([1.0, 0.0, 0.0])
    assert flight.lanes[1].position[4, 2] == pytest.approx(-5.0)
    assert flight.lane_in_use is not None
    assert flight.lane_in_use.changes == [(1.0, 0), (6.5, 1)]


@pytest.mark.parametrize("is_global", [True, False])
def test_a_lane_of_px4_since_1_16_knows_its_height_alone(tmp_path: Path, is_global: bool) -> None:
    """Its state vector has 0, 0 and minus the height above the sea, and no place about the origin."""
    t = np.arange(1_000_000, 11_000_000, 500_000, dtype=np.uint64)
    one, flags = np.ones(len(t), np.float32), ("xy_valid", "z_valid", "v_xy_valid", "v_z_valid", "xy_global")
    local: dict[str, Any] = {"timestamp": t} | dict.fromkeys(flags, np.full(len(t), is_global))
    local |= dict.fromkeys(("x", "y", "z", "vx", "vy", "vz"), one)
    local |= {"ref_lat": 47.0 * one.astype(np.float64), "ref_lon": 8.0 * one.astype(np.float64), "ref_alt": 489.5 * one}
    states = np.zeros((len(t), 25), np.float32)
    states[:, 0], states[:, 4], states[:, 9] = 1.0, 1.0, -497.0
    path = tmp_path / "states.ulg"
    path.write_bytes(ulog({"estimator_states": {"timestamp": t, "states": states}, "vehicle_local_position": local}))
    (lane,) = c.open_log(path)[0].lanes
    assert np.isnan(lane.position[:, :2]).all()
    np.testing.assert_allclose(lane.position[:, 2], -7.5 if is_global else np.nan)
    np.testing.assert_allclose(lane.velocity, np.tile([1.0, 0.0, 0.0], (len(lane), 1)))


def test_a_link_has_the_second_estimate(tmp_path: Path) -> None:
    writer = Writer(tmp_path / "link.tlog")
    for i in range(50):
        writer.heartbeat(0.1 * i)
        writer.attitude(0.1 * i, 20 + 0.1 * i)
        writer.send(0.1 * i, "AHRS2", roll=0.0, pitch=0.1, yaw=1.0, altitude=0.0, lat=0, lng=0)
    (lane,) = c.open_log(writer.close())[0].lanes
    assert (lane.name, lane.core, lane.source) == ("second estimate", None, "AHRS2")
    assert not lane.has_position
