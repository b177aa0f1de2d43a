"""One drone on screen: a place, an attitude, a size and a name; and what changes from instant to instant."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt
import viser

from companion.model import Array
from companion.present import Rgb, palette
from companion.view.scene.vehicle_shapes import Drone

WORLD = "/world"
"""Everything hangs on this node. Each browser has a node of its own under this name, which moves the world for it."""
AUTOPILOT, IMU = f"{WORLD}/autopilot", f"{WORLD}/imu"
"""The drones' places: what hangs on them moves with them, but does not turn."""


class Move(NamedTuple):
    """A new value of a node's property."""

    node: viser.SceneNodeHandle
    name: Literal["wxyz", "position", "points"]
    value: Array | npt.NDArray[np.float32]  # (4,) quaternion, (3,) m from the node above, or (M, 2, 3) float32, m

    def show(self) -> None:
        """Write it to whoever looks."""
        setattr(self.node, self.name, self.value)


GHOST_SCALE = 0.94
"""The ghost is a little smaller: where both drones coincide it is inside the solid one and does not flicker."""


class Body:
    """A drone. Only the view thread may call it."""

    def __init__(self, scene: viser.SceneApi, root: str, label: str, colour: Rgb, drone: Drone, ghost: bool) -> None:
        self._scene, self._root, self._ghost = scene, root, ghost
        self.place = scene.add_frame(root, show_axes=False)
        self._attitude = scene.add_frame(f"{root}/attitude", show_axes=False)
        self._span = 0.0
        self._meshes: list[viser.MeshHandle] = []
        self.label = scene.add_label(f"{root}/name", label, font_screen_scale=1.1)
        self._label_below = 0.0  # m from the drone to its name, negative above it
        self._look: tuple[Drone, Rgb] | None = None
        self.reshape(drone, colour)

    def reshape(self, drone: Drone, colour: Rgb) -> None:
        """Become another vehicle, or another source."""
        if self._look == (drone, colour):
            return
        self._look = (drone, colour)
        self._meshes = [
            self._scene.add_mesh_simple(  # a node of the same name takes the place of the old one
                f"{self._root}/attitude/{part}",
                mesh.vertices,
                mesh.faces,
                color=tint,
                opacity=0.45 if self._ghost else None,
                flat_shading=True,
                cast_shadow=False,
                receive_shadow=False,
            )
            for part, mesh, tint in (
                ("body", drone.body, colour),
                ("front", drone.front, palette.mix(colour, (255, 255, 255), 0.6)),
            )
        ]
        self._span = 0.0  # the next size is sent

    @property
    def wxyz(self) -> Array:
        """The attitude on screen, NED/FRD."""
        return np.array(self._attitude.wxyz)  # a copy: viser writes into its own

    @property
    def position(self) -> Array:
        """The place on screen, NED m."""
        return np.array(self.place.position)

    def moves(self, wxyz: Array, position: Array) -> list[Move]:
        """What changes when it has the attitude (4,) and the place (3,)."""
        return [Move(self._attitude, "wxyz", wxyz), Move(self.place, "position", position)]

    def resize(self, span: float, *, name_at: float) -> None:
        """Draw the drone `span` m wide, its name so many spans below (above, when negative).

        A change too small to see is not sent.
        """
        if abs(span - self._span) > 0.04 * self._span:
            self._span = span
            for mesh in self._meshes:
                mesh.scale = span * (GHOST_SCALE if self._ghost else 1.0)
        below = name_at * self._span
        if below != self._label_below:
            self._label_below = below
            self.label.anchor = "bottom-center" if below < 0 else "top-center"
            self.label.position = (0.0, 0.0, below)
