"""A replay and a free run that go on with the newest samples alone are those of all samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.comparison import FreeRun, Replay, extend, replay
from companion.comparison.windows import DEFAULT
from companion.model import Array, AttitudeTrack, Flight, ImuTrack, PositionTrack
from companion.strapdown import motions
from tests.flights import flight_of, seconds

FLIGHT = flight_of(motions.coning(seconds(15, 100)))
LatestOnly = tuple[ImuTrack, AttitudeTrack, PositionTrack]


def between(begin: float, end: float) -> LatestOnly:
    """The samples of these times, s."""
    imu, attitude, position = FLIGHT.imu(), FLIGHT.require_attitude(), FLIGHT.position
    assert position is not None

    def part(t: Array) -> slice:
        return slice(*np.searchsorted(t, [begin, end]).tolist())

    a, p = part(attitude.t), part(position.t)
    return (
        imu[part(imu.t)],
        replace(attitude, t=attitude.t[a], q_ned_frd=attitude.q_ned_frd[a], rates=attitude.rates[a]),
        replace(position, t=position.t[p], position=position.position[p], velocity=position.velocity[p]),
    )


def until(end: float) -> Flight:
    imu, attitude, position = between(-np.inf, end)
    return replace(FLIGHT, imus={imu.source: imu}, attitude=attitude, position=position)


BEFORE = replay(until(22.0), reanchor_s=5.0)


def test_what_goes_on_is_what_a_replay_of_everything_shows() -> None:
    found = extend(BEFORE, *between(21.5, 22.6), DEFAULT)
    assert found is not None
    whole = replay(until(22.6), reanchor_s=5.0)
    same = np.searchsorted(whole.t, found.replay.t)
    assert found.replay.t[-1] == whole.t[-1]
    for name in ("velocity_imu", "position_imu", "position_ref", "attitude_error", "velocity_error", "position_error"):
        np.testing.assert_allclose(getattr(found.replay, name), getattr(whole, name)[same], atol=1e-9, err_msg=name)


def test_a_free_run_goes_on_likewise() -> None:
    run, other = FreeRun(), FreeRun()
    run.take(until(22.0).imu(), BEFORE)
    other.take(until(22.0).imu(), BEFORE)
    found = extend(BEFORE, *between(21.5, 22.6), DEFAULT)
    assert found is not None
    carried = run.carry(found)
    taken = other.take(until(22.6).imu(), replay(until(22.6), reanchor_s=5.0))
    assert carried is not None
    assert taken is not None
    assert carried.anchor_s == taken.anchor_s
    np.testing.assert_allclose(carried.state.position, taken.state.position, atol=1e-9)
    np.testing.assert_allclose(carried.attitude_error, taken.attitude_error, atol=1e-12)
    run.anchor_now()
    assert run.carry(found) is None, "another run begins with the next replay"


def test_what_does_not_join_does_not_go_on() -> None:
    anchored = replay(until(22.0), reanchor_s=None, start_s=21.98)
    imu, attitude, position = between(21.5, 22.6)
    kept = (imu.t < 22.1) | (imu.t > 22.4)
    gap = replace(imu, t=imu.t[kept], gyro=imu.gyro[kept], accel=imu.accel[kept])
    late = between(22.1, 22.6)
    cases: tuple[tuple[Replay, LatestOnly], ...] = (
        (anchored, (imu, attitude, position)),
        (BEFORE, (gap, attitude, position)),
        (BEFORE, late),
        (BEFORE, (imu, attitude, between(21.0, 21.5)[2])),
    )
    for before, newest in cases:
        assert extend(before, *newest, DEFAULT) is None


def test_without_a_position_the_attitudes_go_on() -> None:
    before = replay(replace(until(22.0), position=None), reanchor_s=5.0)
    imu, attitude, _ = between(21.5, 22.6)
    found = extend(before, imu, attitude, None, DEFAULT)
    assert found is not None
    assert not found.replay.has_position
    assert found.replay.position_imu == pytest.approx(0.0)
