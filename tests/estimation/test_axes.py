"""Axes that are mirrored or exchanged."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from companion.app.recording import read_recording
from companion.estimation import BestEstimate, other_reading, smooth
from companion.estimation.axes import WAYS, followed, motion_between
from companion.estimation.model import Explained
from companion.model import Array, Flight
from companion.strapdown import quaternion
from tests.estimation.sensed import sensed, with_imu
from tests.recordings import BUNDLED

pytestmark = pytest.mark.slow

SPAN = (100.0, 118.0)


@cache
def healthy() -> Flight:
    """A flight that turns to and fro: even turns, as in a circle, tell a mirrored gyro from no bias."""
    return read_recording(BUNDLED / "copter-demo-100hz.tlog").flights[0]


@cache
def misread(words: str) -> Flight:
    """Its IMU read in another way."""
    imu = healthy().imu()
    gyro, accel = WAYS[words]  # each is its own inverse
    return with_imu(healthy(), replace(imu, gyro=imu.gyro @ gyro.T, accel=imu.accel @ accel.T))


@cache
def smoothed(words: str) -> BestEstimate:
    return smooth(misread(words), span=SPAN)


@pytest.mark.parametrize("lost", [False, True])
@pytest.mark.parametrize("words", ["gyro x is mirrored", "accelerometer x is mirrored", "axes x and y are exchanged"])
def test_the_way_that_fits_is_found(words: str, lost: bool) -> None:
    """Whether the autopilot flew well with it, or tumbled in its own estimate."""
    flight = misread(words)
    attitude = flight.require_attitude()
    if lost:
        tumbling = quaternion.exp(attitude.t[:, None] * np.array([1.0, 0.7, 0.3]))
        q = quaternion.multiply(tumbling, attitude.q_ned_frd)
        flight = replace(flight, attitude=replace(attitude, q_ned_frd=q))
    best = smooth(flight, span=SPAN) if lost else smoothed(words)
    assert min(part.min() for part in followed(best, motion_between(best))) < 0.5
    other = other_reading(flight, best, span=SPAN)
    assert other is not None
    assert other.words == words
    assert other.fits > 3.0


def test_an_estimate_that_follows_a_wrong_axis_astray_is_no_excuse() -> None:
    """Where the others contradict the IMU, every way is tried, whatever the estimate seems to follow."""
    flight, astray = misread("axes x and y are exchanged"), smoothed("axes x and y are exchanged")
    of_itself = motion_between(astray)
    assert astray.contradicted
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "companion.estimation.axes.motion_between", lambda _: tuple((read, read) for _, read in of_itself)
        )
        other = other_reading(flight, astray, span=SPAN)
    assert other is not None
    assert other.words == "axes x and y are exchanged"


@pytest.mark.parametrize(("turned", "told"), [(1.9, "axes x and y are exchanged"), (0.3, None)])
def test_a_compass_that_turned_by_a_right_angle_tells_of_wrong_axes(turned: float, told: str | None) -> None:
    """Such a turn lets an estimate follow exchanged axes with no more noise than is usual."""
    flight, best = misread("axes x and y are exchanged"), smoothed("axes x and y are exchanged")
    quiet = replace(best.noise, gyro_noise=best.spectral[0], accel_noise=best.spectral[1])
    turn = Explained("compass_turn", "step", 101.0, 0.1, np.inf, np.array([turned]), np.array([0.1]))
    other = other_reading(flight, replace(best, noise=quiet, explained=(turn,)), span=SPAN, differ=False)
    assert (other and other.words) == told


def test_only_what_surely_began_in_flight_is_left_out() -> None:
    """A wrong axis is wrong from the beginning: an error of the IMU that may be as old may be what it looks like."""
    best = smoothed("gyro x is mirrored")
    motion = motion_between(best)
    onset = SPAN[0] + 15.0

    def beside(sigma: float) -> tuple[Array, Array]:
        scale = Explained("gyro_scale", "step", onset, sigma, np.inf, np.full(3, 0.5), np.full(3, 0.1))
        return followed(replace(best, explained=(scale,)), motion)

    alone = followed(replace(best, explained=()), motion)
    assert np.array_equal(beside(8.0), alone)
    assert not np.array_equal(beside(1.0), alone)


def test_right_axes_are_followed_and_nothing_is_said() -> None:
    flight, _ = sensed(40.0, "circle", rate=50.0)
    best = smooth(flight)
    assert np.allclose(followed(best, motion_between(best)), 1.0, atol=0.1)
    assert not best.contradicted
    assert other_reading(flight, best) is None


@pytest.mark.parametrize(
    ("span", "axis", "turned"), [((104.0, 122.0), 1, 0.6), ((104.0, 116.0), 1, 1.0), ((90.0, 105.0), 0, 1.0)]
)
def test_a_shock_that_other_axes_would_explain_too_is_none(span: tuple[float, float], axis: int, turned: float) -> None:
    """Of some seconds of flight: an IMU that missed 0.1 s of a turn fits up to eight times as well, read otherwise."""
    imu = healthy().imu()
    gyro, begin = imu.gyro.copy(), span[0] + 0.55 * (span[1] - span[0])
    gyro[(imu.t > begin) & (imu.t < begin + 0.1), axis] -= turned / 0.1
    flight = with_imu(healthy(), replace(imu, gyro=gyro))
    best = smooth(flight, span=span)
    assert other_reading(flight, best, span=span) is None


def test_each_way_undoes_itself() -> None:
    for turns in WAYS.values():
        for turn in turns:
            assert np.array_equal(turn @ turn, np.eye(3))


@pytest.mark.parametrize("words", WAYS)
def test_each_way_does_what_its_words_say(words: str) -> None:
    gyro, accel = WAYS[words]
    named = ["xyz".index(letter) for letter in words.split() if letter in ("x", "y", "z")]
    expected = np.eye(3)
    if "exchanged" in words:
        expected[named] = np.eye(3)[named[::-1]]
    else:
        expected[named] *= -1.0
    assert np.array_equal(gyro, np.eye(3) if words.startswith("accelerometer") else expected)
    assert np.array_equal(accel, np.eye(3) if words.startswith("gyro") else expected)
