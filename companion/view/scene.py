"""The world in three dimensions: two drones, their trails, the line between them, and the ground below."""

from __future__ import annotations

import numpy as np
import viser

from companion.view import palette
from companion.view.arrows import Arrows
from companion.view.body import Body
from companion.view.framing import Framing
from companion.view.moment import Footage, Moment
from companion.view.shapes import Drone
from companion.view.trail import Trail

WORLD = "/world"
"""Everything hangs on this node. Each browser has a node of its own under this name, which moves the world for it."""


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
        scene.add_frame(WORLD, show_axes=False)
        self._grid = scene.add_grid(
            f"{WORLD}/grid",
            plane="xy",
            infinite_grid=True,
            shadow_opacity=0.0,
        )
        self.shade(dark=False)
        self._north = scene.add_arrows(f"{WORLD}/north", np.zeros((1, 2, 3)), (90, 90, 90))
        self._north_name = scene.add_label(f"{WORLD}/north_name", "North", anchor="center-center")
        self._home = scene.add_line_segments(
            f"{WORLD}/home",
            np.zeros((1, 2, 3), dtype=np.float32),
            (90, 90, 90),
            thickness=3.0,
            thickness_units="screen",
        )
        self._home_name = scene.add_label(f"{WORLD}/home_name", "Start", anchor="top-center")
        self.autopilot = Body(scene, f"{WORLD}/autopilot", "Autopilot", palette.AUTOPILOT, drone, ghost=True)
        self.imu = Body(scene, f"{WORLD}/imu", "IMU alone", palette.IMU, drone, ghost=False)
        self.arrows = Arrows(scene, f"{WORLD}/arrows")
        self.range_shown = False
        self._expected = scene.add_icosphere(
            f"{WORLD}/expected", 1.0, palette.IMU, opacity=0.12, visible=False, cast_shadow=False, receive_shadow=False
        )
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
        self._ground = self._cell = 0.0
        self._has_position = True

    @property
    def cell(self) -> float:
        """Side of the grid's squares, m."""
        return self._cell

    def load(self, film: Footage, framing: Framing, drone: Drone) -> None:
        """Lay out the ground for another reckoning, its trails, and the vehicle."""
        replay = film.replay
        for body in (self.autopilot, self.imu):
            if body.drone is not drone:
                body.reshape(drone)
        self.arrows.load(float(np.linalg.norm(replay.velocity_ref, axis=1).max()))
        self._has_position = replay.has_position
        self._ground = framing.ground
        self._grid.position = np.array([0.0, 0.0, framing.ground])
        self._grid.fade_distance = 12 * framing.radius
        self.rule(framing.cell)
        north, east = (float(x) for x in replay.position_ref[0, :2])
        arm = 0.04 * framing.radius
        cross = [[(north - arm, east), (north + arm, east)], [(north, east - arm), (north, east + arm)]]
        self._home.points = np.pad(np.array(cross), ((0, 0), (0, 0), (0, 1)), constant_values=framing.ground).astype(
            np.float32
        )
        self._home_name.position = np.array([north, east, framing.ground])
        self._home.visible = self._home_name.visible = replay.has_position
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

    def rule(self, cell: float) -> None:
        """Draw the ground in squares of `cell` m."""
        if cell != self._cell:
            self._cell = cell
            self._grid.cell_size = cell
            self._grid.section_size = 5 * cell

    def shade(self, *, dark: bool) -> None:
        """Ground lines that are there and do not shout, on a dark page or a light one."""
        self._grid.cell_color = (52, 52, 52) if dark else (222, 222, 222)
        self._grid.section_color = (90, 90, 90) if dark else (190, 190, 190)

    def show(self, moment: Moment) -> None:
        """Put both drones, and what hangs on them, where they are at `moment`."""
        self.imu.put(moment.q_imu, moment.position_imu)
        self.autopilot.put(moment.q_ref, moment.position_ref)
        if self._has_position:
            ends = np.stack([moment.position_ref, moment.position_imu])
            feet = ends.copy()
            feet[:, 2] = self._ground
            self._error.points = ends[None].astype(np.float32)
            self._sticks.points = np.stack([ends, feet], axis=1).astype(np.float32)
        self.arrows.show(moment, self._has_position)
        if moment.sigma_m > 0:
            self._expected.position = moment.position_imu

    def annotate(self, moment: Moment, span: float, *, imu_above: bool) -> None:
        """What a reader needs less often than an eye: the length of the error line, the size of the drones.

        The names stand outside: above the drone that is the upper one in the picture and below the other.
        """
        self.imu.resize(span, name_above=imu_above)
        self.autopilot.resize(span, name_above=not imu_above)
        self.arrows.resize(span)
        self._expect(moment.sigma_m if self._has_position and self.range_shown else 0.0)
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

    def _expect(self, sigma: float) -> None:
        """The ball in which the autopilot should be, three standard deviations wide."""
        visible = sigma > 0
        if self._expected.visible != visible:
            self._expected.visible = visible
        if visible and abs(3 * sigma - self._expected.radius) > 0.02 * self._expected.radius:
            self._expected.radius = 3 * sigma

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
