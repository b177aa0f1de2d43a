"""The benchmark of lanes: what a lane truly is off by, and what counts as a good lane called off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.accuracy.lanes import Row, true_sizes
from companion.model import EstimatorLane, TruthTrack
from companion.strapdown import quaternion

T = np.arange(0.0, 20.0, 0.1)
LEVEL = np.tile([1.0, 0.0, 0.0, 0.0], (len(T), 1))
STILL = np.zeros((len(T), 3))
TRUTH = TruthTrack(T, LEVEL, STILL, STILL, "SIM")


def test_a_lane_is_off_by_what_it_is_put_off_by() -> None:
    turn = np.asarray(quaternion.exp(np.tile([0.03, 0.04, 0.2], (len(T), 1))))
    lane = EstimatorLane(T, turn, STILL + [3.0, 4.0, 9.0], STILL + [7.0, 0.0, 0.0], "EKF3 core 0", 0)
    sizes = true_sizes(lane, TRUTH, 5.0, 15.0)
    assert sizes == pytest.approx({"tilt": 0.05, "heading": 0.2, "velocity": 5.0, "position": 0.0, "height": 0.0})
    unknown = replace(lane, velocity=STILL * np.nan, position=STILL * np.nan)
    assert set(true_sizes(unknown, TRUTH, 5.0, 15.0)) == {"tilt", "heading"}


@pytest.mark.parametrize(
    ("off", "called", "matters", "condemned"),
    [
        (("a",), ("a",), True, ()),
        (("a",), ("b",), True, ("b",)),
        ((), ("a",), False, ("a",)),
        (("b",), (), False, ()),
        (("a", "b"), ("a",), False, ()),
    ],
)
def test_a_good_lane_that_is_called_off_is_condemned(
    off: tuple[str, ...], called: tuple[str, ...], matters: bool, condemned: tuple[str, ...]
) -> None:
    row = Row("x.bin", "gyro_bias", 0.0, 9.0, "b", off, ("a",), None, called, {})
    assert (row.matters, row.condemned) == (matters, condemned)
