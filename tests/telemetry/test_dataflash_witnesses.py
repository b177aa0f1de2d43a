"""The aiding sensors of ArduPilot's logs: what pymavlink's DFReader reads, in SI; and what a simulator knows."""

from __future__ import annotations

import lzma
from collections import defaultdict
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from pymavlink.DFReader import DFReader_binary

import companion as c
from companion.model import Flight
from tests.recordings import alike, recording, shared

pytestmark = pytest.mark.slow

REAL = (
    "real/srikanthgoli1__rrc_fault_tolerant_control__good_prop_hover_1.BIN",
    "real/Hibram26__Logs__00000022.BIN",
    "real/spark404__dataflashlog__log.bin",
    "real/lacondro__drone_logbook__log_0_2026-6-12-11-09-06.bin",
)
TAKEOFF = "copter-takeoff.bin.xz"  # the first 700 kB of the first of the simulated ones: it comes with the tests
CUTS = ("cut/dataflash/sitl__copter-demo.BIN", "cut/dataflash/sitl__copter-imu1-fail.BIN")  # these come with them too
FAULTS = ("ap_faults/gyrbias_z.bin.xz", *alike("ap_witness/gyro1_z_15mrad.BIN.xz"))
SIMULATED = alike("dataflash/sitl__copter-hover-nodrift.BIN", "dataflash/sitl__copter-imu1-fail.BIN")  # of the CUTS

Values = npt.NDArray[np.float64]


@cache
def unpacked(name: str) -> Path:
    if name.startswith("cut/"):
        return recording(name.removeprefix("cut/"))
    path = Path(__file__).parent.parent / "data" / name if name == TAKEOFF else shared(name)
    if path.suffix != ".xz":
        return path
    plain = Path(mkdtemp()) / path.stem
    plain.write_bytes(lzma.decompress(path.read_bytes()))
    return plain


@cache
def read_with_pymavlink(name: str) -> dict[str, list[Any]]:
    """Messages by name, those with an instance as "GPS[0]"."""
    reader, found = DFReader_binary(str(unpacked(name))), defaultdict(list)
    while (message := reader.recv_msg()) is not None:
        kind, instance_field = message.get_type(), message.fmt.instance_field
        found[kind if instance_field is None else f"{kind}[{getattr(message, instance_field)}]"].append(message)
    reader.close()
    return found


def columns(messages: list[Any], *names: str) -> Values:
    return np.array([[getattr(message, name) for name in names] for message in messages], np.float64)


@cache
def flight_of(name: str) -> Flight:
    (flight,) = c.open_log(unpacked(name))
    return flight


@pytest.mark.parametrize("name", [TAKEOFF, *CUTS, *REAL, *SIMULATED, *FAULTS])
def test_receivers_are_what_pymavlink_reads(name: str) -> None:
    flight, theirs = flight_of(name), read_with_pymavlink(name)
    assert flight.gps
    for track in flight.gps:
        messages = theirs.get(track.source) or theirs["GPS"]
        accuracies = theirs.get(track.source.replace("GPS", "GPA")) or theirs["GPA"]
        latitude, longitude, height, speed, course, down, fix, satellites = columns(
            messages, "Lat", "Lng", "Alt", "Spd", "GCrs", "VZ", "Status", "NSats"
        ).T
        np.testing.assert_array_equal(track.fix_type, fix)
        np.testing.assert_array_equal(track.satellites, satellites)
        fixed = fix >= 3
        np.testing.assert_allclose(np.degrees(track.latitude[fixed]), latitude[fixed], rtol=1e-14)
        np.testing.assert_allclose(np.degrees(track.longitude[fixed]), longitude[fixed], rtol=1e-14)
        np.testing.assert_allclose(track.height[fixed], height[fixed])
        assert np.isnan(track.latitude[fix < 2]).all()
        there = np.column_stack([speed * np.cos(np.radians(course)), speed * np.sin(np.radians(course)), down])
        np.testing.assert_allclose(track.velocity[fixed], there[fixed], atol=1e-12)
        if not accuracies:  # one of the logs was thinned out
            np.testing.assert_allclose(track.t, columns(messages, "TimeUS")[:, 0] * 1e-6)
            continue
        sigmas = columns(accuracies, "HAcc", "VAcc", "SAcc")
        sigmas[sigmas == 0] = np.nan
        sigmas[fix < 2] = np.nan
        ours = np.column_stack([track.horizontal_sigma, track.vertical_sigma, track.speed_sigma])
        np.testing.assert_allclose(ours, sigmas)
        np.testing.assert_allclose(track.t, columns(accuracies, "SMS")[:, 0] * 1e-3)


@pytest.mark.parametrize("name", [TAKEOFF, *CUTS, *REAL, *SIMULATED, *FAULTS])
def test_compasses_and_barometers_are_what_pymavlink_reads(name: str) -> None:
    flight, theirs = flight_of(name), read_with_pymavlink(name)
    assert flight.compasses
    assert flight.barometers
    for compass in flight.compasses:
        old = "MAG" if compass.instance == 0 else f"MAG{compass.instance + 1}"
        read = columns(theirs.get(compass.source) or theirs[old], "TimeUS", "MagX", "MagY", "MagZ")
        near = np.searchsorted(read[:, 0] * 1e-6, compass.t)  # the sample is older than its record
        np.testing.assert_allclose(compass.field, read[near, 1:] * 1e-7)
    for barometer in flight.barometers:
        messages = theirs.get(barometer.source) or theirs["BARO"]
        t, pressure, altitude, temperature = columns(messages, "TimeUS", "Press", "Alt", "Temp").T
        near = np.searchsorted(t * 1e-6, barometer.t - 1e-3)  # SMS has whole ms
        np.testing.assert_array_equal(barometer.pressure, pressure[near])
        np.testing.assert_array_equal(barometer.altitude, altitude[near])
        np.testing.assert_array_equal(barometer.temperature, temperature[near])


@pytest.mark.parametrize("name", [TAKEOFF, *CUTS, *REAL, *SIMULATED, *FAULTS])
def test_biases_and_the_selected_imu_are_what_pymavlink_reads(name: str) -> None:
    flight, theirs = flight_of(name), read_with_pymavlink(name)
    assert flight.biases
    assert flight.imu_in_use
    for track in flight.biases:
        messages = theirs.get(track.source) or theirs[track.source[:4]]
        t, *gyro = columns(messages, "TimeUS", "GX", "GY", "GZ").T
        np.testing.assert_allclose(track.t, t * 1e-6)
        np.testing.assert_allclose(track.gyro, np.radians(np.column_stack(gyro)))
        if track.source.startswith("X") and "XKF2[0]" in theirs:
            second = columns(theirs[track.source.replace("F1", "F2")], "TimeUS", "AX", "AY", "AZ")
            same = np.isin(second[:, 0], t)
            np.testing.assert_allclose(track.accel[: same.sum()], second[same, 1:])
        assert track.imu_instance == track.core  # EK3_IMU_MASK is 3 or 7 in all of them
    primary = columns(theirs.get("XKF4[0]") or theirs["NKF4"], "TimeUS", "PI")
    assert [flight.imu_in_use.at(t * 1e-6) for t, _ in primary] == primary[:, 1].tolist()


@pytest.mark.parametrize("name", [TAKEOFF, *CUTS, *SIMULATED])
def test_the_sensors_in_use_are_what_pymavlink_reads(name: str) -> None:
    flight, theirs = flight_of(name), read_with_pymavlink(name)
    own = [core for core in theirs if core.startswith("XKFS") and core.endswith(f"[{flight.biases[0].core}]")]
    assert bool(own) == bool(flight.aiding_in_use)
    for kind, column in {"GPS": "GI", "compass": "MI", "barometer": "BI", "airspeed": "AI"}.items():
        for t, number in columns(theirs[own[0]], "TimeUS", column):
            assert flight.aiding_in_use[kind].at(t * 1e-6) == number


@pytest.mark.parametrize("name", [TAKEOFF, *CUTS, *SIMULATED])
def test_the_truth_of_a_simulator_is_in_the_frames_of_the_estimate(name: str) -> None:
    """The EKF in a calm simulator errs by less than 3° and 0.3 m: frames and origin are the same."""
    flight = flight_of(name)
    truth, position = flight.truth, flight.position
    assert truth
    assert position
    ours = np.column_stack([np.interp(truth.t, position.t, column) for column in position.position.T])
    assert np.median(np.linalg.norm(ours - truth.position, axis=1)) < 0.3
    at = np.searchsorted(flight.require_attitude().t, truth.t).clip(max=len(flight.require_attitude()) - 1)
    cosine = np.abs(np.einsum("ij,ij->i", truth.q_ned_frd, flight.require_attitude().q_ned_frd[at]))
    assert np.degrees(2 * np.arccos(np.median(cosine).clip(max=1))) < 3
    assert np.nanmedian(np.abs(truth.velocity)) < 10


def test_what_a_log_announces_of_its_estimator_and_parameters() -> None:
    """The simulator's accelerometer is bent at 68.8 s, by a parameter; the EKF changes its lane at 69.6."""
    flight = flight_of("dataflash/sitl__copter-imu1-fail.BIN")
    changed = {(change.name, round(change.t, 1)): change.value for change in flight.parameter_changes}
    assert changed["SIM_ACC1_BIAS_X", 68.8] == 3.0
    assert not any(name.startswith("STAT_") for name, _ in changed)
    lanes = [(round(reset.t), reset.core) for reset in flight.resets if reset.kind == "lane"]
    assert lanes == [(70, 1), (125, 0)]
    assert flight.imu_in_use
    assert flight.imu_in_use.at(np.array([60.0, 80.0, 130.0])).tolist() == [0, 1, 0]
    moved = [reset for reset in flight.resets if reset.kind == "position"]
    assert [reset.core for reset in moved] == [0]
    assert "96.46 m" in moved[0].text
    assert any(reset.kind == "heading" and reset.core is None for reset in flight.resets)  # EV 62


@pytest.mark.parametrize("name", ["real/spark404__dataflashlog__log.bin", TAKEOFF, *CUTS, *SIMULATED])
def test_the_desired_attitude_is_in_the_frame_of_the_actual_one(name: str) -> None:
    """ATT speaks of the vehicle, XKQ of its IMU: what is between them is AHRS_TRIM (0.5°, and 2.1° in the first)."""
    flight, theirs = flight_of(name), read_with_pymavlink(name)
    assert flight.control
    both = columns(theirs["ATT"], "TimeUS", "Roll", "Pitch", "DesRoll", "DesPitch")
    asked = np.degrees(np.median(np.hypot(*np.radians(both[:, 1:3] - both[:, 3:5]).T)))
    attitude = flight.require_attitude()
    at = np.searchsorted(attitude.t, flight.control.t).clip(max=len(attitude) - 1)
    leaned = [
        2 * (q[:, [1]] * q[:, [3]] - q[:, [0]] * q[:, [2]]) for q in (attitude.q_ned_frd[at], flight.control.q_ned_frd)
    ]
    assert np.degrees(np.median(np.abs(leaned[0] - leaned[1]))) < asked + 0.3


def test_motor_outputs_are_a_share_of_their_range() -> None:
    flight, theirs = flight_of(TAKEOFF), read_with_pymavlink(TAKEOFF)
    assert flight.actuators
    low, high = (flight.parameters[f"MOT_PWM_{end}"] for end in ("MIN", "MAX"))
    pulses = columns(theirs["RCOU"], "C1", "C2", "C3", "C4")
    np.testing.assert_allclose(flight.actuators.output[:, :4], ((pulses - low) / (high - low)).clip(0, 1))
    assert np.isnan(flight.actuators.output[:, 4:]).all()


@pytest.mark.parametrize("name", ["dataflash/public__clydemcqueen__ardusub_log_tools__small.BIN", *CUTS, *SIMULATED])
def test_rates_are_the_imu_less_the_bias_of_its_core(name: str) -> None:
    flight = flight_of(name)
    attitude, bias = flight.require_attitude(), flight.biases[0]
    (imu,) = (track for track in flight.imus.values() if track.instance == bias.imu_instance)
    inner = slice(5, -5)
    gyro = np.column_stack([np.interp(attitude.t, imu.t, column) for column in imu.gyro.T])
    believed = np.column_stack([np.interp(attitude.t, bias.t, column) for column in bias.gyro.T])
    np.testing.assert_allclose(
        attitude.rates[inner].mean(axis=0), (gyro - believed)[inner].mean(axis=0), atol=np.radians(0.02)
    )
