"""What a live page adds to the scene: the paths behind the drones, and the ball where the IMU left alone would be."""

from __future__ import annotations

import numpy as np
import viser

from companion.analysis import FreeState
from companion.model import Array
from companion.view import palette
from companion.view.moment import Footage
from companion.view.scene import AUTOPILOT, IMU, WORLD
from companion.view.visible import show
from companion.view.wake import Wake

_FARTHEST_M = 1e7  # a ball beyond that is not drawn
_JUST_BEGUN_S = 1.5  # a free run begins a second before it is first seen


class Wakes:
    """The three paths and the ball. Only the view thread may call it."""

    def __init__(self, scene: viser.SceneApi, seconds: float) -> None:
        self._autopilot = Wake(scene, f"{WORLD}/wake_autopilot", AUTOPILOT, palette.AUTOPILOT, 2.5, seconds)
        self._imu = Wake(scene, f"{WORLD}/wake_imu", IMU, palette.IMU, 2.5, seconds)
        ball = f"{WORLD}/free"
        self._ball = scene.add_icosphere(ball, 1.0, palette.FREE, visible=False, cast_shadow=False)
        self._free = Wake(scene, f"{WORLD}/wake_free", ball, palette.FREE, 2.0, seconds)
        self._all = (self._autopilot, self._imu, self._free)
        self._anchor = np.nan
        self._was_free = False

    def clear(self) -> None:
        """Forget all paths."""
        for wake in self._all:
            wake.clear()
        self._anchor, self._was_free = np.nan, False

    def add(self, film: Footage, free: FreeState | None) -> None:
        """Go on to the last sample of the film."""
        t, anchor = film.end, float(film.replay.anchors[-1])
        if not film.replay.has_position:
            return
        self._autopilot.add(t, film.replay.position_ref[-1])
        self._imu.add(t, film.replay.position_imu[-1], broken=anchor != self._anchor)
        self._anchor = anchor
        if free is not None:
            begun = not self._was_free or t - free.anchor_s < _JUST_BEGUN_S
            self._free.add(t, free.state.position, broken=begun)
        self._was_free = free is not None

    def show(self, since: float, until: float) -> None:
        """Show what lies between two times, s, boot clock."""
        for wake in self._all:
            wake.show(since, until)

    def reach(self, now: float, ball: Array | None) -> None:
        """Lead the paths up to the drones at `now`, s, and put the ball at (3,) NED, m; None: there is none."""
        for wake in self._all:
            wake.reach(now)
        near = ball is not None and bool(np.abs(ball).max() < _FARTHEST_M)
        show(self._ball, near)
        if near and ball is not None:
            self._ball.position = ball

    def resize(self, span: float) -> None:
        """Fit the ball to drones so many m wide."""
        self._ball.radius = 0.12 * span
