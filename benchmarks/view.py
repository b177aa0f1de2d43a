"""How quick the viewer is: from a slider to the pose for ten minutes at 100 Hz, and pose updates while it plays.

    python benchmarks/view.py

Half a second is what a hand on a slider takes for at once; 20 updates a second are what an eye takes for motion.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

import companion as c
from companion.app.settings import Settings
from companion.pages.replay import Answers
from companion.simulate import SimulatedVehicle, fly, write_flight
from companion.view import Viewer

STREAMS = {"RAW_IMU": 100.0, "ATTITUDE": 50.0, "LOCAL_POSITION_NED": 20.0}
LIMIT_S = 30.0


def ten_minutes() -> c.Flight:
    """A simulated flight."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "flight.tlog"
        write_flight(SimulatedVehicle(fly(600.0), streams=STREAMS), path)
        return c.open_log(path)[0]


def slider_to_pose(viewer: Viewer, bias: float) -> float:
    """Seconds until the pose has moved."""
    before, begun = viewer.controller.scene.imu.position, time.perf_counter()
    viewer.post(partial(viewer.controller.change, partial(replace, gyro_bias=(bias, 0.0, 0.0))))
    while np.array_equal(viewer.controller.scene.imu.position, before) and time.perf_counter() < begun + LIMIT_S:
        time.sleep(0.005)
    return time.perf_counter() - begun


def main() -> None:
    """Measure both."""
    answers = Answers(Settings())
    with Viewer([ten_minutes()], answers.recompute, answers.examine, port=0) as viewer:
        viewer.post(partial(viewer.player.seek, viewer.player.first + 9.9))
        waits = [slider_to_pose(viewer, 1e-3 * i) for i in range(1, 8)]
        print(f"from the slider to the pose: median {np.median(waits):.2f} s, most {max(waits):.2f} s (0.5 is at once)")
        viewer.post(viewer.player.toggle)
        updates, begun = viewer.controller.pose_updates, time.perf_counter()
        time.sleep(3.0)
        rate = (viewer.controller.pose_updates - updates) / (time.perf_counter() - begun)
        print(f"pose updates while it plays: {rate:.0f}/s (20 look like motion)")


if __name__ == "__main__":
    main()
