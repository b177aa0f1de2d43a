"""The ground below: a grid whose squares fit the camera's distance, which way north is, where the flight began."""

from __future__ import annotations

import numpy as np
import viser

from companion.model import Array
from companion.view.scene.cameras import Framing
from companion.view.scene.trail import add_lines
from companion.view.state.places import MapPicture

GREY = (90, 90, 90)
_EAST_UP = (float(np.sqrt(0.5)), 0.0, 0.0, float(np.sqrt(0.5)))
"""Turns viser's pictures, whose right is x and whose foot is y, so that their right is east and their foot south."""


class Ground:
    """Only the view thread may call it."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._grid = scene.add_grid(f"{root}/grid", plane="xy", infinite_grid=True, shadow_opacity=0.0)
        # Seen on a light page and on a dark one: each browser has its own.
        self._grid.cell_color, self._grid.section_color = (172, 172, 172), (140, 140, 140)
        self._north = scene.add_arrows(f"{root}/north", np.zeros((1, 2, 3)), GREY)
        self._north_name = scene.add_label(f"{root}/north_name", "North", anchor="center-center")
        self._crosses = [
            (
                add_lines(scene, f"{root}/{name.lower()}", GREY, 3.0),
                scene.add_label(f"{root}/{name.lower()}_name", name, anchor="top-center", visible=False),
            )
            for name in ("Start", "Home")
        ]
        self._map: list[viser.ImageHandle | viser.LabelHandle] = []
        self._scene, self._root = scene, root
        self._credited = np.zeros(3)  # where it stands whose map it is: in the first picture of the flight
        self.cell = 0.0  # side of the squares, m
        self.level = 0.0  # down coordinate, m

    def load(self, framing: Framing, start: Array | None, home: Array | None) -> None:
        """Lay it out. start, home: NED, m, or None where they are not known; a start at home is not marked twice."""
        self.sink(framing.ground)
        self._grid.fade_distance = 12 * framing.radius
        self.rule(framing.cell)
        self._credited = np.array([framing.low[0], (framing.centre[1] + framing.low[1]) / 2, framing.ground])
        size = 0.3 * framing.radius
        foot = np.array([framing.low[0], (framing.centre[1] + framing.high[1]) / 2, framing.ground])
        self._north.points = np.array([[foot, foot + np.array([size, 0.0, 0.0])]], dtype=np.float32)
        self._north.shaft_radius, self._north.head_radius = 0.025 * size, 0.07 * size
        self._north.head_length = 0.22 * size
        self._north_name.position = foot + np.array([1.3 * size, 0.0, 0.0])
        arm = 0.04 * framing.radius
        if start is not None and home is not None and np.linalg.norm((start - home)[:2]) < 3 * arm:
            start = None
        ends = arm * np.array([[[-1, 0, 0], [1, 0, 0]], [[0, -1, 0], [0, 1, 0]]])
        for (lines, name), place in zip(self._crosses, (start, home), strict=True):
            lines.visible = name.visible = place is not None
            if place is not None:
                below = np.array([place[0], place[1], framing.ground])
                lines.points, name.position = (below + ends).astype(np.float32), below

    @property
    def names(self) -> list[tuple[viser.LabelHandle, bool]]:
        """What is written on it, and whether there is such a thing."""
        return [*((name, lines.visible) for lines, name in self._crosses), (self._north_name, True)]

    def sink(self, level: float) -> None:
        """Lower it to a down coordinate, m: a vehicle has flown below it."""
        self.level = level
        self._grid.position = np.array([0.0, 0.0, level])

    def show_map(self, picture: MapPicture | None) -> None:
        """Lay a picture under the flight, at the height of its origin or below the lowest point flown; None: none."""
        for node in self._map:
            node.remove()
        self._map = []
        if picture is None:
            return
        down = max(0.0, self.level) + 2e-4 * float(picture.size.max())  # below the grid, which would flicker else
        image = self._scene.add_image(
            f"{self._root}/map",
            picture.pixels,
            float(picture.size[1]),
            float(picture.size[0]),
            format="jpeg",
            cast_shadow=False,
            receive_shadow=False,
            wxyz=_EAST_UP,
            position=(float(picture.centre[0]), float(picture.centre[1]), down),
        )
        credit = self._scene.add_label(
            f"{self._root}/map_credit", picture.credit, anchor="center-center", position=self._credited
        )
        self._map = [image, credit]

    def rule(self, cell: float) -> None:
        """Draw squares of `cell` m."""
        self.cell = self._grid.cell_size = cell
        self._grid.section_size = 5 * cell
