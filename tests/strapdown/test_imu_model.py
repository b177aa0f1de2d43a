"""The error model gives back what was put in: densities by Allan deviation, deterministic parts exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.model import STANDARD_GRAVITY, Array, ImuTrack
from companion.strapdown import ImuModel, Sensor, correct, motions, simulate

HOUR = motions.rest(np.arange(360_000) / 100).imu
RNG = np.random.default_rng(8)


def allan_deviation(x: Array, rate: float, tau: float) -> float:
    """Overlapping Allan deviation (IEEE 952-1997, annex C) over all columns at averaging time tau (s)."""
    m = round(tau * rate)
    angle = np.concatenate((np.zeros((1, x.shape[1])), np.cumsum(x, axis=0))) / rate
    second = angle[2 * m :] - 2 * angle[m:-m] + angle[: -2 * m]
    return float(np.sqrt((second**2).mean() / 2) / tau)


def test_no_errors_measure_the_truth() -> None:
    truth = motions.coning(np.linspace(0, 5, 501)).imu
    found = simulate(truth, ImuModel(), 0)
    np.testing.assert_array_equal(found.gyro, truth.gyro)
    np.testing.assert_array_equal(found.accel, truth.accel)


@pytest.mark.parametrize("rate", [10.0, 1000.0])
def test_a_sample_at_rate_r_has_n_root_r(rate: float) -> None:
    truth = motions.rest(np.arange(100_000) / rate).imu
    found = simulate(truth, ImuModel(gyro=Sensor(noise_density=1e-3), accel=Sensor(noise_density=2e-3)), 1)
    np.testing.assert_allclose(found.gyro.std(axis=0), 1e-3 * np.sqrt(rate), rtol=0.02)
    np.testing.assert_allclose((found.accel - truth.accel).std(axis=0), 2e-3 * np.sqrt(rate), rtol=0.02)


def test_irregular_samples_have_the_noise_of_their_own_interval() -> None:
    t = np.cumsum(np.tile([0.001, 0.1], 50_000))
    found = simulate(motions.rest(t).imu, ImuModel(gyro=Sensor(noise_density=1e-3)), 2)
    np.testing.assert_allclose(found.gyro[::2].std(), 1e-3 / np.sqrt(0.001), rtol=0.02)
    np.testing.assert_allclose(found.gyro[1::2].std(), 1e-3 / np.sqrt(0.1), rtol=0.02)


def test_allan_deviation_of_an_hour_gives_back_the_densities() -> None:
    """N/√τ where white noise rules, K √(τ/3) where the walk does; the six axes together are sure to a few percent."""
    noise, walk = 1e-3, 1e-3
    sensor = Sensor(noise_density=noise, bias_walk=walk)
    found = simulate(HOUR, ImuModel(gyro=sensor, accel=sensor), 3)
    errors = np.hstack((found.gyro, found.accel - HOUR.accel))
    assert allan_deviation(errors, 100, 0.02) * np.sqrt(0.02) == pytest.approx(noise, rel=0.05)
    at = 20.0
    assert allan_deviation(errors, 100, at) * np.sqrt(3 / at) == pytest.approx(walk, rel=0.05)


def test_bias_scale_and_misalignment_are_undone_by_correct() -> None:
    truth = motions.coning(np.linspace(0, 5, 501)).imu
    matrix = np.eye(3) + RNG.normal(0, 0.02, (3, 3))
    model = ImuModel(
        gyro=Sensor(bias=np.array([0.01, -0.02, 0.005]), matrix=matrix),
        accel=Sensor(bias=np.array([0.1, 0.2, -0.3]), matrix=matrix.T),
    )
    found = simulate(truth, model, 0)
    np.testing.assert_allclose(found.gyro[7], matrix @ truth.gyro[7] + model.gyro.bias)
    back = correct(found, model)
    np.testing.assert_allclose(back.gyro, truth.gyro, atol=1e-13)
    np.testing.assert_allclose(back.accel, truth.accel, atol=1e-13)


def test_readings_are_cut_towards_zero_as_ardupilot_does() -> None:
    readings = np.array([[0.0019, -0.0019, 0.0009], [0.0021, -0.0009, -0.0039]])
    model = ImuModel(gyro=Sensor(step=1e-3), accel=Sensor(step=STANDARD_GRAVITY / 1000))
    found = simulate(ImuTrack(np.array([0.0, 1.0]), readings, readings), model, 0)
    np.testing.assert_allclose(found.gyro, [[0.001, -0.001, 0.0], [0.002, 0.0, -0.003]])
    assert found.gyro_step == 1e-3


def test_the_cut_takes_half_a_step_on_average_and_spreads_by_a_twelfth() -> None:
    truth = ImuTrack(np.arange(50_000.0), RNG.uniform(0.5, 1.0, (50_000, 3)), np.zeros((50_000, 3)))
    found = simulate(truth, ImuModel(gyro=Sensor(step=0.01)), 0)
    assert (found.gyro - truth.gyro).mean() == pytest.approx(-0.005, rel=0.02)
    assert (found.gyro - truth.gyro).std() == pytest.approx(0.01 / np.sqrt(12.0), rel=0.02)


def test_readings_saturate() -> None:
    truth = motions.coning(np.linspace(0, 5, 501)).imu
    found = simulate(truth, ImuModel(gyro=Sensor(full_scale=1.0)), 0)
    assert np.abs(found.gyro).max() == 1.0
    inside = np.abs(truth.gyro) < 1.0
    np.testing.assert_array_equal(found.gyro[inside], truth.gyro[inside])


def test_the_seed_decides() -> None:
    truth = motions.rest(np.arange(100) / 100.0).imu
    model = ImuModel(gyro=Sensor(noise_density=1e-3, bias_walk=1e-4), accel=Sensor(noise_density=1e-2))
    np.testing.assert_array_equal(simulate(truth, model, 1).gyro, simulate(truth, model, 1).gyro)
    assert (simulate(truth, model, 1).gyro != simulate(truth, model, 2).gyro).all()
    without = replace(model, gyro=Sensor(noise_density=1e-3))
    np.testing.assert_array_equal(simulate(truth, without, 1).accel, simulate(truth, model, 1).accel)


@pytest.mark.parametrize("n", [0, 1])
def test_short_tracks(n: int) -> None:
    truth = motions.rest(np.arange(float(n))).imu
    assert len(simulate(truth, ImuModel(gyro=Sensor(noise_density=1.0)), 0)) == n


@pytest.mark.parametrize(
    ("figures", "message"),
    [
        ({"noise_density": -1.0}, "noise_density must be finite and not negative"),
        ({"step": float("nan")}, "step must be finite"),
        ({"full_scale": 0.0}, "must be positive"),
        ({"bias": np.zeros(2)}, r"bias must be \(3,\)"),
        ({"matrix": np.zeros((3, 3))}, "no inverse"),
        ({"bias": np.full(3, np.inf)}, "must be finite"),
    ],
)
def test_impossible_sensors_are_refused(figures: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Sensor(**figures)  # type: ignore[arg-type]
