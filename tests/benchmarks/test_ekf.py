"""The small EKF: on a simulated flight it converges to the truth, and is as wrong as it says that it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.accuracy import ekf
from benchmarks.accuracy.cutting import at, attitude_at
from benchmarks.accuracy.estimated import replaced, shifted
from companion.model import (
    Array,
    AttitudeTrack,
    BarometerTrack,
    CompassTrack,
    DataError,
    Flight,
    GpsTrack,
    PositionTrack,
    Vehicle,
    geodetic_from_ned,
)
from companion.simulate import MOTIONS
from companion.strapdown import ImuModel, Motion, Sensor, quaternion, simulate

pytestmark = pytest.mark.slow

HOME = (0.8, 0.15, 400.0)
FIELD = np.array([21e-6, 1e-6, 43e-6])
BIAS, OFFSET = np.array([4e-3, -3e-3, 2e-3]), np.array([0.03, -0.04, 0.05])
RATE_HZ, SECONDS = 100.0, 110.0


def flown(seed: int = 0) -> tuple[Flight, Motion]:
    """A square with every sensor that the filter takes, each with white noise of what it expects of it."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    true = MOTIONS["square"](t)
    model = ImuModel(
        gyro=Sensor(noise_density=1.5e-3, bias_walk=1e-4, bias=BIAS),
        accel=Sensor(noise_density=0.035, bias_walk=2e-3, bias=OFFSET),
    )
    imu = replace(simulate(true.imu, model, rng), source="RAW_IMU")
    slow, fast = slice(0, None, 20), slice(0, None, 10)
    n = len(t[slow])
    place = geodetic_from_ned(true.position[slow] + rng.normal(0, 0.5, (n, 3)), HOME)
    gps = GpsTrack(
        t[slow],
        latitude=place[:, 0],
        longitude=place[:, 1],
        height=place[:, 2],
        velocity=true.velocity[slow] + rng.normal(0, 0.3, (n, 3)),
        horizontal_sigma=np.full(n, 0.5),
        vertical_sigma=np.full(n, 0.5),
        speed_sigma=np.full(n, 0.3),
        fix_type=np.full(n, 3.0),
        satellites=np.full(n, 12.0),
    )
    body = quaternion.rotate(quaternion.conjugate(true.q_ned_frd[fast]), FIELD)
    m = len(t[fast])
    altitude = -true.position[fast, 2] + rng.normal(0, 1.0, m)
    nothing = np.full(m, np.nan)
    flight = Flight(
        Vehicle(1, 1, "ARDUPILOTMEGA", "QUADROTOR"),
        boot=1,
        start=0.0,
        duration=SECONDS,
        imus={"RAW_IMU": imu},
        attitude=AttitudeTrack(t[fast], true.q_ned_frd[fast], true.gyro[fast], "ATTITUDE"),
        position=PositionTrack(t[fast], true.position[fast], true.velocity[fast], "LOCAL_POSITION_NED"),
        gps=(gps,),
        compasses=(CompassTrack(t[fast], body + rng.normal(0, 2e-6, (m, 3))),),
        barometers=(BarometerTrack(t[fast], nothing, altitude, nothing),),
    )
    return flight, true


def errors(found: ekf.Estimate, true: Motion) -> Array:
    """Truth minus estimate (K, 15), as the filter counts it."""
    q = attitude_at(found.t, true.t, true.q_ned_frd)
    phi = quaternion.log(quaternion.multiply(q, quaternion.conjugate(found.q_ned_frd)))
    return np.hstack(
        [
            phi,
            at(found.t, true.t, true.velocity) - found.velocity,
            at(found.t, true.t, true.position) - found.position,
            BIAS - found.gyro_bias,
            OFFSET - found.accel_bias,
        ]
    )


def test_it_converges_to_the_truth_and_knows_how_far_it_is_off() -> None:
    nees, last = [], []
    for seed in range(3):
        flight, true = flown(seed)
        found = ekf.estimate(flight, ekf.set_up(flight))
        error = errors(found, true)
        settled = found.t > 40
        assert np.degrees(np.abs(error[settled, :2])).max() < 1.5
        assert np.degrees(np.abs(error[settled, 2])).max() < 6.0
        assert np.abs(error[settled, 6:9]).max() < 2.0
        nav = error[settled, :9]
        covariance = found.covariance[settled, :9, :9]
        nees.append(float(np.mean(np.einsum("ki,ki->k", nav, np.linalg.solve(covariance, nav[..., None])[..., 0]))))
        last.append(error[-1, 9:11])
        assert found.resets == ()
    assert 4.0 < np.mean(nees) < 14.0, "9 states"
    assert np.abs(np.mean(last, axis=0)).max() < 1.5e-3, "the gyro's biases about the level axes"


def test_an_untouched_flight_stays_as_it_is() -> None:
    flight, true = flown()
    after = replaced(flight, ekf.estimate(flight, ekf.set_up(flight)))
    assert after.attitude
    assert after.position
    assert after.attitude.rates.shape == (len(after.attitude), 3)
    off = at(after.position.t, true.t, true.position) - after.position.position
    assert np.sqrt((off**2).mean()) < 1.0
    assert after.imus == flight.imus


def test_a_gyro_bias_is_learned_and_taken_off_the_rates() -> None:
    flight, _ = flown()
    known = ekf.set_up(flight)
    before = replaced(flight, ekf.estimate(flight, known))
    imu = flight.imu()
    biased = replace(imu, gyro=imu.gyro + np.array([0.02, 0, 0]) * (imu.t > 50)[:, None])
    wrong = replace(flight, imus={"RAW_IMU": biased})
    after = replaced(wrong, ekf.estimate(wrong, known))
    assert after.biases[0].gyro[-1] - before.biases[0].gyro[-1] == pytest.approx([0.02, 0, 0], abs=3e-3)
    assert after.attitude
    assert before.attitude
    late = after.attitude.t > 100
    assert after.attitude.rates[late].mean(axis=0) == pytest.approx(before.attitude.rates[late].mean(axis=0), abs=3e-3)
    moved = shifted(wrong, flight, before, after)
    assert moved.attitude
    assert np.abs(
        quaternion.log(
            quaternion.multiply(
                moved.attitude.q_ned_frd,
                quaternion.conjugate(attitude_at(moved.attitude.t, after.attitude.t, after.attitude.q_ned_frd)),
            )
        )
    ).max() < np.radians(6)


def test_a_gps_jump_beyond_the_gate_is_refused_and_reset_to_in_the_end() -> None:
    flight, _ = flown()
    known = ekf.set_up(flight)
    gps = flight.gps[0]
    moved = replace(gps, latitude=gps.latitude + (gps.t > 60) * 100 / 6_371_000)
    found = ekf.estimate(replace(flight, gps=(moved,)), known)
    (reset,) = [r for r in found.resets if r.kind == "position"]
    assert reset.t == pytest.approx(67, abs=0.5)
    clean = ekf.estimate(flight, known)
    assert found.position[-1, 0] - clean.position[-1, 0] == pytest.approx(100, abs=1.0)
    between = (found.t > 61) & (found.t < 66)
    assert np.abs(found.position[between, 0] - clean.position[between, 0]).max() < 3


def test_a_flight_without_gps_or_compass_is_told() -> None:
    flight, _ = flown()
    with pytest.raises(DataError, match="GPS or compass"):
        ekf.set_up(replace(flight, gps=()))
    with pytest.raises(DataError, match="GPS or compass"):
        ekf.set_up(replace(flight, compasses=()))
