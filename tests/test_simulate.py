"""The simulated vehicle: its logs are true, the same for the same seed, and its manners those of an autopilot."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pymavlink.dialects.v20.ardupilotmega as mavlink
import pytest

import companion as c
from companion.cli import main
from companion.model import InputError, SettingsError
from companion.simulate import Faults, SimulatedVehicle, fly, low_pass, write_flight
from companion.strapdown import ImuModel, quaternion

pytestmark = pytest.mark.slow

STREAMS = {"RAW_IMU": 100.0, "HIGHRES_IMU": 100.0, "ATTITUDE": 50.0, "LOCAL_POSITION_NED": 20.0, "SIM_STATE": 10.0}


class Asker:
    """A ground station by pymavlink: what it asks, and what the vehicle answers."""

    def __init__(self, vehicle: SimulatedVehicle) -> None:
        self.vehicle = vehicle
        self.mav: Any = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.t = 0.0

    def ask(self, message: Any) -> list[Any]:
        self.vehicle.receive(message.pack(self.mav))
        return list(self.hear(0.01))

    def hear(self, seconds: float) -> Iterator[Any]:
        self.t += seconds
        for _, packet in self.vehicle.advance(self.t):
            yield from self.mav.parse_buffer(packet) or []

    def command(self, number: int, *parameters: float) -> int:
        """The MAV_RESULT of a command."""
        padded = [*parameters, *[0.0] * (7 - len(parameters))]
        answers = self.ask(mavlink.MAVLink_command_long_message(1, 1, number, 0, *padded))
        (ack,) = [a for a in answers if a.get_type() == "COMMAND_ACK"]
        assert ack.command == number
        return int(ack.result)

    def rate(self, name: str, seconds: float = 2.0) -> float:
        count = sum(1 for m in self.hear(seconds) if m.get_type() == name)
        return count / seconds


def vehicle_for(seconds: float = 30.0, **changes: Any) -> SimulatedVehicle:
    faults = changes.get("faults", Faults())
    return SimulatedVehicle(fly(seconds, faults=faults, model=changes.pop("model", ImuModel())), **changes)


def test_the_log_of_an_ideal_imu_is_its_truth(tmp_path: Path) -> None:
    write_flight(vehicle_for(streams=STREAMS), tmp_path / "a.tlog")
    (flight,) = c.open_log(tmp_path / "a.tlog")
    assert (flight.vehicle.autopilot, flight.vehicle.type, flight.boot) == ("ARDUPILOTMEGA", "QUADROTOR", 1)
    truth = fly(30.0, model=ImuModel()).truth
    imu = flight.imu("HIGHRES_IMU")
    at = np.rint(imu.t / 0.0025).astype(int)
    np.testing.assert_allclose(imu.gyro, truth.gyro[at], atol=1e-6)
    np.testing.assert_allclose(imu.accel, truth.accel[at], atol=1e-6)
    raw = flight.imu("RAW_IMU")
    assert raw.rate_hz == pytest.approx(100.0)
    short = truth.accel[np.rint(raw.t / 0.0025).astype(int)] / raw.accel_step - raw.accel / raw.accel_step
    assert (np.abs(short) < 1.0 + 1e-9).all()
    assert (short * np.sign(raw.accel) > -1e-9).all(), "cut towards zero"
    worst = c.drift(flight, horizons=(10,), imu="HIGHRES_IMU").rows[0].position_m
    assert worst is not None
    assert worst.max < 0.3


def test_the_same_seed_gives_the_same_bytes(tmp_path: Path) -> None:
    def written(name: str, seed: int) -> bytes:
        faults = Faults(drop=0.1, duplicate=0.1, reorder=0.1, garbage=0.1)
        vehicle = SimulatedVehicle(fly(5.0, seed=seed), streams=STREAMS, faults=faults, seed=seed)
        write_flight(vehicle, tmp_path / name)
        return (tmp_path / name).read_bytes()

    assert written("a", 1) == written("b", 1) != written("c", 2)


def test_how_far_it_flies_at_a_time_does_not_show() -> None:
    """Intervals of 6 ms fall on uneven steps; a reboot, a change of interval and the end come in between."""

    def heard(pace: float) -> list[tuple[float, bytes]]:
        faults = Faults(reboot=(2.003,), turned_down=(5.0,))
        vehicle = vehicle_for(9.0, streams={"RAW_IMU": 1000 / 6, "ATTITUDE": 50.0, "SIM_STATE": 7.0}, faults=faults)
        return [packet for end in np.arange(pace, 9.0 + 2 * pace, pace) for packet in vehicle.advance(float(end))]

    assert heard(0.0025) == heard(0.7) == heard(100.0)


def test_intervals_are_set_with_ardupilots_manners() -> None:
    asker = Asker(vehicle_for())
    assert asker.rate("RAW_IMU") == 0, "nothing streams until asked"
    assert asker.command(511, 27, 1e6 / 150) == mavlink.MAV_RESULT_ACCEPTED
    assert asker.vehicle.interval_us("RAW_IMU") == 6000, "whole milliseconds"
    assert asker.rate("RAW_IMU") == pytest.approx(1000 / 6, rel=0.02)
    assert asker.command(511, 27, 2000) == mavlink.MAV_RESULT_DENIED, "faster than the loop allows"
    assert asker.command(511, 27, 10_000, 1) == mavlink.MAV_RESULT_DENIED, "a third parameter"
    assert asker.command(511, 999, 10_000) == mavlink.MAV_RESULT_DENIED, "an unknown message"
    answers = asker.ask(mavlink.MAVLink_command_long_message(1, 1, 510, 0, 27, 0, 0, 0, 0, 0, 0))
    assert [m.interval_us for m in answers if m.get_type() == "MESSAGE_INTERVAL"] == [6000]
    assert asker.command(511, 27, -1) == mavlink.MAV_RESULT_ACCEPTED
    assert asker.rate("RAW_IMU") == 0
    assert asker.command(400, 1) == mavlink.MAV_RESULT_UNSUPPORTED, "it cannot be armed"


def test_px4_accepts_what_it_never_sends() -> None:
    asker = Asker(vehicle_for(autopilot="px4"))
    assert asker.command(511, 27, 10_000) == mavlink.MAV_RESULT_ACCEPTED
    assert asker.rate("RAW_IMU") == 0
    assert asker.command(511, 26, 10_000) == mavlink.MAV_RESULT_ACCEPTED
    assert asker.rate("SCALED_IMU") == pytest.approx(100, rel=0.02)


def test_it_answers_parameters_versions_clocks_and_stream_requests() -> None:
    asker = Asker(vehicle_for(parameters={"AHRS_TRIM_X": 0.02}))
    answers = asker.ask(mavlink.MAVLink_param_request_read_message(1, 1, b"AHRS_TRIM_X", -1))
    (value,) = [m for m in answers if m.get_type() == "PARAM_VALUE"]
    assert (value.param_id, value.param_value) == ("AHRS_TRIM_X", pytest.approx(0.02))
    assert asker.command(512, 148) == 0
    assert asker.ask(mavlink.MAVLink_timesync_message(0, 77))[0].ts1 == 77
    asker.ask(mavlink.MAVLink_request_data_stream_message(1, 1, 10, 20, 1))
    assert asker.rate("ATTITUDE") == pytest.approx(20, rel=0.05)
    asker.ask(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 1))
    assert asker.rate("ATTITUDE") == pytest.approx(4, rel=0.3), "a ground station asks for everything at 4 Hz"


def test_a_reboot_forgets_the_intervals_and_begins_a_new_flight(tmp_path: Path) -> None:
    asker = Asker(vehicle_for(faults=Faults(reboot=(10.0,))))
    assert asker.command(511, 27, 10_000) == 0
    assert asker.rate("RAW_IMU", 9.0) > 90
    assert asker.rate("RAW_IMU", 9.0) < 20
    write_flight(vehicle_for(faults=Faults(reboot=(10.0,)), streams=STREAMS), tmp_path / "a.tlog")
    assert [flight.boot for flight in c.open_log(tmp_path / "a.tlog")] == [1, 2]


def test_a_bad_link_loses_doubles_and_soils(tmp_path: Path) -> None:
    faults = Faults(drop=0.3, duplicate=0.05, reorder=0.05, garbage=0.05, silence=((4.0, 6.0),))
    vehicle = vehicle_for(10.0, streams=STREAMS, faults=faults)
    write_flight(vehicle, tmp_path / "a.tlog")
    (flight,) = c.open_log(tmp_path / "a.tlog")
    arrived = len(flight.imu("RAW_IMU"))
    assert vehicle.sent["RAW_IMU"] == 1001
    assert arrived == pytest.approx(801 * 0.7, rel=0.1)
    assert flight.messages["RAW_IMU"].duplicates > 0
    assert (flight.messages["RAW_IMU"].longest_gap_s or 0) == pytest.approx(2.0, abs=0.1)


def test_faults_of_sensor_and_estimator_are_seen(tmp_path: Path) -> None:
    faults = Faults(imu_bias=(10.0, 0.05), ekf_reset=(20.0, 5.0))
    write_flight(vehicle_for(streams=STREAMS, faults=faults), tmp_path / "a.tlog")
    (flight,) = c.open_log(tmp_path / "a.tlog")
    row = c.drift(flight, horizons=(2,)).rows[0]
    assert row.excluded == {"position_jump": 1}
    assert row.attitude_deg is not None
    assert row.attitude_deg.max == pytest.approx(np.degrees(0.1), rel=0.1)


def test_the_square_ends_where_it_began_and_turns_at_its_corners() -> None:
    truth = fly(80.0, motion="square", model=ImuModel()).truth
    np.testing.assert_allclose(truth.position[-1], 0.0, atol=1e-9)
    np.testing.assert_array_equal(truth.velocity[-1], 0.0)
    np.testing.assert_allclose(truth.position.min(axis=0), [0.0, 0.0, -10.0], atol=1e-9)
    np.testing.assert_allclose(truth.position.max(axis=0), [28.0, 28.0, 0.0], atol=1e-9)
    heading = np.unwrap(quaternion.to_euler(truth.q_ned_frd)[:, 2])
    assert heading[-1] - heading[0] == pytest.approx(2 * np.pi)
    tilt = np.degrees(np.arccos(np.clip(quaternion.to_matrix(truth.q_ned_frd)[:, 2, 2], -1, 1)))
    assert 15 < tilt.max() < 35, "it leans as a quadrotor does"
    assert len(fly(200.0, motion="square", model=ImuModel()).truth.t) > len(truth.t)


@pytest.mark.parametrize("corner_hz", [5.0, 20.0, 80.0])
def test_the_filter_is_butterworths(corner_hz: float) -> None:
    import scipy.signal  # noqa: PLC0415  (slow to import, and every process of the tests collects this file)

    readings = np.random.default_rng(0).standard_normal((4000, 3)) + [1.0, -2.0, 9.8]
    b, a = scipy.signal.butter(2, corner_hz, fs=400.0)
    state = scipy.signal.lfilter_zi(b, a)[:, None] * readings[:1]
    theirs, _ = scipy.signal.lfilter(b, a, readings, axis=0, zi=state)
    np.testing.assert_allclose(low_pass(readings, corner_hz), theirs, atol=1e-9)


FAULTS = [
    ([], "consistent", set()),
    (["imu-bias@40"], "imu_suspect", {"gyro_bias"}),
    (["imu-stuck@40"], "imu_suspect", {"frozen"}),
    (["imu-clip@40"], "imu_suspect", {"accel_clipping"}),
    (["gps-glitch@40"], "autopilot_suspect", {"position_jump", "gps_position"}),
    (["ekf-reset@40"], "autopilot_suspect", {"position_jump", "position_off"}),
    (["loss"], "consistent", set()),
    (["reboot@30"], "consistent", set()),
]


@pytest.mark.parametrize(("faults", "status", "kinds"), FAULTS, ids=[" ".join(f) or "none" for f, _, _ in FAULTS])
def test_the_verdict_on_each_fault_is_the_fault(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], faults: list[str], status: str, kinds: set[str]
) -> None:
    log = str(tmp_path / "a.tlog")
    options = [word for fault in faults for word in ("--fault", fault)]
    assert main(["simulate", "--output", log, "--duration", "60", *options]) == 0
    capsys.readouterr()
    assert main(["analyze", log, "--json"]) == 0
    (flight,) = json.loads(capsys.readouterr().out)["flights"]
    assert flight["verdict"]["status"] == status
    errors = [found for found in flight["verdict"]["findings"] if found["severity"] == "error"]
    assert {found["kind"] for found in errors} == kinds
    if errors:
        assert min(found["start_s"] for found in errors) == pytest.approx(40.0, abs=1.0)


def test_the_autopilots_filter_is_found_as_the_lag_that_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A Butterworth of second order is late by √2 / (2π f): 11.3 ms at 20 Hz."""
    log = str(tmp_path / "a.tlog")
    assert main(["simulate", "--output", log, "--duration", "80", "--imu-filter", "20", "--imu-model", "bmi270"]) == 0
    (flight,) = c.open_log(log)
    assert flight.parameters["INS_GYRO_FILTER"] == 20
    capsys.readouterr()
    assert main(["analyze", log, "--full"]) == 0
    printed = capsys.readouterr().out
    lag = re.search(r"lags ([\d.]+) ± ([\d.]+) ms", printed)
    assert lag
    assert float(lag[1]) == pytest.approx(11.25, abs=3 * float(lag[2]))
    assert "IMU noise model: bmi270 (INS_GYR_ID" in printed


def test_the_estimate_may_be_late() -> None:
    flown = fly(20.0, motion="circle", latency_s=0.1)
    np.testing.assert_allclose(flown.velocity[40:], flown.truth.velocity[:-40], atol=0.05)


def test_what_cannot_be_is_said(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="no motion 'loop'"):
        fly(10.0, motion="loop")
    with pytest.raises(SettingsError, match="got 0"):
        fly(0.0)
    with pytest.raises(SettingsError, match="corner lies between 0.1 and 200 Hz"):
        fly(10.0, filter_hz=300.0)
    with pytest.raises(SettingsError, match="corner"):
        fly(10.0, filter_hz=1e-4)
    with pytest.raises(SettingsError, match="latency"):
        fly(10.0, latency_s=-1.0)
    with pytest.raises(SettingsError, match="drop is a share"):
        Faults(drop=2.0)
    with pytest.raises(InputError, match="cannot be written"):
        write_flight(vehicle_for(1.0), tmp_path)
