"""Which part a vehicle says that it carries."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.app.sensors import imu_parts, imu_spec_of
from companion.model import Flight
from companion.strapdown import motions
from tests.flights import flight_of, seconds


def carrying(parameters: dict[str, float], instance: int = 0) -> Flight:
    flight = flight_of(motions.rest(seconds(1, 10)), parameters=parameters)
    return replace(flight, imus={"IMU": replace(flight.imu(), instance=instance)})


@pytest.mark.parametrize(
    ("parameter", "kind", "instance", "part"),
    [
        ("INS_GYR_ID", 0x34, 0, "icm-42688-p"),
        ("INS_GYR2_ID", 0x2B, 1, "bmi088"),
        ("INS_GYR3_ID", 0x2F, 2, "icm-20602"),
        ("INS4_GYR_ID", 0x34, 3, "icm-42688-p"),
        ("CAL_GYRO0_ID", 0x26, 0, "icm-42688-p"),
        ("CAL_GYRO1_ID", 0x34, 1, "icm-45686"),  # the number that is an ICM-42688-P to ArduPilot
        ("CAL_GYRO2_ID", 0x66, 2, "bmi088"),
    ],
)
def test_each_imu_is_named_by_its_own_parameter(parameter: str, kind: int, instance: int, part: str) -> None:
    identity = float(kind << 16 | 0x1A0A)
    others = {"INS_GYR_ID": float(0x13 << 16)} if instance and parameter.startswith("INS") else {}
    found = imu_spec_of(carrying(others | {parameter: identity}, instance), "IMU")
    assert found.name == part
    assert parameter in found.reason
    assert part in imu_parts()


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({}, "name no part"),
        ({"INS_GYR_ID": float(0x2A << 16)}, "ArduPilot's simulated IMU"),
        ({"CAL_GYRO0_ID": 1310988.0}, "PX4's simulated IMU"),
        ({"CAL_GYRO0_ID": float(0x11 << 16)}, "lacks"),
    ],
)
def test_otherwise_it_is_any_mems(parameters: dict[str, float], words: str) -> None:
    found = imu_spec_of(carrying(parameters), "IMU")
    assert found.name == "generic-mems"
    assert words in found.reason
