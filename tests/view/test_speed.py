"""A change shows, for ten minutes at 100 Hz; benchmarks/view.py says how soon."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from companion.comparison import replay
from companion.model import DataError, Flight
from companion.view import AnalysisResult, DisplayTrajectory, ReplayChoice, Viewer, chosen_track, display_trajectory
from tests.view.circles import RATE, make_flight
from tests.waiting import wait_for

SECONDS, HZ = 600.0, 100.0


def long_flight() -> Flight:
    flight = make_flight(duration=SECONDS * HZ / RATE)  # as many samples, at another rate
    return replace(flight, imus={"RAW_IMU": flight.imus["RAW_IMU"]})


def test_a_new_bias_is_on_the_screen() -> None:
    flight = long_flight()
    assert len(flight.imus["RAW_IMU"].t) == SECONDS * HZ

    def dead_reckon(flight: Flight, choice: ReplayChoice) -> DisplayTrajectory:
        track = chosen_track(flight, choice)
        return display_trajectory(replay(flight.with_imu(track), imu=choice.imu), track)

    def unknown(*_: object) -> AnalysisResult:
        raise DataError("not analysed here")

    with Viewer([flight], dead_reckon, unknown, port=0) as viewer:
        viewer.post(partial(viewer.player.seek, viewer.player.first + 9.9))
        for i in range(1, 4):
            before = viewer.controller.scene.imu.position
            bias = partial(replace, gyro_bias=(1e-3 * i, 0.0, 0.0))
            viewer.post(partial(viewer.controller.change, bias))
            wait_for(lambda before=before: not np.array_equal(viewer.controller.scene.imu.position, before))  # type: ignore[misc]
