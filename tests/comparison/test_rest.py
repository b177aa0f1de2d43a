"""Where a vehicle stood still, and where it only seemed to."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import companion as c
from companion.comparison import GENERIC, Rest, rests
from companion.comparison.alignment import why_none
from companion.model import STANDARD_GRAVITY, Event, Flight, PositionTrack
from companion.strapdown import ImuModel, Motion, Sensor, motions, quaternion, simulate
from tests.flights import flight_of, seconds
from tests.recordings import BUNDLED, recording

BIAS = np.array([3e-3, -2e-3, 1e-3])
NOISY = ImuModel(
    gyro=Sensor(GENERIC.gyro.noise_density, bias=BIAS),
    accel=Sensor(GENERIC.accel.noise_density),
)


def rest_then_motion(rest_s: float = 10.0, rate: float = 100.0) -> Motion:
    """Still, then coning from the attitude that it has there."""
    t = seconds(rest_s + 40.0, rate)
    moving = motions.coning(t[t >= t[0] + rest_s], angle=0.3, frequency=0.3)
    still = t < t[0] + rest_s
    q0, p0 = moving.q_ned_frd[0], moving.position[0]
    count = int(still.sum())
    down = np.array([0.0, 0.0, -STANDARD_GRAVITY])
    force = quaternion.rotate(quaternion.conjugate(q0), down)
    parts: dict[str, Any] = {
        "t": t,
        "q_ned_frd": np.concatenate([np.tile(q0, (count, 1)), moving.q_ned_frd]),
        "velocity": np.concatenate([np.zeros((count, 3)), moving.velocity]),
        "position": np.concatenate([np.tile(p0, (count, 1)), moving.position]),
        "gyro": np.concatenate([np.zeros((count, 3)), moving.gyro]),
        "accel": np.concatenate([np.tile(force, (count, 1)), moving.accel]),
    }
    return replace(moving, **parts)


def found(flight: Flight) -> tuple[Rest, ...]:
    return rests(flight, flight.imu(), GENERIC)


def noisy(motion: Motion, model: ImuModel = NOISY, **changes: Any) -> Flight:
    imu = replace(simulate(motion.imu, model, 1), source="RAW_IMU")
    return replace(flight_of(motion, every=2), imus={"RAW_IMU": imu}, **changes)


def test_rest_before_the_flight() -> None:
    flight = noisy(rest_then_motion())
    (one,) = found(flight)
    assert one.start_s == pytest.approx(flight.start, abs=0.6)
    assert one.end_s == pytest.approx(flight.start + 10, abs=0.6)
    assert (np.abs(one.gyro - BIAS) < 4 * one.gyro_sigma).all()
    assert one.gyro_noise == pytest.approx(GENERIC.gyro.noise_density, rel=0.4)
    assert one.accel_noise == pytest.approx(GENERIC.accel.noise_density, rel=0.4)


def test_even_flight_is_no_rest() -> None:
    """What the IMU feels is the same: only the autopilot's velocity tells."""
    motion = motions.rest(seconds(30, 100))
    flight = noisy(motion)
    assert len(found(flight)) == 1
    assert flight.position
    gliding = PositionTrack(
        flight.position.t,
        flight.position.position + [8.0, 0, 0] * flight.position.t[:, None],
        np.tile([8.0, 0, 0], (len(flight.position), 1)),
    )
    gone = replace(flight, position=gliding)
    assert not found(gone)
    assert "moving or in the air" in why_none(gone, gone.imu(), GENERIC)


def test_a_smooth_hover_is_no_rest() -> None:
    """Armed, and no quieter than the rest of the flight."""
    flight = noisy(motions.rest(seconds(30, 100)), events=(Event(5.0, "armed", "armed"),))
    assert not found(flight)


def test_a_bias_that_is_switched_on_ends_a_rest() -> None:
    flight = noisy(rest_then_motion(20.0))
    imu = flight.imu()
    late = imu.t > imu.t[0] + 10
    stepped = replace(imu, gyro=imu.gyro + 0.01 * late[:, None])
    before, after = found(replace(flight, imus={"RAW_IMU": stepped}))
    assert after.gyro - before.gyro == pytest.approx([0.01] * 3, abs=2e-4)
    assert before.end_s <= imu.t[0] + 10.6


def test_noise_below_a_step_is_not_made_up() -> None:
    coarse = replace(NOISY, gyro=replace(NOISY.gyro, step=0.02, bias=np.full(3, 0.01)))
    (one,) = found(noisy(rest_then_motion(), coarse))
    assert one.gyro_noise is None
    assert one.accel_noise is not None
    assert (one.gyro_sigma >= 0.01).all(), "a reading of zero is anything within a step"


def test_rest_of_recordings() -> None:
    """At rest until just after arming, in the air, and at rest again: the hover in between is smoother than a bench."""
    flight = c.open_log(BUNDLED / "copter-demo-100hz.tlog")[0]
    before, after = found(flight)
    assert before.end_s == pytest.approx(74.8, abs=1.0)
    assert after.start_s == pytest.approx(158.8, abs=1.0)


@pytest.mark.parametrize("log", ["sitl/copter-hover-nodrift-100hz.tlog", "px4/px4_hover.tlog"])
def test_a_hover_of_a_recording_is_no_rest(log: str) -> None:
    flight = c.open_log(recording(log))[0]
    armed, disarmed = (next((e.t for e in flight.events if e.kind == kind), np.inf) for kind in ("armed", "disarmed"))
    assert armed < np.inf
    for rest in found(flight):
        assert rest.end_s < armed + 5 or rest.start_s > disarmed - 3


def test_a_boat_at_its_moorings_does_not_rest() -> None:
    flight = c.open_log(recording("public/clydemcqueen__ardusub_log_tools__small.tlog"))[0]
    assert not found(flight)
