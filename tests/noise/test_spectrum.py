"""Spectra: scipy's Welch is the oracle where there is no gap, Parseval's theorem the law."""

from __future__ import annotations

import numpy as np
import pytest

from companion.model import ImuTrack
from companion.noise import folded_onto, imu_spectrum, peaks, vibration
from companion.noise.spectrum import neighbourhoods, periodograms

GAP = 0.1


def noise(seconds: float, rate: float, density: float, seed: int = 1) -> ImuTrack:
    """White noise of a density, u/√Hz in Kalibr's convention, on both sensors."""
    n = round(seconds * rate)
    values = np.random.default_rng(seed).normal(0.0, density * np.sqrt(rate), (2, n, 3))
    return ImuTrack(np.arange(n) / rate, values[0], values[1])


def test_a_track_without_gaps_has_scipys_spectrum() -> None:
    import scipy.signal  # noqa: PLC0415  (slow to import, and every process of the tests collects this file)

    track = noise(100.0, 128.0, 1e-3)
    found = imu_spectrum(track, GAP)
    assert found is not None
    f, density = scipy.signal.welch(track.gyro, 128.0, nperseg=512, axis=0)
    np.testing.assert_allclose(found.frequency_hz, f)
    np.testing.assert_allclose(found.gyro, density, rtol=1e-9, atol=1e-20)


@pytest.mark.parametrize("window", ["hann", "blackmanharris"])
@pytest.mark.parametrize("length", [32, 33])
def test_every_window_and_length_has_scipys_periodogram(window: str, length: int) -> None:
    import scipy.signal  # noqa: PLC0415

    values = np.random.default_rng(1).normal(2.0, 1.0, (50, 3))
    begin = np.array([0, 11])
    parts = np.stack([values[:length], values[11 : 11 + length]])
    _, density = scipy.signal.periodogram(parts, 40.0, window=window, detrend="constant", axis=1)
    np.testing.assert_allclose(periodograms(values, begin, 40.0, length, window), density, rtol=1e-9, atol=1e-20)


def test_white_noise_has_its_density_at_every_frequency() -> None:
    spectrum = imu_spectrum(noise(300, 100, 2e-3), GAP)
    assert spectrum is not None
    assert spectrum.segments > 100
    np.testing.assert_allclose(np.sqrt(0.5 * spectrum.gyro[1:-1].mean(axis=0)), 2e-3, rtol=0.03)
    assert spectrum.frequency_hz[-1] == pytest.approx(50.0)


def test_no_segment_lies_across_a_gap() -> None:
    whole = noise(60, 100, 1e-3)
    kept = np.flatnonzero((whole.t < 20) | (whole.t > 31))
    broken = ImuTrack(whole.t[kept], whole.gyro[kept] + 5.0 * (whole.t[kept] > 25)[:, None], whole.accel[kept])
    spectrum = imu_spectrum(broken, GAP)
    assert spectrum is not None
    assert spectrum.gyro.max() < 2e-5  # the step of 5 rad/s over the gap is in no segment
    assert imu_spectrum(whole[:20], GAP) is None


def test_a_line_in_the_spectrum_is_found_with_its_size_and_its_aliases() -> None:
    quiet = noise(60.0, 100.0, 1e-3)
    shaken = quiet.accel.copy()
    shaken[:, 1] += 0.3 * np.sqrt(2) * np.sin(2 * np.pi * 83.0 * quiet.t)  # folded down to 17 Hz
    track = ImuTrack(quiet.t, quiet.gyro, shaken)
    spectrum = imu_spectrum(track, GAP)
    assert spectrum is not None
    (peak,) = peaks(spectrum, spectrum.accel)
    assert peak.axis == 1
    assert peak.frequency_hz == pytest.approx(17.0, abs=0.3)
    assert peak.amplitude == pytest.approx(0.3, rel=0.05)
    assert folded_onto(peak.frequency_hz, 100.0)[0] == pytest.approx(83.0, abs=0.3)
    assert not peaks(spectrum, spectrum.gyro)


def test_vibration_leaves_the_flown_motion_out() -> None:
    t = np.arange(6000) / 200
    accel = np.zeros((len(t), 3))
    accel[:, 0] = 5.0 * np.sin(2 * np.pi * 0.3 * t)
    accel[:, 2] = -9.80665 + 3.0 * np.sqrt(2) * np.sin(2 * np.pi * 37.0 * t)
    found = vibration(ImuTrack(t, np.zeros_like(accel), accel), GAP)
    assert found is not None
    assert found.accel[:, 0].max() < 0.1
    np.testing.assert_allclose(found.accel[:, 2], 3.0, rtol=0.05)
    assert found.t[0] < 1.5
    assert found.t[-1] > 28
    assert vibration(ImuTrack(t[::20], accel[::20], accel[::20]), GAP) is None


@pytest.mark.parametrize("begin", [9.0, 9.3, 9.75])
def test_vibration_is_told_at_the_time_of_the_shaking(begin: float) -> None:
    """A second of it: the mean time, by power, is its middle."""
    t = np.arange(4000) / 200
    accel = np.zeros((len(t), 3))
    accel[:, 1] = np.where((t >= begin) & (t < begin + 1.0), 4.0 * np.sin(2 * np.pi * 60.0 * t), 0.0)
    found = vibration(ImuTrack(t, np.zeros_like(accel), accel), GAP)
    assert found is not None
    assert np.average(found.t, weights=found.accel[:, 1] ** 2) == pytest.approx(begin + 0.5, abs=0.02)


@pytest.mark.parametrize("size", [1, 3, 9])
def test_neighbourhoods_are_those_of_scipys_filters(size: int) -> None:
    import scipy.ndimage  # noqa: PLC0415

    values = np.random.default_rng(2).normal(size=(40, 2))
    for axis in range(2):
        of_scipy = scipy.ndimage.median_filter(values[:, axis], size=size, mode="nearest")
        np.testing.assert_array_equal(np.median(neighbourhoods(values, size), axis=-1)[:, axis], of_scipy)
