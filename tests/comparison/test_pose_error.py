"""APE and RPE by truth: two trajectories whose difference is known. evo itself is in tests/export."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import companion as c
from companion.comparison import ape, expected_by_age, expected_since_anchor, replay, rpe
from companion.strapdown import motions, quaternion
from tests.flights import flight_of, seconds
from tests.recordings import BUNDLED


def test_the_same_trajectory_twice_has_no_error() -> None:
    shown = replay(flight_of(motions.circle(seconds(20, 100))))
    same = replace(shown, q_imu=shown.q_ref, position_imu=shown.position_ref, position_error=0 * shown.position_error)
    same = replace(same, attitude_error=0 * shown.attitude_error)
    for found in (ape(same), rpe(same, 50)):
        assert found.position_m is not None
        assert found.position_m.max == pytest.approx(0, abs=1e-12)
        assert found.attitude_deg.max == pytest.approx(0, abs=1e-5)


def test_a_constant_offset_is_an_absolute_error_and_no_relative_one() -> None:
    shown = replay(flight_of(motions.circle(seconds(20, 100))))
    offset = np.array([3.0, 4.0, 12.0])
    moved = replace(
        shown, q_imu=shown.q_ref, position_imu=shown.position_ref - offset, position_error=0 * shown.t[:, None] + offset
    )
    absolute, relative = ape(moved).position_m, rpe(moved, 10).position_m
    assert absolute is not None
    assert relative is not None
    assert (absolute.rmse, absolute.std, absolute.max) == pytest.approx((13.0, 0.0, 13.0))
    assert relative.max == pytest.approx(0, abs=1e-12)


def test_a_steady_turn_is_a_relative_error_that_grows_with_the_step() -> None:
    """An IMU that turns 0.01 rad/s too fast about down: 0.01 rad for each second between the samples."""
    shown = replay(flight_of(motions.circle(seconds(20, 100))))
    turn = np.column_stack([np.zeros((len(shown.t), 2)), 0.01 * (shown.t - shown.t[0])])
    turned = replace(shown, q_imu=quaternion.multiply(quaternion.exp(turn), shown.q_ref))
    for step in (50, 200):
        assert rpe(turned, step).attitude_deg.median == pytest.approx(np.degrees(0.01 * step / 100), rel=1e-9)


def test_gaps_are_no_part_of_it() -> None:
    shown = replay(flight_of(motions.circle(seconds(20, 100))))
    bad = shown.position_error.copy()
    bad[500:600] = 1e3
    gapped = replace(shown, position_error=bad, reference_valid=np.asarray(bad[:, 0] < 1e2))
    found = ape(gapped)
    assert found.samples == len(shown.t) - 100
    assert found.position_m is not None
    assert found.position_m.max < 1


def test_a_step_that_is_none() -> None:
    shown = replay(flight_of(motions.circle(seconds(20, 100))))
    with pytest.raises(c.SettingsError, match="one sample or more"):
        rpe(shown, 0)
    with pytest.raises(c.DataError, match="no samples"):
        rpe(shown, 5000)


pytestmark = pytest.mark.slow

FLIGHT = c.open_log(BUNDLED / "copter-demo-100hz.tlog")[0]


@pytest.fixture(scope="module")
def found() -> c.Assessment:
    return c.examine(FLIGHT).assessment


def test_it_begins_at_each_anchor_and_grows_to_what_was_assessed(found: c.Assessment) -> None:
    shown = replay(FLIGHT, reanchor_s=10.0)
    expected = expected_since_anchor(found.comparison, found.imu_spec, found.autopilot, shown)
    assert expected
    assert (np.diff(expected.t) > 0).all()
    _, _, position = expected.lengths
    at = np.searchsorted(expected.t, shown.anchors)
    assert position[at] == pytest.approx(np.sqrt(6) * 0.1)  # the autopilot's position, there and here
    assert (np.diff(position[at[3] : at[4]]) > 0).all()
    assessed = found.expected[3]  # after 10 s: the median of the same windows
    assert assessed
    assert np.median(position[at[1:] - 1]) == pytest.approx(assessed.position_m, rel=0.02)
    assert (np.linalg.eigvalsh(expected.covariance[:, 6:, 6:]) > 0).all()  # an ellipsoid everywhere


def test_a_free_run_goes_beyond_what_a_linear_budget_can_say(found: c.Assessment) -> None:
    free = replay(FLIGHT, reanchor_s=None)
    assert free.t[-1] - free.t[0] < 120
    assert expected_since_anchor(found.comparison, found.imu_spec, found.autopilot, free)
    often = replay(FLIGHT, reanchor_s=0.1)
    assert expected_since_anchor(found.comparison, found.imu_spec, found.autopilot, often) is None


def test_by_age_it_is_what_the_drift_table_expects(found: c.Assessment) -> None:
    by_age = expected_by_age(found.comparison, found.imu_spec, found.autopilot, (1.0, 10.0, 500.0))
    assert by_age[:, 0].tolist() == [1.0, 10.0], "no window is so long"
    for (age, *sigma), row in zip(by_age.tolist(), (0, 3), strict=True):
        one = found.expected[row]
        assert one
        assert found.drift.rows[row].horizon_s == age
        assert sigma == [one.attitude_deg, one.velocity_mps, one.position_m]
    assert expected_by_age(found.comparison, found.imu_spec, found.autopilot, ()).shape == (0, 4)
