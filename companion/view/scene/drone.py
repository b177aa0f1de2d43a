"""What stands in the world at an instant: drones with names, velocities and gravity as arrows, an ellipsoid of 3σ."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt
import viser

from companion.model import STANDARD_GRAVITY, Array
from companion.present import Rgb, palette
from companion.strapdown import quaternion
from companion.view.scene.vehicle_shapes import Drone
from companion.view.state.trajectory import Sample

WORLD = "/world"
"""Everything hangs on this node. Each browser has a node of its own under this name, which moves the world for it."""
AUTOPILOT, IMU = f"{WORLD}/autopilot", f"{WORLD}/imu"
"""The drones' places: what hangs on them moves with them, but does not turn."""
NEARER, NEARER_SCALE = f"{WORLD}/nearer", 0.998
"""The autopilot's path is thin and lies over the IMU's, which is thick, so that both are seen where they are the same.
It is drawn as much smaller about the camera: at the same place in the picture, but nearer."""


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
        self.attitude = scene.add_frame(f"{root}/attitude", show_axes=False)
        self._span = 0.0
        self._meshes: list[viser.MeshHandle] = []
        self.label = scene.add_label(f"{root}/name", label, font_screen_scale=1.1)
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
    def position(self) -> Array:
        """The place on screen, NED m."""
        return np.array(self.place.position)  # a copy: viser writes into its own

    def moves(self, wxyz: Array, position: Array) -> list[Move]:
        """What changes when it has the attitude (4,) and the place (3,)."""
        return [Move(self.attitude, "wxyz", wxyz), Move(self.place, "position", position)]

    def resize(self, span: float, *, name_at: float) -> None:
        """Draw the drone `span` m wide, its name so many spans below (above, when negative).

        A change too small to see is not sent.
        """
        if abs(span - self._span) > 0.04 * self._span:
            self._span = span
            for mesh in self._meshes:
                mesh.scale = span * (GHOST_SCALE if self._ghost else 1.0)
        self.label.anchor = "bottom-center" if name_at < 0 else "top-center"
        self.label.position = (0.0, 0.0, name_at * self._span)


LONGEST = 2.4  # spans of a drone: the arrow of the fastest instant of the flight
SHORTEST = 0.7  # spans: shorter ones would be hidden in the drone
STILL = 0.05  # m/s: what the autopilot's estimate wanders at rest
GREY = (110, 110, 110)


def arrow_length(speed: float, fastest: float) -> float:
    """Spans of a drone that an arrow for `speed` m/s is long, where `fastest` m/s is the longest; 0 at rest."""
    if speed < STILL:
        return 0.0
    return SHORTEST + (LONGEST - SHORTEST) * min(speed / max(fastest, STILL), 1.0)


class Arrows:
    """The velocity of both in their own colours, and gravity at the IMU's. Hidden until chosen."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        nothing = np.zeros((1, 2, 3))
        self._handles = [
            scene.add_arrows(f"{root}/{name}", nothing, linear_light(colour), visible=False)
            for name, colour in (("ref", palette.AUTOPILOT), ("imu", palette.IMU), ("gravity", GREY))
        ]
        self._fastest, self._span = STILL, 0.0
        self.shown = False

    def load(self, fastest: float, colour: Rgb) -> None:
        """`fastest`: m/s, of the autopilot in this flight; `colour`: of the IMU."""
        self._fastest = fastest
        self._handles[1].colors = linear_light(colour)

    def resize(self, span: float) -> None:
        """Match drones `span` m wide."""
        if abs(span - self._span) > 0.04 * self._span:
            self._span = span
            for handle in self._handles:
                handle.shaft_radius, handle.head_radius, handle.head_length = 0.03 * span, 0.09 * span, 0.22 * span

    def show(self, sample: Sample, has_position: bool) -> None:
        """Draw what holds at `sample`. Without a position there is no velocity, and only gravity is drawn."""
        down = np.array([0.0, 0.0, STANDARD_GRAVITY])
        vectors: list[tuple[Array, Array, float]] = [
            (sample.position_ref, sample.velocity_ref, arrow_length(_norm(sample.velocity_ref), self._fastest)),
            (sample.position_imu, sample.velocity_imu, arrow_length(_norm(sample.velocity_imu), self._fastest)),
            (sample.position_imu, down, 1.3),
        ]
        for i, (handle, (origin, vector, length)) in enumerate(zip(self._handles, vectors, strict=True)):
            visible = self.shown and length > 0 and (has_position or i == len(vectors) - 1)
            if visible:
                tip = origin + vector / _norm(vector) * length * self._span
                handle.points = np.stack([origin, tip])[None].astype(np.float32)
            handle.visible = visible


def linear_light(colours: Rgb | Array) -> npt.NDArray[np.uint8]:
    """Colours (..., 3) as viser 1.1 wants them for arrows and points: it takes those for linear light.

    Else orange turns yellow, and red pink.
    """
    return (255.0 * (np.asarray(colours) / 255.0) ** 2.2).round().astype(np.uint8)


def _norm(v: Array) -> float:
    return float(np.linalg.norm(v))


SIGMAS = 3.0
MOST_M = 1e5
_CHANGE = 0.02  # part of a semi-axis (rad for the turn) that is too small to see


def semi_axes(covariance: Array) -> tuple[Array, Array]:
    """(3,) lengths of the semi-axes of one standard deviation, m, and (4,) wxyz that turns x, y, z into them, NED."""
    values, vectors = np.linalg.eigh(covariance)
    if np.linalg.det(vectors) < 0:
        vectors[:, 2] = -vectors[:, 2]
    return np.sqrt(np.maximum(values, 0.0)), quaternion.from_matrix(vectors)


class Ellipsoid:
    """A pale body around the IMU, on demand. Only the view thread may call it."""

    def __init__(self, scene: viser.SceneApi, name: str, colour: Rgb) -> None:
        self.shown = False
        self._scale, self._turn = np.zeros(3), np.zeros(4)
        self.node = scene.add_icosphere(
            name, 1.0, colour, opacity=0.14, visible=False, cast_shadow=False, receive_shadow=False
        )

    def load(self, colour: Rgb) -> None:
        """Take the colour of another IMU."""
        self.node.color = colour

    def put(self, position: Array) -> None:
        """Move it, NED m."""
        if self.node.visible:
            self.node.position = position

    def shape(self, covariance: Array, position: Array) -> None:
        """Take the form of `covariance` (3, 3), m²: zero hides it."""
        axes, turn = semi_axes(covariance)
        axes = np.clip(SIGMAS * axes, 0.0, MOST_M)
        visible = self.shown and bool(axes.max() > 0)
        near = np.abs(axes - self._scale) <= _CHANGE * self._scale
        if visible and (not near.all() or abs(float(turn @ self._turn)) < 1 - _CHANGE**2):
            self._scale, self._turn = axes, turn
            x, y, z = (max(float(a), 1e-6) for a in axes)
            self.node.scale = (x, y, z)
            self.node.wxyz = turn
        self.node.visible = visible
        self.put(position)
