"""What is fixed before the smoother iterates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.constants import healthy, num
from companion.estimation.earth_field import field_at
from companion.estimation.setup import guesses, set_up
from companion.model import STANDARD_GRAVITY, Array, CompassTrack, Origin, interpolated
from companion.strapdown import quaternion
from tests.estimation.sensed import EPOCH, PLACE, sensed, with_imu


@pytest.mark.parametrize(
    ("gyro", "accel"), [(10.0, 10.0), (20.0, 20.0), (40.0, None), (4.0, 10.0), (80.0, 10.0), (20.0, 0.0)]
)
def test_readings_behind_a_low_pass_stand_at_the_times_that_they_speak_of(gyro: float, accel: float | None) -> None:
    """Each of the sensors has its own: a rover's gyro is read 34 ms later than its accelerometer. Unknown: the same."""
    import scipy.signal  # noqa: PLC0415  (slow to import, and every process of the tests collects this file)

    flight, truth = sensed(10.0, rate=400.0)

    def slow(t: Array) -> Array:
        return np.outer(np.sin(2.0 * np.pi * 0.2 * t), [1.0, -0.5, 0.2])

    def passed(corner: float) -> Array:
        if corner == 0.0:
            return slow(truth.t)
        return np.asarray(scipy.signal.lfilter(*scipy.signal.butter(2, corner, fs=400.0), slow(truth.t), axis=0))

    imu = replace(flight.imu(), gyro=passed(gyro), accel=passed(gyro if accel is None else accel))
    filtered = replace(imu, gyro_low_pass_hz=gyro, accel_low_pass_hz=accel)
    track = set_up(with_imu(flight, filtered), None, STANDARD_GRAVITY, None).imu
    settled = (track.t > 2.0) & (track.t < 9.8)
    np.testing.assert_allclose(track.gyro[settled], slow(track.t)[settled], atol=3e-3)
    np.testing.assert_allclose(track.accel[settled], slow(track.t)[settled], atol=3e-3)


@pytest.mark.parametrize("path", ["square", "circle", "heave"])
def test_gravity_and_compass_tell_a_manoeuvring_vehicle_where_to_begin(path: str) -> None:
    """What it accelerates by is told by GPS, what it turns by in some seconds by the gyro."""
    flight, truth = sensed(60.0, path)
    setup = set_up(flight, None, STANDARD_GRAVITY, None)
    *_, unaided = guesses(setup, flight)
    guess = unaided.q_ned_frd
    off = quaternion.multiply(guess, quaternion.conjugate(truth.q_ned_frd[setup.index]))
    angle = np.degrees(np.linalg.norm(quaternion.log(off), axis=1))
    assert np.median(angle) < 2.0
    assert angle.max() < 10.0, "GPS has not said anything yet"


def test_keyframes_stand_where_the_fixes_were_taken() -> None:
    """Not where they came: what the IMU has to carry a fix by is what its latency differs from the usual one by."""
    flight, _ = sensed(20.0)
    setup = set_up(flight, None, STANDARD_GRAVITY, None)
    for one in setup.readings:
        if one.name.startswith("gps"):
            apart = one.t - healthy.GPS_LATENCY_S - setup.t[one.keyframe]
            assert np.abs(apart[1:-1]).max() <= 0.5 / setup.imu.rate_hz + 1e-9
            assert len(one.t) >= 45


def test_every_fix_has_its_keyframe() -> None:
    """Whatever the phase of the fixes to the first sample of the IMU."""
    for late in (0.0, 0.03, 0.1, 0.17):
        flight, _ = sensed(20.0, fixes_hz=5.0)
        gps = flight.gps[0]
        setup = set_up(replace(flight, gps=(replace(gps, t=gps.t + late),)), None, STANDARD_GRAVITY, None)
        assert max(len(one.t) for one in setup.readings if one.name.startswith("gps")) >= len(gps) - 2


@pytest.mark.parametrize("path", ["rest", "coning"])
def test_a_quick_compass_is_averaged_as_far_as_the_vehicle_hardly_turns(path: str) -> None:
    """Eleven readings scatter by a third of one; the mean of directions far apart would be too short."""
    flight, truth = sensed(40.0, path)
    earth = field_at(Origin(*PLACE), EPOCH)
    assert earth is not None
    field = quaternion.rotate(quaternion.conjugate(truth.q_ned_frd), np.tile(earth.ned, (len(truth.t), 1)))
    read = (field + 2e-6 * np.random.default_rng(1).standard_normal(field.shape))[::2]
    quick = replace(flight, compasses=(CompassTrack(truth.t[::2], read, "RAW_IMU"),))
    one = next(r for r in set_up(quick, None, STANDARD_GRAVITY, None).readings if r.name == "compass")
    off = one.value - num.MICROTESLA * interpolated(one.t, truth.t, field)
    assert off.std() < (0.75 if path == "rest" else 1.5)
    size = np.linalg.norm(one.value, axis=1).mean() / (num.MICROTESLA * np.linalg.norm(earth.ned))
    assert size == pytest.approx(1.0, abs=0.01)
