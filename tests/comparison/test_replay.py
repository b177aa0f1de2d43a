"""The flight twice on one time axis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.comparison import replay
from companion.comparison.reference import length
from companion.model import DataError, NavState, PositionTrack, SettingsError
from companion.strapdown import dead_reckon, motions
from tests.flights import flight_of, seconds

MOTION = motions.coning(seconds(35, 100))
FLIGHT = flight_of(MOTION)
BIASED = replace(FLIGHT, imus={"RAW_IMU": replace(FLIGHT.imu(), gyro=FLIGHT.imu().gyro + [0.01, 0, 0])})


def test_a_free_run_is_a_reckoning() -> None:
    shown = replay(BIASED, reanchor_s=None, start_s=12.0)
    k = int(np.searchsorted(MOTION.t, 12.0))
    start = NavState(MOTION.t[k], MOTION.q_ned_frd[k], MOTION.velocity[k], MOTION.position[k])
    alone = dead_reckon(BIASED.imu()[k:], start)
    assert shown.anchors == pytest.approx([12.0])
    assert shown.t == pytest.approx(alone.t)
    assert shown.position_imu == pytest.approx(alone.position, abs=1e-9)
    assert shown.q_imu == pytest.approx(alone.q_ned_frd, abs=1e-9)


def test_every_anchor_starts_from_the_autopilot() -> None:
    shown = replay(BIASED, reanchor_s=10.0)
    assert shown.anchors == pytest.approx([10.0, 20.0, 30.0, 40.0])
    error = length(shown.position_error)
    at = np.searchsorted(shown.t, shown.anchors)
    assert error[at] == pytest.approx(0, abs=1e-9)
    assert error[at[1:] - 1].min() > 1.0, "the biased gyro leads away until the next anchor"


def test_truth_in_truth_out() -> None:
    shown = replay(FLIGHT, reanchor_s=None)
    assert length(shown.attitude_error).max() < 1e-3
    assert length(shown.position_error).max() < 0.2
    assert shown.reference_valid.all()


def test_an_anchor_waits_while_the_position_is_unknown() -> None:
    position = FLIGHT.position
    assert position
    keep = (position.t < 19.0) | (position.t > 23.0)
    gapped = replace(BIASED, position=PositionTrack(position.t[keep], position.position[keep], position.velocity[keep]))
    shown = replay(gapped, reanchor_s=10.0)
    assert shown.anchors[1] == pytest.approx(23.01, abs=0.02)
    assert not shown.reference_valid[(shown.t > 19.01) & (shown.t < 22.99)].any()


def test_attitude_alone_holds_the_positions_still() -> None:
    shown = replay(replace(BIASED, position=None))
    assert not shown.has_position
    assert not shown.position_imu.any()
    assert length(shown.attitude_error).max() > 0.05


def test_no_overlap_is_said() -> None:
    with pytest.raises(DataError, match="do not overlap after 99.0 s"):
        replay(FLIGHT, start_s=99.0)
    with pytest.raises(SettingsError, match="positive"):
        replay(FLIGHT, reanchor_s=0.0)
