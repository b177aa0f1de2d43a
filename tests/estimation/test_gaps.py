"""Short gaps in the readings: how uncertain they make what is integrated, and that they break no estimate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.constants import num
from companion.estimation import smooth
from companion.estimation.gaps import lost_in_gaps
from companion.estimation.setup import set_up
from companion.model import STANDARD_GRAVITY, Flight, ImuTrack, longest_step, rows
from companion.strapdown import quaternion
from tests.estimation.sensed import sensed


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
