"""A flight that comes in pieces gives the numbers of the whole flight: drift window by window, and the free run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

import companion as c
from companion.comparison import FreeRun, RunningDrift, drift, replay
from companion.model import Flight
from tests.recordings import BUNDLED

pytestmark = pytest.mark.slow

HORIZONS = (1.0, 5.0, 30.0)


@pytest.fixture(scope="module")
def whole() -> Flight:
    return max(c.open_log(BUNDLED / "copter-demo-100hz.tlog"), key=lambda f: len(f.imu()))


def pieces(flight: Flight, span: float, step: float) -> Iterator[Flight]:
    """The flight's last `span` seconds, every `step` seconds."""
    imu = flight.imu()
    for now in np.arange(imu.t[0] + step, imu.t[-1] + step, step):
        tracks = {name: getattr(flight, name) for name in ("attitude", "position")}
        for name, track in tracks.items():
            inside = (track.t > now - span) & (track.t <= now) if track is not None else np.zeros(0, np.bool_)
            columns = ("t", "q_ned_frd", "rates") if name == "attitude" else ("t", "position", "velocity")
            tracks[name] = (
                replace(track, **{column: getattr(track, column)[inside] for column in columns})
                if inside.sum() > 1
                else None
            )
        a, b = np.searchsorted(imu.t, [now - span, now], side="right")
        yield replace(flight, imus={imu.source: imu[a:b]}, **tracks)


def test_every_window_is_judged_once_and_as_in_the_whole_flight(whole: Flight) -> None:
    running = RunningDrift(HORIZONS)
    for piece in pieces(whole, span=45.0, step=4.9):
        imu = piece.imu()
        running.take(piece, settled_s=float(imu.t[-1]) - 1.0)
    running.take(piece)
    for now, then in zip(running.rows, drift(whole, horizons=HORIZONS).rows, strict=True):
        assert now.windows == then.windows
        assert sum(now.excluded.values()) == sum(then.excluded.values())
        np.testing.assert_allclose(now.errors.anchor_s, then.errors.anchor_s)
        # one pass over 45 s or over the whole: the same but for rounding
        np.testing.assert_allclose(now.errors.position, then.errors.position, atol=1e-6)
        np.testing.assert_allclose(now.errors.attitude, then.errors.attitude, atol=1e-9)
        assert now.position_m is not None
        assert then.position_m is not None
        assert now.position_m.p95 == pytest.approx(then.position_m.p95)


def test_windows_before_the_position_is_known_are_left_out_in_the_end(whole: Flight) -> None:
    assert whole.position is not None
    late = whole.position.t > whole.imu().t[0] + 60.0
    position = replace(
        whole.position,
        **{column: getattr(whole.position, column)[late] for column in ("t", "position", "velocity")},
    )
    flight = replace(whole, position=position)
    running = RunningDrift((5.0,))
    for piece in pieces(flight, span=20.0, step=3.0):
        running.take(piece, settled_s=float(piece.imu().t[-1]) - 1.0)
    running.take(piece)
    (now,), (then,) = running.rows, drift(flight, horizons=(5.0,)).rows
    assert (now.windows, dict(now.excluded)) == (then.windows, dict(then.excluded))


def test_the_free_run_is_that_of_the_whole_flight(whole: Flight) -> None:
    free, compared = FreeRun(), 0
    anchor = None
    for piece in pieces(whole, span=12.0, step=0.7):
        if piece.position is None:
            continue
        shown = replay(piece, reanchor_s=5.0, start_s=float(piece.imu().t[0]) + 0.5 if anchor is None else None)
        now = free.take(piece.imu(), shown)
        assert now is not None
        anchor = now.anchor_s if anchor is None else anchor
        assert now.anchor_s == anchor
        if compared % 20 == 0:  # the last sample is one-sided until the next has come
            alone = replay(whole, reanchor_s=None, start_s=anchor - 1e-6)
            at = int(np.searchsorted(alone.t, now.state.t - 1e-6))
            np.testing.assert_allclose(now.state.position, alone.position_imu[at], atol=2e-2)
            np.testing.assert_allclose(now.position_error, alone.position_error[at], atol=2e-2)
            np.testing.assert_allclose(now.attitude_error, alone.attitude_error[at], atol=1e-4)
        compared += 1
    assert compared > 50


def test_a_free_run_ends_at_a_gap_and_begins_again(whole: Flight) -> None:
    imu = whole.imu()
    a, b = np.searchsorted(imu.t, imu.t[0] + np.array([10.0, 12.0]))
    gapped = replace(imu, t=np.delete(imu.t, slice(a, b)), gyro=np.delete(imu.gyro, slice(a, b), axis=0),
                    accel=np.delete(imu.accel, slice(a, b), axis=0))  # fmt: skip
    flight = replace(whole, imus={imu.source: gapped})
    free, anchors, ended = FreeRun(), [], []
    for piece in pieces(flight, span=20.0, step=1.0):
        if len(piece.imu()) < 100 or piece.position is None:
            continue
        now = free.take(piece.imu(), replay(piece, reanchor_s=5.0))
        ended.append(free.ended)
        anchors += [now.anchor_s] if now else []
        if piece.imu().t[-1] > imu.t[0] + 25.0:
            break
    assert any("the IMU was silent for 2.0 s" in why for why in ended)
    assert len(set(anchors)) >= 2
    free.anchor_now()
    assert free.ended == ""


def test_a_free_run_begins_again_when_the_position_is_known(whole: Flight) -> None:
    free = FreeRun()
    blind = replace(whole, position=None)
    ages = []
    for i, (dark, seeing) in enumerate(zip(pieces(blind, 12.0, 1.0), pieces(whole, 12.0, 1.0), strict=True)):
        piece = dark if i < 15 else seeing
        if len(piece.imu()) > 150:
            now = free.take(piece.imu(), replay(piece, reanchor_s=5.0))
            assert now is not None
            ages.append(now.state.t - now.anchor_s)
            assert float(np.abs(now.position_error).max()) < 5.0
        if i == 17:
            break
    assert ages[-4] > ages[-3] < 6.0
