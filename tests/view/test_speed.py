"""A change shows within half a second, for ten minutes at 100 Hz."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from companion.analysis import replay
from companion.tracks import Flight
from companion.view import Reckoning, ReplayChoice, Viewer, chosen_track, events, with_track
from tests.view.circles import RATE, examine, make_flight

SECONDS, HZ = 600.0, 100.0


def long_flight() -> Flight:
    flight = make_flight(duration=SECONDS * HZ / RATE)  # as many samples, at another rate
    return replace(flight, imus={"RAW_IMU": flight.imus["RAW_IMU"]})


def test_a_new_bias_is_on_the_screen_within_half_a_second() -> None:
    flight = long_flight()
    assert len(flight.imus["RAW_IMU"].t) == SECONDS * HZ

    def reckon(flight: Flight, choice: ReplayChoice) -> Reckoning:
        track = chosen_track(flight, choice)
        return Reckoning(replay(with_track(flight, track), imu=choice.imu), track)

    with Viewer([flight], reckon, examine, port=0) as viewer:
        viewer.post(events.Seek(viewer.player.first + 9.9))
        waits = []
        for i in range(1, 6):
            before, start = viewer.scene.imu.position, time.monotonic()
            viewer.post(events.Choose(ReplayChoice(imu="RAW_IMU", gyro_bias=(1e-3 * i, 0.0, 0.0))))
            while np.array_equal(viewer.scene.imu.position, before) and time.monotonic() < start + 10:
                time.sleep(0.005)
            waits.append(time.monotonic() - start)
    print(f"from the slider to the pose: {min(waits):.2f} ... {max(waits):.2f} s")
    assert sorted(waits)[1] < 0.5  # the machine may be busy with other things
