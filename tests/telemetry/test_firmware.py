"""Which vehicle a log is of, where no MAV_TYPE says it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import companion as c
from companion.telemetry.parameters import UNKNOWN, banner, vehicle_type
from tests.dataflash_writer import write_dataflash
from tests.tlogs import Writer
from tests.ulogs import ulog

TYPES = {
    "PARM": ("NfQ", "Name,Value,TimeUS"),
    "MSG": ("QZ", "TimeUS,Message"),
    "IMU": ("QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("ArduCopter V4.7.0-dev (90700977)", ("QUADROTOR", "4.7.0-dev")),
        ("APM:Copter V3.4-dev (82d534b1)", ("QUADROTOR", "3.4-dev")),
        ("ArduPlane V3.1.2beta1 (834f90e8)", ("FIXED_WING", "3.1.2beta1")),
        ("APM:Plane V3.4.0", ("FIXED_WING", "3.4.0")),
        ("APM:Rover V3.0.0", ("GROUND_ROVER", "3.0.0")),
        ("ArduRover V4.5.1 (ab)", ("GROUND_ROVER", "4.5.1")),
        ("Rover V4.0.0", ("GROUND_ROVER", "4.0.0")),
        ("ArduSub V4.1.0 (89639005)", ("SUBMARINE", "4.1.0")),
        ("Blimp V4.6.0-dev", ("AIRSHIP", "4.6.0-dev")),
        ("TQ-2.2.143", None),
        ("Frame: QUAD", None),
        ("Not ArduCopter V1", None),
    ],
)
def test_a_banner_names_the_vehicle(text: str, told: tuple[str, str] | None) -> None:
    assert banner(["New mission", text]) == told


@pytest.mark.parametrize(
    ("parameters", "build", "kind"),
    [
        ({}, 2, "QUADROTOR"),
        ({}, 7, "SUBMARINE"),
        ({"SYSID_SW_TYPE": 10.0}, None, "QUADROTOR"),
        ({"SYSID_SW_TYPE": 0.0}, None, "FIXED_WING"),
        ({"SYSID_SW_TYPE": 20.0}, None, "GROUND_ROVER"),
        ({"SYSID_SW_TYPE": 1e9}, 999, UNKNOWN),
        ({"PILOT_THR_BHV": 0.0}, None, "QUADROTOR"),
        ({"RLL2SRV_TCONST": 0.5}, None, "FIXED_WING"),
        ({"JS_GAIN_DEFAULT": 0.5}, None, "SUBMARINE"),
        ({"ATC_ANG_RLL_P": 4.5}, None, UNKNOWN),
    ],
)
def test_build_and_parameters_tell_where_no_banner_does(
    parameters: dict[str, float], build: int | None, kind: str
) -> None:
    assert vehicle_type(parameters, build) == kind


def test_a_log_of_a_vendors_firmware_has_a_vehicle(tmp_path: Path) -> None:
    rows = [("MSG", (1_000_000, "TQ-2.2.143")), ("PARM", ("SYSID_SW_TYPE", 10.0, 1_000_000))]
    rows += [("IMU", (1_000_000 + 20_000 * i, 0, 0.0, 0.0, 0.0, 0.0, 0.0, -9.8)) for i in range(50)]
    (flight,) = c.open_log(write_dataflash(tmp_path / "vendor.bin", TYPES, rows))
    assert (flight.vehicle.type, flight.vehicle.firmware) == ("QUADROTOR", "")


def test_a_telemetry_log_without_heartbeats_has_a_vehicle(tmp_path: Path) -> None:
    log = Writer(tmp_path / "a.tlog")
    log.send(20.0, "statustext", severity=6, text=b"ArduRover V4.5.1 (ab12cd34)")
    for i in range(20):
        log.attitude(20.0 + 0.1 * i, 20.0 + 0.1 * i)
    (flight,) = c.open_log(log.close())
    assert (flight.vehicle.autopilot, flight.vehicle.type, flight.vehicle.firmware) == (
        "ARDUPILOTMEGA",
        "GROUND_ROVER",
        "4.5.1",
    )


@pytest.mark.parametrize(("parameters", "kind"), [({}, "HEXAROTOR"), ({"MAV_TYPE": 2}, "QUADROTOR")])
def test_a_ulog_without_its_parameter_has_the_type_of_its_status(
    tmp_path: Path, parameters: dict[str, float], kind: str
) -> None:
    status: dict[str, np.ndarray[Any, Any]] = {
        "timestamp": np.arange(5, dtype=np.uint64) * 500_000,
        "arming_state": np.ones(5, np.uint8),
        "nav_state": np.zeros(5, np.uint8),
        "system_type": np.full(5, 13, np.uint8),
    }
    path = tmp_path / "a.ulg"
    path.write_bytes(ulog({"vehicle_status": status}, parameters))
    (flight,) = c.open_log(path)
    assert flight.vehicle.type == kind
