"""Which of the two is wrong: on simulated faults, and on recordings whose faults are known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import companion as c
from companion.analysis import GENERIC, PARTS, Assessment, Finding, assess
from companion.sensors import figures_of
from companion.strapdown import ImuModel, Motion, Sensor, motions, quaternion, simulate
from companion.tracks import AttitudeTrack, Flight, PositionTrack
from tests.flights import flight_of, seconds
from tests.recordings import BUNDLED, shared

MOTION = motions.coning(seconds(60, 100), angle=0.2, frequency=0.2)
GOOD = ImuModel(
    gyro=Sensor(noise_density=GENERIC.gyro.noise_density, bias=np.array([1e-3, -1e-3, 5e-4])),
    accel=Sensor(noise_density=GENERIC.accel.noise_density, bias=np.array([0.05, 0.02, -0.05])),
)


def flown(motion: Motion = MOTION, **changes: Any) -> Flight:
    """A flight with a good IMU and a good autopilot, but for the changes."""
    track = replace(simulate(motion.imu, GOOD, 1), source="RAW_IMU")
    return replace(flight_of(motion, every=2), imus={"RAW_IMU": track}, **changes)


def of_kind(found: Assessment, kind: str) -> Finding:
    kinds = [f.kind for f in found.verdict.findings]
    assert kind in kinds, f"found {kinds}"
    return found.verdict.findings[kinds.index(kind)]


def with_readings(gyro: Any = None, accel: Any = None) -> Flight:
    flight = flown()
    imu = flight.imu()
    return replace(
        flight,
        imus={
            "RAW_IMU": replace(
                imu, gyro=imu.gyro if gyro is None else gyro(imu), accel=imu.accel if accel is None else accel(imu)
            )
        },
    )


def during(imu: c.ImuTrack, begin: float, end: float) -> Any:
    return ((imu.t >= begin) & (imu.t < end))[:, None]


def test_a_good_imu_is_consistent() -> None:
    found = assess(flown(), GENERIC)
    assert found.verdict.status == "consistent"
    assert not [f for f in found.verdict.findings if f.severity == "error"]


def test_a_gyro_bias_that_begins_in_flight() -> None:
    bias = np.array([0.02, -0.03, 0.0])
    found = assess(with_readings(gyro=lambda imu: imu.gyro + bias * during(imu, 40, 99)), GENERIC)
    finding = of_kind(found, "gyro_bias")
    assert found.verdict.status == "imu_suspect"
    assert finding.start_s == pytest.approx(40, abs=2.5)
    assert finding.end_s == pytest.approx(70, abs=2.5)


def test_an_accelerometer_offset_for_a_while() -> None:
    found = assess(with_readings(accel=lambda imu: imu.accel + [3.0, 0, 0] * during(imu, 30, 42)), GENERIC)
    finding = of_kind(found, "accel_bias")
    assert found.verdict.status == "imu_suspect"
    assert (finding.start_s, finding.end_s) == pytest.approx((30, 42), abs=2.5)


def test_a_frozen_imu() -> None:
    def frozen(readings: Any, imu: c.ImuTrack) -> Any:
        held = readings.copy()
        held[imu.t >= 50] = held[np.argmax(imu.t >= 50)]
        return held

    flight = with_readings(gyro=lambda imu: frozen(imu.gyro, imu), accel=lambda imu: frozen(imu.accel, imu))
    found = assess(flight, GENERIC)
    assert found.verdict.status == "imu_suspect"
    assert of_kind(found, "frozen").start_s == pytest.approx(50, abs=0.1)


def test_a_sensor_at_rest_is_not_frozen() -> None:
    """Whole milli-units read the same for ever at rest."""
    motion = motions.rest(seconds(60, 100))
    assert assess(flight_of(motion), GENERIC).verdict.status == "consistent"


def test_clipping() -> None:
    found = assess(with_readings(accel=lambda imu: np.where(during(imu, 30, 30.1), 157.0, imu.accel)), GENERIC)
    assert found.verdict.status == "imu_suspect"
    assert of_kind(found, "accel_clipping").start_s == pytest.approx(30, abs=0.05)


def test_a_gps_glitch_is_the_autopilots() -> None:
    flight = flown()
    position = flight.position
    assert position
    moved = position.position + [10.0, 0, 0] * ((position.t > 33) & (position.t < 50))[:, None]
    found = assess(replace(flight, position=PositionTrack(position.t, moved, position.velocity)), GENERIC)
    assert found.verdict.status == "autopilot_suspect"
    jumps = [f.start_s for f in found.verdict.findings if f.kind == "position_jump"]
    assert jumps == pytest.approx([33, 50], abs=0.05)


def test_a_yaw_reset_is_the_autopilots() -> None:
    flight = flown()
    attitude = flight.attitude
    assert attitude
    q = attitude.q_ned_frd.copy()
    after = attitude.t > 40
    q[after] = quaternion.multiply(quaternion.exp(np.array([0, 0, np.radians(15)])), q[after])
    found = assess(replace(flight, attitude=AttitudeTrack(attitude.t, q, attitude.rates)), GENERIC)
    assert of_kind(found, "heading_jump").start_s == pytest.approx(40, abs=0.3)
    assert found.verdict.status == "autopilot_suspect"


def test_four_hertz_is_too_little() -> None:
    flight = flown(motions.coning(seconds(60, 4), angle=0.2, frequency=0.2))
    found = assess(flight, GENERIC)
    assert found.verdict.status == "insufficient_data"
    assert of_kind(found, "rate_too_low")


def test_a_short_flight_is_too_little() -> None:
    assert assess(flown(motions.circle(seconds(9, 100))), GENERIC).verdict.status == "insufficient_data"


def test_a_noisy_sensor_is_called_noisy() -> None:
    model = ImuModel(gyro=Sensor(noise_density=4e-3), accel=Sensor(noise_density=0.05))
    flight = flown()
    found = assess(replace(flight, imus={"RAW_IMU": simulate(MOTION.imu, model, 2)}), GENERIC)
    assert of_kind(found, "gyro_noise").severity == "warning"
    assert found.measured_noise == pytest.approx((4e-3, 0.05), rel=0.2)


def test_every_finding_lies_in_the_flight_and_says_what_to_do() -> None:
    for name in ("copter-demo-100hz", "copter-hover-100hz", "copter-mission-default-rates"):
        flight = c.open_log(BUNDLED / f"{name}.tlog")[0]
        found = assess(flight, figures_of(flight, flight.imu().source))
        for finding in found.verdict.findings:
            assert flight.start - 1 <= finding.start_s <= finding.end_s <= flight.start + flight.duration + 1
            assert finding.evidence
            assert finding.advice


@pytest.mark.parametrize(
    ("name", "status", "kinds"),
    [
        ("copter-demo-100hz", "consistent", []),
        ("copter-hover-nodrift-100hz", "consistent", []),
        ("copter-hover-100hz", "consistent", []),
        ("copter-square-100hz", "consistent", []),
        ("copter-mission-default-rates", "insufficient_data", [("rate_too_low", 2.5, 168.0)]),
        ("copter-biased-imu-100hz", "imu_suspect", [("gyro_bias", 59.7, 175.7)]),
        ("copter-imu1-fail-100hz", "imu_suspect", [("accel_bias", 68.8, 80.8), ("frozen", 88.8, 130.0)]),
        (
            "copter-gps-glitch-50hz",
            "autopilot_suspect",
            [("position_jump", 80.2, 80.3), ("position_jump", 102.2, 102.2)],
        ),
        ("copter-reboot-midlog", "consistent", []),
        ("two-vehicles", "consistent", []),
        ("copter-signed", "consistent", []),
        ("copter-mavlink1-50hz", "consistent", []),
    ],
)
def test_recordings_with_known_faults(name: str, status: str, kinds: list[tuple[str, float, float]]) -> None:
    for flight in c.open_log(shared(f"sitl/{name}.tlog")):
        found = assess(flight, figures_of(flight, flight.imu().source))
        assert found.verdict.status == status
        decisive = [f for f in found.verdict.findings if f.severity == "error"]
        assert [f.kind for f in decisive] == [kind for kind, _, _ in kinds]
        for finding, (_, start, end) in zip(decisive, kinds, strict=True):
            assert (finding.start_s, finding.end_s) == pytest.approx((start, end), abs=2.0)


def test_calibration_of_the_biased_recording() -> None:
    """RAW_IMU shows (9.55, -14.48, 7.52) mrad/s: what was set, cut towards zero."""
    flight = c.open_log(shared("sitl/copter-biased-imu-100hz.tlog"))[0]
    found = assess(flight, GENERIC)
    assert found.calibration
    assert found.calibration.values[:3] * 1e3 == pytest.approx([9.55, -14.48, 7.52], abs=0.4)
    before, after = (d.rows[0].position_m for d in (found.uncorrected, found.corrected) if d)
    assert before
    assert after
    assert after.median < before.median / 3


def test_the_lag_of_ardupilots_filter_is_found() -> None:
    flight = c.open_log(shared("sitl/copter-square-100hz.tlog"))[0]
    found = assess(flight, GENERIC)
    assert found.calibration
    assert found.calibration.values[PARTS["time_offset"]] == pytest.approx(0.012, abs=0.0015)


def test_a_stuck_axis() -> None:
    def stuck(imu: c.ImuTrack) -> Any:
        held = imu.gyro.copy()
        during_it = (imu.t >= 44) & (imu.t < 46)
        held[during_it, 1] = held[np.argmax(during_it), 1]
        return held

    found = assess(with_readings(gyro=stuck), GENERIC)
    assert found.verdict.status == "imu_suspect"
    finding = of_kind(found, "stuck_axis")
    assert (finding.start_s, finding.end_s) == pytest.approx((44, 46), abs=0.1)
    assert finding.evidence.startswith("gyro y")


def test_a_board_mounted_the_wrong_way() -> None:
    """Turned by 90° about down: what is right reads as forward."""
    turn = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    found = assess(with_readings(gyro=lambda imu: imu.gyro @ turn.T, accel=lambda imu: imu.accel @ turn.T), GENERIC)
    assert found.verdict.status == "imu_suspect"
    assert "(-y, x, z)" in of_kind(found, "axes_wrong").evidence
