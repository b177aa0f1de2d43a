"""A flight that goes on: an estimate that begins at the one of a moment ago is that of all readings at once."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from benchmarks.accuracy.cutting import cut
from companion.estimation import ATTITUDE, POSITION, VELOCITY, BestEstimate, iteration, linearisation, smooth
from companion.estimation.iteration import resuming, start_of
from companion.estimation.setup import first_guess, set_up
from companion.model import STANDARD_GRAVITY, Flight, rows
from companion.strapdown import quaternion
from tests.estimation.sensed import sensed, with_imu

pytestmark = pytest.mark.slow

LAG, STEP = 40.0, 4.0


@cache
def flown() -> Flight:
    return sensed(60.0, "square", seed=3)[0]


def window(flight: Flight, number: int) -> Flight:
    """The lag that is judged after so many steps."""
    begin = flight.start + 1.0 + STEP * number
    return cut(flight, begin, begin + LAG)


def turned_wrong(flight: Flight, seconds: float) -> Flight:
    """With a gyro that is off since so long before the end."""
    imu = flight.imu()
    bias = np.array([0.03, 0.0, 0.0]) * (imu.t > imu.t[-1] - seconds)[:, None]
    return with_imu(flight, replace(imu, gyro=imu.gyro + bias))


@pytest.fixture
def passes(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """One for each time that a problem is made linear."""
    made: list[int] = []

    def counted(*args: Any, **named: Any) -> Any:
        made.append(1)
        return linearisation.linearise(*args, **named)

    monkeypatch.setattr(iteration, "linearise", counted)
    return made


def apart(one: BestEstimate, other: BestEstimate) -> float:
    """The largest difference of two estimates of the same keyframes, as a part of its σ."""
    states, others = one.states, other.states
    turned = quaternion.log(quaternion.multiply(states.q_ned_frd, quaternion.conjugate(others.q_ned_frd)))
    pairs = (
        (turned, other.sigma(ATTITUDE)),
        (states.velocity - others.velocity, other.sigma(VELOCITY)),
        (states.position - others.position, other.sigma(POSITION)),
        (states.gyro_bias - others.gyro_bias, other.gyro_bias_sigma),
        (states.accel_bias - others.accel_bias, other.accel_bias_sigma),
        (states.constants - others.constants, other.constants_sigma),
    )
    return max(float(np.abs(difference / sigma).max()) for difference, sigma in pairs)


def test_what_both_have_seen_gives_the_same(passes: list[int]) -> None:
    """Step after step with a fixed lag, each begun at the one before, beside the whole lag anew."""
    running = smooth(window(flown(), 0))
    for number in range(1, 4):
        passes.clear()
        running = smooth(window(flown(), number), before=running)
        resumed = len(passes)
        passes.clear()
        anew = smooth(window(flown(), number))
        assert 1.5 * resumed < len(passes)
        assert apart(running, anew) < 0.03
        assert np.allclose(running.gyro_bias_sigma, anew.gyro_bias_sigma, rtol=0.02)
        assert running.noise.gyro_noise == pytest.approx(anew.noise.gyro_noise, rel=0.03)
        assert running.explained == anew.explained == ()


def test_a_fault_in_the_newest_seconds_is_found_alike() -> None:
    wrong = turned_wrong(window(flown(), 2), 5.0)
    resumed = smooth(wrong, before=smooth(window(flown(), 1)))
    anew = smooth(wrong)
    assert [e.kind for e in resumed.explained] == [e.kind for e in anew.explained] == ["gyro_bias"]
    assert apart(resumed, anew) < 0.1


def test_nothing_is_carried_across_a_gap() -> None:
    whole = window(flown(), 1)
    imu = whole.imu()
    begin = whole.start + LAG - 3.0
    flight = with_imu(whole, rows(imu, (imu.t < begin) | (imu.t > begin + 1.5)))
    before = smooth(window(flown(), 0))
    setup = set_up(flight, None, STANDARD_GRAVITY, None)
    guess = first_guess(setup, flight)
    start = next(iter(resuming([start_of(setup, guess)], setup, before)))
    after = setup.t > begin + 1.5
    assert np.array_equal(start.states.q_ned_frd[after], guess.q_ned_frd[after])
    assert not np.array_equal(start.states.q_ned_frd[~after], guess.q_ned_frd[~after])
    assert apart(smooth(flight, before=before), smooth(flight)) < 0.03


def test_an_estimate_of_something_else_is_no_beginning() -> None:
    flight = window(flown(), 1)
    before = smooth(window(flown(), 0))
    setup = set_up(flight, None, STANDARD_GRAVITY, None)
    first = start_of(setup, first_guess(setup, flight))

    def begins(estimate: BestEstimate) -> list[bool]:
        return [start.near for start in resuming([first, first], setup, estimate)]

    assert begins(before) == [True]
    other_imu = replace(before, imu=replace(before.imu, source="SCALED_IMU2"))
    long_ago = replace(before, t=before.t - 100.0)
    something_wrong = smooth(turned_wrong(flight, 20.0))
    assert something_wrong.explained
    for other in (other_imu, long_ago, something_wrong):
        assert begins(other) == [False, False]
