"""The noise of whole flights: rests, flight, and what makes a log tell less."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from companion.comparison import GENERIC, ImuNoise, Limits, imu_noise, noise_model
from companion.model import DataError, Flight, ImuTrack
from companion.simulate.true_flight import LOOP_US, low_pass
from companion.strapdown import ImuModel, Sensor, motions, simulate
from tests.flights import flight_of, seconds

GYRO, ACCEL, WALK = 1e-4, 1.5e-3, 1e-4
MODEL = ImuModel(
    gyro=Sensor(GYRO, bias=np.array([3e-3, -2e-3, 1e-3])),
    accel=Sensor(ACCEL, bias_walk=WALK),
)


def standing(duration: float, rate: float, model: ImuModel = MODEL, **changes: Any) -> Flight:
    motion = motions.rest(seconds(duration, rate))
    imu = replace(simulate(motion.imu, model, 1), source="RAW_IMU")
    return replace(flight_of(motion, every=2), imus={"RAW_IMU": imu}, **changes)


def flying(duration: float, rate: float, model: ImuModel = MODEL) -> Flight:
    motion = motions.coning(seconds(duration, rate), angle=0.3, frequency=0.3)
    imu = replace(simulate(motion.imu, model, 1), source="RAW_IMU")
    return replace(flight_of(motion, every=2), imus={"RAW_IMU": imu})


def noise(flight: Flight) -> ImuNoise:
    return imu_noise(flight, "RAW_IMU", GENERIC, Limits())


def test_a_long_rest_tells_its_noise_and_bounds_the_rest() -> None:
    found = noise(standing(200.0, 50.0))
    assert found.rest is not None
    for axis in found.rest.gyro_axes:
        assert axis is not None
        assert axis.white.value == pytest.approx(GYRO, rel=0.05)
        assert axis.walk is not None
        assert axis.walk.value is None
    gyro, accel = noise_model(found)
    assert gyro.white.value == pytest.approx(GYRO, rel=0.07)
    assert gyro.white.measured
    assert accel.white.value == pytest.approx(ACCEL, rel=0.07)
    assert not found.notes


def test_a_walk_that_shows_is_in_the_model() -> None:
    walking = replace(MODEL, accel=replace(MODEL.accel, bias_walk=2e-3))
    found = noise(standing(240.0, 25.0, walking))
    _, accel = noise_model(found)
    assert accel.walk.measured
    assert 1e-3 < accel.walk.value < 5e-3, "the worst of three axes"


def test_the_spectrum_confirms_the_low_pass_of_either_sensor() -> None:
    """ArduPilot's INS_GYRO_FILTER 80 and INS_ACCEL_FILTER 10: they are not held to one corner."""
    flight = standing(40.0, 1e6 / LOOP_US)
    imu = flight.imus["RAW_IMU"]
    gyro, accel = low_pass(imu.gyro, 80.0), low_pass(imu.accel, 10.0)
    filtered = replace(imu, gyro=gyro, accel=accel, gyro_low_pass_hz=80.0, accel_low_pass_hz=10.0)
    found = noise(replace(flight, imus={"RAW_IMU": filtered}))
    assert (found.sampling.corner_hz, found.accel_sampling.corner_hz) == (80.0, 10.0)
    assert found.sampling.confirmed
    assert found.accel_sampling.confirmed
    assert not any("low-pass" in note for note in found.notes)


@pytest.mark.parametrize("reads", [0.0, 0.01])
def test_a_gyro_that_is_stuck_in_flight_has_the_noise_of_its_data_sheet(reads: float) -> None:
    """Not one of nothing, which no filter could use and no IMU model may have."""
    flight = flying(60.0, 100.0)
    imu = flight.imus["RAW_IMU"]
    found = noise(replace(flight, imus={"RAW_IMU": replace(imu, gyro=np.full_like(imu.gyro, reads))}))
    gyro, accel = noise_model(found)
    assert (gyro.white.value, gyro.white.measured) == (GENERIC.gyro.noise_density, False)
    assert accel.white.measured


def test_a_short_rest_is_used_and_said() -> None:
    found = noise(standing(40.0, 100.0))
    assert found.rest is not None
    assert found.rest.duration_s == pytest.approx(40.0, abs=2.0)
    assert any("no rest of 120 s" in note for note in found.notes)
    white = found.rest.gyro_axes[0]
    assert white is not None
    assert white.white.value == pytest.approx(GYRO, rel=0.1)


def test_a_flight_without_rest_has_its_spectrum() -> None:
    found = noise(flying(60.0, 100.0))
    assert found.rest is None
    assert any("no rest of 10 s" in note for note in found.notes)
    assert found.flight is not None
    assert found.flight.gyro is not None
    np.testing.assert_allclose(found.flight.gyro.sampled, GYRO, rtol=0.15)
    gyro, _ = noise_model(found)
    assert "in flight" in gyro.white.source
    assert not gyro.walk.measured
    assert gyro.walk.value == GENERIC.gyro.bias_walk


def test_readings_that_are_all_equal_are_below_quantisation() -> None:
    """The steps are three times what the sensor's noise makes of them: a bound, not zero."""
    coarse = replace(MODEL, gyro=replace(MODEL.gyro, bias=np.full(3, 1.5e-2), step=1e-2))
    found = noise(standing(150.0, 50.0, coarse))
    assert found.rest is not None
    for axis in found.rest.gyro_axes:
        assert axis is not None
        assert axis.hidden
        assert axis.white.value is None
        assert GYRO < axis.white.high < 2e-3
    assert any("gyro x, y, z at rest: below quantisation" in note for note in found.notes)
    gyro, _ = noise_model(found)
    assert not gyro.white.measured
    assert gyro.white.value == GENERIC.gyro.noise_density, "a bound above the data sheet's figure says nothing new"


@pytest.mark.parametrize("rate", [2.0, 4.0])
def test_a_low_rate_tells_its_noise_at_rest_and_nothing_in_flight(rate: float) -> None:
    found = noise(standing(300.0, rate))
    assert found.rest is not None
    axis = found.rest.gyro_axes[0]
    assert axis is not None
    assert axis.white.value == pytest.approx(GYRO, rel=0.15)
    moving = noise(flying(300.0, rate))
    assert moving.flight is None or moving.flight.gyro is None
    assert any("too low" in note for note in moving.notes)


def test_a_short_log_is_refused_with_what_it_has() -> None:
    with pytest.raises(DataError, match=r"RAW_IMU has 201 samples in 2.0 s.*Record"):
        noise(flying(2.0, 100.0))


def test_gaps_cost_no_more_than_what_is_in_them() -> None:
    whole = standing(300.0, 50.0)
    track = whole.imu()
    t = track.t - track.t[0]
    kept = ~((t > 130) & (t < 150)) & (np.random.default_rng(1).random(len(t)) > 0.01)
    broken = ImuTrack(track.t[kept], track.gyro[kept], track.accel[kept], source="RAW_IMU")
    found = noise(replace(whole, imus={"RAW_IMU": broken}))
    assert len(found.rests) == 2, "on either side of the gap"
    for rest in found.rests:
        for axis in rest.gyro_axes:
            assert axis is not None
            assert axis.white.value == pytest.approx(GYRO, rel=0.06)


@pytest.mark.parametrize("jitter", [0.0, 1e-5])
def test_an_axis_that_is_stuck_is_named(jitter: float) -> None:
    whole = standing(150.0, 50.0)
    track = whole.imu()
    gyro = track.gyro.copy()
    gyro[:, 1] = 0.45 + jitter * np.sin(track.t)
    stuck = replace(track, gyro=gyro)
    found = noise(replace(whole, imus={"RAW_IMU": stuck}))
    assert any(note.startswith("gyro y reads 0.4") and "stuck" in note for note in found.notes)
    if found.rest is not None:
        axis = found.rest.gyro_axes[0]
        assert axis is not None
        assert axis.white.value == pytest.approx(GYRO, rel=0.06)


def test_an_imu_that_is_stuck_altogether_gives_no_figures() -> None:
    whole = standing(150.0, 50.0)
    track = whole.imu()
    still = replace(track, gyro=np.zeros_like(track.gyro), accel=np.tile([0.0, 0.0, -9.8], (len(track), 1)))
    found = noise(replace(whole, imus={"RAW_IMU": still}))
    assert sum("stuck" in note for note in found.notes) == 6
    gyro, accel = noise_model(found)
    assert not gyro.white.measured
    assert not accel.white.measured
