"""The world in three dimensions: two drones, their trails, the line between them, and the ground below."""

from __future__ import annotations

import numpy as np
import viser

from companion.tracks import Array
from companion.view import palette
from companion.view.framing import Framing, Pose
from companion.view.moment import Footage, Moment
from companion.view.palette import Rgb
from companion.view.shapes import Drone
from companion.view.trail import Trail

WORLD = "/world"
GHOST_SCALE = 0.94
"""The ghost is a little smaller: where both drones coincide it is inside the solid one and does not flicker."""


class Body:
    """One drone on screen: a place, an attitude, a size, a name and a stick down to the ground."""

    def __init__(self, scene: viser.SceneApi, name: str, label: str, colour: Rgb, drone: Drone, ghost: bool) -> None:
        self._scale = GHOST_SCALE if ghost else 1.0
        self._place = scene.add_frame(f"{WORLD}/{name}", show_axes=False)
        self._attitude = scene.add_frame(f"{WORLD}/{name}/attitude", show_axes=False)
        self._meshes = [
            scene.add_mesh_simple(
                f"{WORLD}/{name}/attitude/{part}",
                mesh.vertices,
                mesh.faces,
                color=tint,
                opacity=0.45 if ghost else None,
                flat_shading=True,
                cast_shadow=False,
                receive_shadow=False,
            )
            for part, mesh, tint in (
                ("body", drone.body, colour),
                ("front", drone.front, palette.mix(colour, (255, 255, 255), 0.6)),
            )
        ]
        self._name = scene.add_label(f"{WORLD}/{name}/name", label, font_screen_scale=1.1)
        self._span = 0.0

    @property
    def wxyz(self) -> Array:
        """The attitude on screen, NED/FRD."""
        return np.array(self._attitude.wxyz)  # a copy: viser writes into its own

    @property
    def position(self) -> Array:
        """The place on screen, NED m."""
        return np.array(self._place.position)

    @property
    def name(self) -> str:
        """What is written beside it."""
        return self._name.text

    @name.setter
    def name(self, text: str) -> None:
        if text != self._name.text:
            self._name.text = text

    def put(self, wxyz: Array, position: Array) -> None:
        """Set attitude (4,) and place (3,)."""
        self._attitude.wxyz = wxyz
        self._place.position = position

    def resize(self, span: float, *, name_above: bool) -> None:
        """Draw the drone `span` m wide, its name above or below; a change too small to see is not sent."""
        if abs(span - self._span) > 0.04 * self._span:
            self._span = span
            for mesh in self._meshes:
                mesh.scale = span * self._scale
        self._name.anchor = "bottom-center" if name_above else "top-center"
        self._name.position = (0.0, 0.0, -0.42 * self._span if name_above else 0.42 * self._span)


class Scene:
    """Everything that stands in the world. Only the view thread may call it."""

    def __init__(self, scene: viser.SceneApi, drone: Drone) -> None:
        scene.set_up_direction("-z")
        scene.world_axes.visible = False
        # Our own lights, from above and from all around: viser's wash out colours, and here colours mean something.
        scene.configure_default_lights(enabled=False)
        scene.configure_environment_map(None)
        scene.add_light_ambient("/light_around", intensity=1.7)
        scene.add_light_directional("/light_above", intensity=2.2, position=(-300.0, -500.0, -1000.0))
        self._world = scene.add_frame(WORLD, show_axes=False)
        self._grid = scene.add_grid(
            f"{WORLD}/grid",
            plane="xy",
            infinite_grid=True,
            shadow_opacity=0.0,
        )
        self.shade(dark=False)
        self._north = scene.add_arrows(f"{WORLD}/north", np.zeros((1, 2, 3)), (90, 90, 90))
        self._north_name = scene.add_label(f"{WORLD}/north_name", "North", anchor="center-center")
        self.autopilot = Body(scene, "autopilot", "Autopilot", palette.AUTOPILOT, drone, ghost=True)
        self.imu = Body(scene, "imu", "IMU alone", palette.IMU, drone, ghost=False)
        self._trails = {
            "autopilot": Trail(scene, f"{WORLD}/trail_autopilot", palette.AUTOPILOT, 2.5),
            "imu": Trail(scene, f"{WORLD}/trail_imu", palette.IMU, 2.5),
        }
        nothing = np.zeros((1, 2, 3), dtype=np.float32)
        self._error = scene.add_line_segments(
            f"{WORLD}/error", nothing, palette.DIFFERENCE, thickness=4.0, thickness_units="screen"
        )
        self._error_name = scene.add_label(
            f"{WORLD}/error_name", "", anchor="center-center", font_screen_scale=1.1, visible=False
        )
        self._sticks = scene.add_line_segments(
            f"{WORLD}/sticks",
            np.zeros((2, 2, 3), dtype=np.float32),
            (140, 140, 140),
            thickness=1.0,
            thickness_units="screen",
        )
        self._ground = 0.0
        self._has_position = True

    def load(self, film: Footage, framing: Framing) -> None:
        """Lay out the ground for another reckoning, and its trails."""
        replay = film.replay
        self._has_position = replay.has_position
        self._ground = framing.ground
        self._grid.position = np.array([0.0, 0.0, framing.ground])
        self._grid.cell_size = framing.cell
        self._grid.section_size = 5 * framing.cell
        self._grid.fade_distance = 12 * framing.radius
        size = 0.3 * framing.radius
        start = np.array([framing.low[0], (framing.centre[1] + framing.high[1]) / 2, framing.ground])
        self._north.points = np.array([[start, start + np.array([size, 0.0, 0.0])]], dtype=np.float32)
        self._north.shaft_radius = 0.025 * size
        self._north.head_radius = 0.07 * size
        self._north.head_length = 0.22 * size
        self._north_name.position = start + np.array([1.3 * size, 0.0, 0.0])
        self._trails["autopilot"].load(replay.t, replay.position_ref, film.restarts[:0])
        self._trails["imu"].load(replay.t, replay.position_imu, film.restarts)
        self._error.visible = self._sticks.visible = replay.has_position
        self._error_name.visible = False
        self.imu.name = "IMU alone"

    def shade(self, *, dark: bool) -> None:
        """Ground lines that are there and do not shout, on a dark page or a light one."""
        self._grid.cell_color = (52, 52, 52) if dark else (222, 222, 222)
        self._grid.section_color = (90, 90, 90) if dark else (190, 190, 190)

    def show(self, moment: Moment, world: Pose) -> None:
        """Put both drones, and what hangs on them, where they are at `moment`."""
        self._world.wxyz = world.wxyz
        self._world.position = world.position
        self.imu.put(moment.q_imu, moment.position_imu)
        self.autopilot.put(moment.q_ref, moment.position_ref)
        if self._has_position:
            ends = np.stack([moment.position_ref, moment.position_imu])
            feet = ends.copy()
            feet[:, 2] = self._ground
            self._error.points = ends[None].astype(np.float32)
            self._sticks.points = np.stack([ends, feet], axis=1).astype(np.float32)

    def annotate(self, moment: Moment, span: float, *, imu_above: bool) -> None:
        """What a reader needs less often than an eye: the length of the error line, the size of the drones.

        The names stand outside: above the drone that is the upper one in the picture and below the other.
        """
        self.imu.resize(span, name_above=imu_above)
        self.autopilot.resize(span, name_above=not imu_above)
        if not self._has_position:
            return
        # On the line when there is room between the drones, else with the name of the one that is wrong.
        apart = f"{length(moment.position_m)} apart"
        roomy = moment.position_m > 1.5 * span
        self.imu.name = "IMU alone" if roomy else f"IMU alone, {apart}"
        if self._error_name.visible != roomy:
            self._error_name.visible = roomy
        if roomy:
            self._error_name.text = apart
            self._error_name.position = (moment.position_ref + moment.position_imu) / 2

    def trails(self, since: float, until: float) -> None:
        """Show both paths between two times, s."""
        for trail in self._trails.values():
            trail.show(since, until)


def length(metres: float) -> str:
    """A length as a person says it."""
    if metres < 10:
        return f"{metres:.2f} m"
    if metres < 1000:
        return f"{metres:.1f} m" if metres < 100 else f"{metres:.0f} m"
    return f"{metres / 1000:.2f} km"
