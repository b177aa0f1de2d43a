"""White noise of known density, through filters, means and rates, at rest and in motion: within 15 %."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from companion.model import Array, ImuTrack
from companion.noise import Sampling, confirmed_sampling, folded_gain, quantisation_bound, sampling_of, white_noise
from companion.noise.noise_density import aliasing
from companion.simulate import fly
from companion.strapdown import ImuModel, Sensor

pytestmark = pytest.mark.slow

GYRO, ACCEL = 1e-4, 1.5e-3  # rad/s/√Hz, m/s²/√Hz
LOOP_HZ = 400
GAP = 0.1


@cache
def flown(motion: str, filter_hz: float) -> ImuTrack:
    model = ImuModel(gyro=Sensor(GYRO), accel=Sensor(ACCEL))
    return fly(200.0, motion=motion, model=model, filter_hz=filter_hz, seed=3).imu


def recorded(motion: str, filter_hz: float, rate: int, *, told: bool = True) -> ImuTrack:
    """Every n-th sample, as autopilots send them."""
    every, whole = LOOP_HZ // rate, flown(motion, filter_hz)
    return replace(
        whole,
        t=whole.t[::every],
        gyro=whole.gyro[::every],
        accel=whole.accel[::every],
        gyro_low_pass_hz=filter_hz if told else None,
    )


@pytest.mark.parametrize("rate", [25, 100, 400])
@pytest.mark.parametrize("motion", ["rest", "circle", "square", "coning"])
def test_the_density_behind_a_low_pass(motion: str, rate: int) -> None:
    track = recorded(motion, 20.0, rate)
    for sensor, truth in (("gyro", GYRO), ("accel", ACCEL)):
        found = white_noise(track, sensor, GAP)  # type: ignore[arg-type]
        assert found is not None
        assert found.sensor is not None
        np.testing.assert_allclose(found.sensor, truth, rtol=0.15)
        folded = np.sqrt(folded_gain(np.zeros(1), rate, sampling_of(track))[0])
        np.testing.assert_allclose(found.sampled, truth * folded, rtol=0.15)


@pytest.mark.parametrize("rate", [25, 100, 400])
@pytest.mark.parametrize("motion", ["rest", "circle", "square", "coning"])
def test_the_density_of_readings_that_nothing_filters(motion: str, rate: int) -> None:
    """An instant's reading of a 400 Hz sensor carries all of its noise: at 25 Hz, four times the density."""
    track = recorded(motion, 0.0, rate)
    for sensor, truth in (("gyro", GYRO), ("accel", ACCEL)):
        found = white_noise(track, sensor, GAP)  # type: ignore[arg-type]
        assert found is not None
        np.testing.assert_allclose(found.sampled, truth * np.sqrt(LOOP_HZ / rate), rtol=0.15)
        assert found.sensor is None, "what the samples do not tell is not made up"


@pytest.mark.parametrize("rate", [100, 400])
def test_a_filter_that_the_log_does_not_tell_changes_little(rate: int) -> None:
    found = white_noise(recorded("square", 20.0, rate, told=False), "accel", GAP)
    assert found is not None
    np.testing.assert_allclose(found.sampled, ACCEL, rtol=0.15)


@pytest.mark.parametrize("every", [4, 16])
def test_means_over_the_interval_have_the_sensors_density(every: int) -> None:
    whole = flown("rest", 0.0)
    count = len(whole) // every * every

    def mean(values: Array) -> Array:
        return np.asarray(values[:count].reshape(-1, every, 3).mean(axis=1))

    t = whole.t[:count:every]
    track = ImuTrack(t, mean(whole.gyro), mean(whole.accel), interval=np.full(len(t), every / LOOP_HZ))
    found = white_noise(track, "gyro", GAP)
    assert found is not None
    assert found.sensor is not None
    np.testing.assert_allclose(found.sensor, GYRO, rtol=0.15)
    np.testing.assert_allclose(found.sampled, GYRO, rtol=0.15)
    assert confirmed_sampling(track, GAP) == sampling_of(track), "a mean leaves white noise white"


@pytest.mark.parametrize("rate", [100, 400])
def test_the_spectrum_confirms_what_the_log_says(rate: int) -> None:
    assert confirmed_sampling(recorded("rest", 20.0, rate), GAP).confirmed is True
    wrong = replace(recorded("rest", 0.0, rate), gyro_low_pass_hz=20.0)
    assert confirmed_sampling(wrong, GAP).confirmed is False
    untold = confirmed_sampling(recorded("rest", 20.0, rate, told=False), GAP)
    assert (untold.kind, untold.source) == ("filtered", "spectrum")
    assert untold.corner_hz == pytest.approx(20.0, rel=0.1)
    assert confirmed_sampling(recorded("rest", 0.0, rate), GAP).kind == "point"


def test_at_a_low_rate_the_log_is_taken_at_its_word() -> None:
    assert confirmed_sampling(recorded("rest", 20.0, 25), GAP).confirmed is None


def test_what_folds_is_what_the_filter_passes() -> None:
    """Parseval: all of the filter's noise is in the samples, whatever the rate."""
    for rate in (4.0, 25.0, 100.0):
        f = np.linspace(0.0, rate / 2, 4001)
        total = 2.0 * np.trapezoid(folded_gain(f, rate, Sampling("filtered", corner_hz=20.0)), f)
        assert total == pytest.approx(np.pi / np.sqrt(2.0) * 20.0, rel=2e-3)
    f = np.linspace(0.0, 12.5, 101)
    np.testing.assert_allclose(folded_gain(f, 25.0, Sampling("averaged", interval_s=0.04)), 1.0, rtol=2e-3)


def test_vibration_in_a_part_of_the_band_and_of_the_time_is_not_noise() -> None:
    track = recorded("rest", 0.0, 100)
    shaking = 0.5 * np.sin(2 * np.pi * 8.5 * track.t) + 3.0 * np.sin(2 * np.pi * 5.0 * track.t) * (track.t < 10)
    found = white_noise(replace(track, accel=track.accel + shaking[:, None]), "accel", GAP)
    assert found is not None
    np.testing.assert_allclose(found.sampled, 2 * ACCEL, rtol=0.15)


@pytest.mark.parametrize("rate", [2.0, 4.0])
def test_a_low_rate_tells_nothing_in_flight(rate: float) -> None:
    t = np.arange(600) / rate
    assert white_noise(ImuTrack(t, np.zeros((600, 3)), np.zeros((600, 3))), "gyro", 1.0) is None


@pytest.mark.parametrize("spread", [0.1, 0.2, 0.3])
@pytest.mark.parametrize("mean", [0.0, 0.3, 4.0, 4.3, 4.5])
def test_noise_below_quantisation_is_bounded(spread: float, mean: float) -> None:
    """Cut towards zero, in steps of 1: never less than the truth where it says that the steps hide it."""
    readings = np.trunc(mean + spread * np.random.default_rng(2).standard_normal(5000))
    bound = quantisation_bound(readings, 1.0, 100.0, Sampling("point"))
    assert bound is not None
    assert spread / 10.0 <= bound < 0.1
    assert quantisation_bound(readings, 0.0, 100.0, Sampling("point")) is None


def test_noise_of_several_steps_is_not_hidden() -> None:
    readings = np.trunc(1000.0 + 2.0 * np.random.default_rng(2).standard_normal(5000))
    assert quantisation_bound(readings, 1.0, 100.0, Sampling("point")) is None


@pytest.mark.parametrize("frequency_hz", [0.1, 0.3, 0.7, 1.2, 1.7])
def test_turns_between_samples_pass_for_no_scale_error(frequency_hz: float) -> None:
    """A straight line from one sample to the next cuts off what turns meanwhile: as much as is stated, or less."""
    rate, t = 4.0, np.arange(0.0, 200.0, 0.25)
    wander = 2.0 * np.pi * frequency_hz * t + np.cumsum(np.random.default_rng(1).normal(0.0, 0.2, len(t)))
    track = _turning(t, np.sin(wander))
    between = np.arange(0.0, 1.0, 0.02)
    fine = np.interp((t[:-1, None] + between / rate).ravel(), t, wander).reshape(len(t) - 1, -1)
    true, lines = np.sin(fine).mean(axis=1), 0.5 * (track.gyro[1:, 0] + track.gyro[:-1, 0])
    missing = 1.0 - true @ lines / (true @ true)
    stated = aliasing(track, np.arange(len(t)), 1.0)["gyro_scale"].lasting
    assert missing < 2.0 * stated + 0.001


def test_what_is_sampled_fast_enough_hides_no_scale_error() -> None:
    t = np.arange(0.0, 100.0, 0.01)
    noise = np.random.default_rng(1).normal(0.0, 0.05, len(t))
    track = _turning(t, np.sin(2.0 * np.pi * 1.2 * t) + noise)
    assert aliasing(track, np.arange(0, len(t), 20), 1.0)["gyro_scale"].lasting < 0.005


def test_a_touch_of_the_ground_hides_no_scale_error() -> None:
    t = np.arange(0.0, 100.0, 0.02)
    track = _turning(t, np.zeros(len(t)))
    accel = track.accel.copy()
    accel[-5:-3] += 150.0
    assert aliasing(replace(track, accel=accel), np.arange(0, len(t), 10), 1.0)["accel_scale"].lasting < 0.005


@pytest.mark.parametrize("rate_hz", [25.0, 100.0, 400.0])
def test_a_line_of_vibration_may_beat_as_strongly_as_it_is_and_noise_does_not(rate_hz: float) -> None:
    t = np.arange(0.0, 100.0, 1.0 / rate_hz)
    noise = np.random.default_rng(1).normal(0.0, 0.05, len(t))
    line = 0.05 * np.sqrt(2.0) * np.sin(2.0 * np.pi * 135.7 * t)
    for shaken, least, most in ((noise, 0.0, 0.01), (noise + line, 0.04, 0.055)):
        stated = aliasing(_turning(t, shaken), np.arange(0, len(t), 20), 1.0)["gyro_bias"].beating
        assert least <= stated <= most


def _turning(t: Array, rate: Array) -> ImuTrack:
    """About x."""
    still = np.zeros((len(t), 3))
    return ImuTrack(source="RAW_IMU", t=t, gyro=still + rate[:, None] * [1.0, 0.0, 0.0], accel=still - [0.0, 0.0, 9.8])


def test_either_sensor_has_its_own_low_pass() -> None:
    """ArduPilot's INS_GYRO_FILTER 80 and INS_ACCEL_FILTER 10: at 50 Hz that of the gyro is folded."""
    fast, slow = recorded("rest", 80.0, 50, told=False), recorded("rest", 10.0, 50, told=False)
    track = replace(fast, accel=slow.accel, gyro_low_pass_hz=80.0, accel_low_pass_hz=10.0)
    gyro, accel = white_noise(track, "gyro", GAP), white_noise(track, "accel", GAP)
    assert gyro is not None
    assert accel is not None
    assert gyro.sensor is not None
    assert accel.sensor is not None
    np.testing.assert_allclose(gyro.sensor, GYRO, rtol=0.15)
    np.testing.assert_allclose(accel.sensor, ACCEL, rtol=0.15)
    assert set(aliasing(track, np.arange(0, len(track), 50), GAP)) == {"gyro_bias", "gyro_scale"}
    half_known = replace(track, accel_low_pass_hz=None)
    assert sampling_of(half_known, "accel").corner_hz == 80.0
    assert sampling_of(replace(track, gyro_low_pass_hz=0.0), "gyro").kind == "point"
