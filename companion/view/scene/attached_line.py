"""A line from a drone to a place near it, which moves with the drone."""

from __future__ import annotations

import numpy as np
import viser

from companion.model import Array
from companion.present import Rgb
from companion.view.scene.move import Move
from companion.view.state.visible import show

_SEEN_M, _SEEN = 0.01, 0.01  # m, and of its length: a smaller change is not sent


class AttachedLine:
    """Only the view thread may call it. name: a node under the drone's, whose place is where the line begins."""

    def __init__(self, scene: viser.SceneApi, name: str, colour: Rgb, thickness: float) -> None:
        nothing = np.zeros((1, 2, 3), dtype=np.float32)
        self._line = scene.add_line_segments(name, nothing, colour, thickness=thickness, thickness_units="screen")
        self.end: Array = np.zeros(3)  # m NED from the drone

    @property
    def visible(self) -> bool:
        """Whether it is drawn where its drone is."""
        return self._line.visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        show(self._line, visible)

    def moves(self, end: Array) -> list[Move]:
        """What changes when it is drawn to `end` (3,) m NED from the drone."""
        if np.abs(end - self.end).max() <= min(_SEEN_M, _SEEN * float(np.linalg.norm(end))):
            return []
        self.end = end
        return [Move(self._line, "points", np.array([[np.zeros(3), end]], dtype=np.float32))]
