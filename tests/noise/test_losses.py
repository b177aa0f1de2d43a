"""What a low-pass, gaps and clipping take of an IMU's signal, and what is given back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.constants import num
from companion.estimation import smooth
from companion.estimation.setup import set_up
from companion.model import STANDARD_GRAVITY, Array, Flight, ImuTrack, Series, longest_step, rows
from companion.noise.losses import lost_by_clipping, lost_in_gaps, restored, undelayed
from companion.strapdown import motions, preintegrate, quaternion
from tests.estimation.sensed import sensed
from tests.flights import flown, seconds, with_imu

CORNER_HZ, RATE_HZ, FINE = 20.0, 100.0, 20
ANGLE, SHAKING_HZ = 0.02, 15.0


def low_passed(values: Array, rate_hz: float, corner_hz: float = CORNER_HZ) -> Array:
    """Behind a Butterworth filter of second order, from rest at the first value."""
    import scipy.signal  # noqa: PLC0415  (slow to import, and every process of the tests collects this file)

    b, a = scipy.signal.butter(2, corner_hz, fs=rate_hz)
    return np.asarray(scipy.signal.lfilter(b, a, values - values[0], axis=0) + values[0])


def shaken(t: Array) -> Array:
    """Rates (N, 3) about x and y, a quarter of a turn apart: a cone."""
    omega = 2.0 * np.pi * SHAKING_HZ
    return ANGLE * omega * np.column_stack([np.cos(omega * t), np.sin(omega * t), np.zeros(len(t))])


def track(seconds: float = 20.0) -> tuple[ImuTrack, ImuTrack]:
    """As it is, and as a gyro behind a low-pass reads it."""
    fine = np.arange(round(seconds * RATE_HZ) * FINE) / (RATE_HZ * FINE)
    truth, still = shaken(fine), np.tile([0.0, 0.0, -9.8], (round(seconds * RATE_HZ), 1))
    own, read = (
        ImuTrack(fine[::FINE], gyro[::FINE], still, "RAW_IMU", gyro_low_pass_hz=CORNER_HZ, accel_low_pass_hz=CORNER_HZ)
        for gyro in (truth, low_passed(truth, RATE_HZ * FINE))
    )
    return own, read


def turned_about_z(one: ImuTrack) -> float:
    """rad/s, by whole periods of the shaking between two times far from the ends."""
    period = round(RATE_HZ / 5.0)  # three of the shaking
    i = np.array([5, 95]) * period
    q = preintegrate(one).q[i]
    way = quaternion.log(quaternion.multiply(quaternion.conjugate(q[:1]), q[1:]))[0]
    return float(way[2] / np.ptp(one.t[i]))


def test_a_low_pass_hides_a_part_of_what_shaking_adds_up_to_and_it_is_given_back() -> None:
    own, read = track()
    true, hidden = turned_about_z(own), turned_about_z(read)
    assert true == pytest.approx(0.5 * ANGLE**2 * 2.0 * np.pi * SHAKING_HZ, rel=0.03)
    assert hidden == pytest.approx(true / (1.0 + (SHAKING_HZ / CORNER_HZ) ** 4), rel=0.02)
    given = restored(undelayed(read), np.zeros(len(read) - 1, np.bool_))
    assert turned_about_z(given) == pytest.approx(true, rel=0.02)
    inside = slice(100, -100)
    then = np.column_stack([np.interp(given.t[inside], own.t, axis) for axis in own.gyro.T])
    assert np.abs(shaken(given.t[inside]) - given.gyro[inside]).max() < 0.03 * np.abs(then).max()


def test_what_is_constant_or_beside_a_gap_stays_as_it_is() -> None:
    _, read = track(4.0)
    gaps = np.zeros(len(read) - 1, np.bool_)
    even = replace(read, gyro=np.tile([0.1, -0.2, 0.3], (len(read), 1)))
    np.testing.assert_allclose(restored(even, gaps).gyro, even.gyro, rtol=1e-12)
    gaps[200] = True
    beside = np.flatnonzero((restored(read, gaps).gyro == read.gyro).all(axis=1))
    reach = round(4.0 * RATE_HZ / CORNER_HZ)
    assert (beside[0], beside[-1], len(beside)) == (201 - reach, 200 + reach, 2 * reach)


@pytest.mark.parametrize("corner_hz", [None, 0.0, 90.0])
def test_where_no_low_pass_is_known_or_its_corner_is_beyond_the_samples_nothing_is_done(
    corner_hz: float | None,
) -> None:
    _, read = track(2.0)
    one = replace(read, gyro_low_pass_hz=corner_hz, accel_low_pass_hz=corner_hz)
    np.testing.assert_array_equal(restored(one, np.zeros(len(one) - 1, np.bool_)).gyro, one.gyro)


@pytest.mark.slow
@pytest.mark.parametrize("known", [True, False])
def test_a_vehicle_that_shakes_has_no_biased_gyro(known: bool) -> None:
    """Its controller oscillates: of what that adds up to 10 mrad/s are hidden where the low-pass is not known."""
    angle = 1.5 * ANGLE
    own, fine = (
        motions.coning(seconds(40.0, rate), angle=angle, frequency=SHAKING_HZ, amplitude=(6.0, 5.0, 2.0))
        for rate in (RATE_HZ, RATE_HZ * FINE)
    )
    corner = CORNER_HZ if known else None
    gyro, accel = (low_passed(readings, RATE_HZ * FINE)[::FINE] for readings in (fine.gyro, fine.accel))
    read = with_imu(flown(own), gyro=gyro, accel=accel, gyro_low_pass_hz=corner, accel_low_pass_hz=corner)
    bias = np.median(smooth(read).states.gyro_bias[:, 2])
    whole = 0.5 * angle**2 * 2.0 * np.pi * SHAKING_HZ
    hidden = 0.0 if known else whole * (1.0 - 1.0 / (1.0 + (SHAKING_HZ / CORNER_HZ) ** 4))
    assert abs(bias) == pytest.approx(hidden, abs=1.5e-3)


def without(flight: Flight, every_s: float, length_s: float) -> Flight:
    """Without the readings of so many seconds, again and again."""
    imu = flight.imu()
    kept = np.flatnonzero((imu.t - imu.t[0]) % every_s >= length_s)
    return replace(flight, imus={imu.source: rows(imu, kept)})


@pytest.mark.parametrize("length", [0.15, 0.6])
def test_what_a_random_walk_loses_in_gaps_is_no_more_than_stated(length: float) -> None:
    """Nor much less: the axis that changes most counts for all three."""
    rate, every = 100.0, 2.0
    t = np.arange(0.0, 2000.0, 1.0 / rate)
    walk = np.cumsum(np.random.default_rng(3).normal(size=(len(t), 3)), axis=0)
    whole = ImuTrack(t, walk, walk)
    kept = np.flatnonzero(t % every >= length)
    track, key = rows(whole, kept), np.arange(0.5 * every, t[-1], every)
    integral = np.diff(np.interp(key, t, np.cumsum(walk[:, 0])) / rate)
    between = np.append(0.0, np.cumsum(0.5 * (track.gyro[1:, 0] + track.gyro[:-1, 0]) * np.diff(track.t)))
    error = np.diff(np.interp(key, track.t, between)) - integral
    density = 0.1
    lost = lost_in_gaps(track, key, longest_step(track.t), (density, density))[:, 0] * density * np.sqrt(every)
    assert 0.6 < np.std(error) / np.sqrt((lost**2).mean()) < 1.0


def test_without_gaps_nothing_is_lost() -> None:
    imu = sensed(30.0)[0].imu()
    assert not lost_in_gaps(imu, np.arange(1.0, 29.0), longest_step(imu.t), (1e-3, 1e-2)).any()


def test_an_estimate_across_many_short_gaps_knows_how_good_it_is() -> None:
    """As of a logger that could not keep up: two readings of five are missing, in holes of 0.2 s."""
    flight, truth = sensed(60.0, rate=50.0)
    best = smooth(without(flight, 0.5, 0.2))
    true = truth.q_ned_frd[np.searchsorted(truth.t, best.t - 1e-9)]
    error = quaternion.log(quaternion.multiply(true, quaternion.conjugate(best.q_ned_frd)))
    assert (np.abs(error) < 4.0 * best.sigma(slice(0, 3))).mean() > 0.97


def test_a_long_gap_breaks_the_estimate() -> None:
    flight = sensed(60.0, rate=50.0)[0]
    short, long = (without(flight, 20.0, length) for length in (0.9 * num.BRIDGED_GAP_S, 1.5 * num.BRIDGED_GAP_S))
    assert not set_up(short, None, STANDARD_GRAVITY, None).broken.any()
    assert set_up(long, None, STANDARD_GRAVITY, None).broken.any()


FLIGHT = sensed(60.0, rate=50.0)[0]


def counted(flight: Flight, column: str, each: float) -> Flight:
    """Readings clipped from 30 to 35 s, so many a second."""
    t = np.arange(0.0, 61.0)
    clips = np.clip(t - 30.0, 0.0, 5.0) * each
    series = Series(t, clips[:, None], (column,), "VIBRATION")
    return replace(flight, series={"vibration": series})


def test_only_the_imu_and_the_time_that_were_counted() -> None:
    t = np.arange(0.0, 60.0, 0.5)
    lost = lost_by_clipping(counted(FLIGHT, "clips_0", 100.0), FLIGHT.imu(), t, 0.1)
    assert lost[(t[:-1] >= 30.0) & (t[1:] <= 35.0)] == pytest.approx(2.0 / (0.1 * np.sqrt(0.5)))
    assert not lost[t[1:] < 30.0].any()
    assert np.isfinite(lost_by_clipping(FLIGHT, FLIGHT.imu(), t, 0.0)).all(), "a simulated sensor has no noise"
    assert lost_by_clipping(counted(FLIGHT, "clips_x", 100.0), FLIGHT.imu(), t, 0.1) == pytest.approx(lost)
    assert not lost_by_clipping(counted(FLIGHT, "clips_1", 100.0), FLIGHT.imu(), t, 0.1).any()


def test_an_accelerometer_that_clips_is_not_accused_of_a_fault_meanwhile() -> None:
    imu = FLIGHT.imu()
    off = np.where((imu.t > 30.0) & (imu.t < 35.0), -3.0, 0.0)[:, None] * np.array([0.0, 0.0, 1.0])
    wrong = replace(FLIGHT, imus={imu.source: replace(imu, accel=imu.accel + off)})
    assert any(one.kind.startswith("accel") for one in smooth(wrong).explained)
    clipped = smooth(counted(wrong, "clips_0", 200.0))
    assert not any(one.kind.startswith("accel") for one in clipped.explained)
