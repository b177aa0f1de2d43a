"""Axes that are mirrored or exchanged."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from companion.estimation import BestEstimate, contradicted, other_reading, smooth
from companion.estimation.axes import WAYS
from companion.model import Flight
from companion.recording import read_recording
from tests.estimation.sensed import sensed, with_imu
from tests.recordings import BUNDLED


@cache
def healthy() -> Flight:
    return sensed(40.0, "circle", rate=50.0)[0]


def read(words: str) -> tuple[Flight, BestEstimate]:
    """The flight with the fault of these words: each is its own inverse."""
    imu = healthy().imu()
    gyro, accel = WAYS[words]
    flight = with_imu(healthy(), replace(imu, gyro=imu.gyro @ gyro.T, accel=imu.accel @ accel.T))
    return flight, smooth(flight)


@pytest.mark.parametrize("words", ["accelerometer y is mirrored", "axes x and y are exchanged"])
def test_the_way_that_fits_is_found(words: str) -> None:
    flight, best = read(words)
    assert contradicted(best)
    other = other_reading(flight, best)
    assert other is not None
    assert other.words == words
    assert other.fits > 3.0


def test_a_mirrored_gyro_is_found_in_a_flight_that_turns_to_and_fro() -> None:
    """Even turns, as in a circle, tell it from no bias."""
    (flight,) = read_recording(BUNDLED / "copter-demo-100hz.tlog").flights
    imu = flight.imu()
    faulty = with_imu(flight, replace(imu, gyro=imu.gyro * [-1.0, 1.0, 1.0]))
    span = (100.0, 140.0)
    other = other_reading(faulty, smooth(faulty, span=span), span=span)
    assert other is not None
    assert other.words == "gyro x is mirrored"


def test_of_right_axes_nothing_is_said() -> None:
    best = smooth(healthy())
    assert not contradicted(best)
    assert other_reading(healthy(), best) is None


def test_each_way_undoes_itself() -> None:
    for turns in WAYS.values():
        for turn in turns:
            assert np.array_equal(turn @ turn, np.eye(3))
