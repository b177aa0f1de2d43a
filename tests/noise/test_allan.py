"""Allan deviation: allantools is the oracle, noise of known figures the law."""

from __future__ import annotations

import numpy as np
import pytest

from companion.model import Array
from companion.noise import Coefficient, NoiseFigures, allan_deviation, noise_figures
from companion.noise.allan import nonnegative_least_squares

N, K = 1e-4, 2e-5  # u/√Hz, u/√s


def readings(seconds: float, rate: float, seed: int, white: float = N, walk: float = K) -> Array:
    rng = np.random.default_rng(seed)
    n = round(seconds * rate)
    noise = white * np.sqrt(rate) * rng.standard_normal((n, 3))
    return np.asarray(noise + walk / np.sqrt(rate) * np.cumsum(rng.standard_normal((n, 3)), axis=0))


def several(count: int, seconds: float, rate: float, **figures: float) -> list[NoiseFigures]:
    fits = []
    for seed in range(count):
        found = allan_deviation(readings(seconds, rate, seed, **figures), rate)
        assert found is not None
        fits += [fit for axis in range(3) if (fit := noise_figures(found, axis)) is not None]
    assert len(fits) == 3 * count
    return fits


def holds(coefficients: list[Coefficient], truth: float) -> float:
    return float(np.mean([c.low <= truth <= c.high for c in coefficients]))


def test_the_deviation_is_allantools() -> None:
    import allantools  # noqa: PLC0415  (takes half a second, for SciPy's statistics)

    values = readings(300.0, 50.0, 1)
    found = allan_deviation(values, 50.0)
    assert found is not None
    for axis in range(3):
        tau, deviation, _, _ = allantools.oadev(values[:, axis], rate=50.0, data_type="freq", taus=found.tau)
        np.testing.assert_allclose(found.tau, tau)
        np.testing.assert_allclose(found.deviation[:, axis], deviation, rtol=1e-6)
    freedom = [min(allantools.edf_simple(15001, round(t * 50.0), alpha) for alpha in (0, -2)) for t in found.tau]
    np.testing.assert_allclose(found.freedom, freedom)
    low, high = found.interval
    assert (low < found.deviation).all()
    assert (found.deviation < high).all()


@pytest.mark.parametrize(("seconds", "rate"), [(120.0, 100.0), (600.0, 100.0), (1800.0, 4.0)])
def test_white_noise_is_within_five_percent_and_its_interval_holds_it(seconds: float, rate: float) -> None:
    found = [fit.white for fit in several(15, seconds, rate)]
    assert all(c.value == pytest.approx(N, rel=0.05) for c in found)
    assert holds(found, N) >= 0.9


def test_what_the_steps_of_the_readings_add_is_no_noise_of_the_sensor() -> None:
    rate, step = 100.0, 2.0 * N * 10.0  # two standard deviations of a sample
    found = allan_deviation(np.round(readings(600.0, rate, 3, walk=0.0) / step) * step, rate)
    assert found is not None
    for axis in range(3):
        plain, fit = noise_figures(found, axis), noise_figures(found, axis, grid=step**2 / (12.0 * rate))
        assert plain is not None
        assert fit is not None
        assert plain.white.value == pytest.approx(N * np.sqrt(4.0 / 3.0), rel=0.03)
        assert fit.white.value == pytest.approx(N, rel=0.03)


def test_the_figures_are_those_of_allantools_curve() -> None:
    """N and K read off allantools' own deviation where each of them rules, within 5 %."""
    import allantools  # noqa: PLC0415

    rate, values = 50.0, readings(3600.0, 50.0, 5, walk=1e-4)
    found = allan_deviation(values, rate)
    assert found is not None
    for axis in range(3):
        fit = noise_figures(found, axis)
        assert fit is not None
        tau, deviation, _, _ = allantools.oadev(values[:, axis], rate=rate, data_type="freq", taus=[0.1, 30.0])
        assert fit.white.value == pytest.approx(deviation[0] * np.sqrt(tau[0]), rel=0.05)
        assert fit.walk.value == pytest.approx(deviation[1] * np.sqrt(3.0 / tau[1]), rel=0.05)


def test_a_walk_is_found_where_the_rest_is_long_enough() -> None:
    long = [fit.walk for fit in several(10, 3600.0, 10.0)]
    assert np.median([c.most for c in long]) == pytest.approx(K, rel=0.1)
    assert all(c.value is not None for c in long)
    assert holds(long, K) >= 0.9


def test_a_short_rest_gives_bounds() -> None:
    short = several(15, 30.0, 100.0)
    assert all(fit.walk.value is None and fit.instability.value is None for fit in short)
    assert holds([fit.walk for fit in short], K) == 1.0


def flicker(count: int, rate: float, instability: float, seed: int) -> Array:
    """Noise (count, 3) of the two-sided density B² / 2πf (IEEE Std 952, C.4), by Timmer & König 1995."""
    rng = np.random.default_rng(seed)
    f = np.fft.rfftfreq(2 * count, 1.0 / rate)
    f[0] = np.inf
    phasors = rng.standard_normal((len(f), 3)) + 1j * rng.standard_normal((len(f), 3))
    spectrum = phasors * (instability * np.sqrt(rate * 2 * count / (4.0 * np.pi * f)))[:, None]
    return np.asarray(np.fft.irfft(spectrum, axis=0)[:count])


def test_a_flicker_floor_is_the_bias_instability() -> None:
    rate, floor = 10.0, 1e-4
    drifting = readings(3600.0, rate, 6, walk=0.0) + flicker(36000, rate, floor, 7)
    found = allan_deviation(drifting, rate)
    assert found is not None
    for axis in range(3):
        fit = noise_figures(found, axis)
        assert fit is not None
        assert fit.instability.value == pytest.approx(floor, rel=0.15)
        assert fit.white.value == pytest.approx(N, rel=0.05)


def test_an_axis_that_never_changes_has_no_figures() -> None:
    found = allan_deviation(np.full((1000, 3), 0.45), 100.0)
    assert found is not None
    assert noise_figures(found, 0) is None
    assert allan_deviation(np.zeros((20, 3)), 100.0) is None


@pytest.mark.parametrize("seed", range(20))
def test_what_is_not_negative_is_what_scipy_finds(seed: int) -> None:
    from scipy.optimize import nnls  # noqa: PLC0415  (slow to import)

    rng = np.random.default_rng(seed)
    columns, values = rng.normal(size=(12, 3)), rng.normal(size=12)
    np.testing.assert_allclose(nonnegative_least_squares(columns, values), nnls(columns, values)[0], atol=1e-12)
