"""The world in three dimensions: two drones, their trails, the line between them, and the ground below."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import viser

from companion.model import Array
from companion.present import Rgb, length, palette
from companion.view.scene.cameras import Framing
from companion.view.scene.drone import AUTOPILOT, IMU, NEARER, NEARER_SCALE, WORLD, Arrows, Body, Ellipsoid, Move
from companion.view.scene.ground import Ground
from companion.view.scene.names import Picture, give_way
from companion.view.scene.paths import ExtraPaths, Overview
from companion.view.scene.trail import OUTLINE, AttachedLine, Trail
from companion.view.scene.vehicle_shapes import Drone
from companion.view.state.sending import by_shape
from companion.view.state.trajectory import DisplayTrajectory, Sample

NAME = 0.42  # spans from a drone to its name


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
        self.ground = Ground(scene, WORLD)
        self.autopilot = Body(scene, AUTOPILOT, "Autopilot", palette.AUTOPILOT, drone, ghost=True)
        self.imu = Body(scene, IMU, "IMU alone", palette.IMU, drone, ghost=False)
        self._nearer = scene.add_frame(NEARER, show_axes=False)
        self.overview = Overview(scene, f"{WORLD}/overview")
        self.extra_paths = ExtraPaths(scene, f"{WORLD}/extra")
        self.arrows = Arrows(scene, f"{WORLD}/arrows")
        self.expected = Ellipsoid(scene, f"{WORLD}/expected", palette.IMU)
        self._trail = Trail(scene, f"{NEARER}/trail", palette.AUTOPILOT, 2.0, scale=NEARER_SCALE)
        # Of the IMU that is chosen, then of the others: as many as were ever shown at once, reused.
        self._imus = [(self.imu, Trail(scene, f"{WORLD}/trail_imu", palette.IMU, 4.5))]
        self._scene, self._label = scene, "IMU"
        self._others: Sequence[DisplayTrajectory] = ()
        # They hang on the drones: a browser moves what is in a place at once, but a busy one is late with new points.
        self._error = AttachedLine(scene, f"{AUTOPILOT}/error", palette.DIFFERENCE, 4.0)
        self._error_name = scene.add_label(
            f"{AUTOPILOT}/error_name", "", anchor="center-center", font_screen_scale=1.1, visible=False
        )
        self._sticks = [AttachedLine(scene, f"{drone}/stick", (140, 140, 140), 1.0) for drone in (AUTOPILOT, IMU)]
        self._has_position = True

    def load(
        self,
        display: DisplayTrajectory,
        framing: Framing,
        drone: Drone,
        colours: Mapping[str, Rgb] | None = None,
        home: Array | None = None,
        *,
        whole: bool = True,
    ) -> None:
        """Lay out another trajectory. colours: of each IMU message; home: NED, m, where it is known.

        whole: whether `display` is all that is flown, so that it can be drawn at once.
        """
        replay, source = display.replay, display.source
        colours = colours or {}
        colour = colours.get(source, palette.IMU)
        self._label, self._has_position = source, replay.has_position
        self.autopilot.reshape(drone, palette.AUTOPILOT)
        self.arrows.load(float(np.linalg.norm(replay.velocity_ref, axis=1).max()), colour)
        self.expected.load(colour)
        known = replay.has_position
        self.ground.load(framing, replay.position_ref[0] if known else None, home if known else None)
        outlines = {"imu": by_shape(replay.position_imu, OUTLINE), "autopilot": by_shape(replay.position_ref, OUTLINE)}
        self._trail.load(replay.t, replay.position_ref, display.restarts[:0], palette.AUTOPILOT, outlines["autopilot"])
        if whole:
            self.overview.load(display, colour, outlines["autopilot"])
        for line in (self._error, *self._sticks):
            line.node.visible = known
        self._error_name.visible = False
        self._others = tuple(display.others.values())
        for i in range(len(self._imus), 1 + len(self._others)):
            root = f"{WORLD}/other{i}"
            body = Body(self._scene, root, "", palette.IMUS[1], drone, ghost=False)
            self._imus.append((body, Trail(self._scene, f"{root}_trail", palette.IMUS[1], 1.8)))
        for body, trail in self._imus[1:]:
            body.place.visible = False
            trail.hide()
        for (body, trail), (name, shown) in zip(self._imus, display.by_imu.items(), strict=False):
            is_chosen, r, shade = shown is display, shown.replay, colours.get(name, palette.IMU)
            body.reshape(drone, shade)
            body.label.text = f"{name} alone" if is_chosen else name
            body.place.visible = True
            trail.load(r.t, r.position_imu, shown.restarts, shade, outlines["imu"] if is_chosen else None)

    def seen_from(self, eye: Array) -> None:
        """The camera is at (3,) NED, m: see `NEARER`."""
        place = (1.0 - NEARER_SCALE) * eye
        if np.linalg.norm(place - self._nearer.position) > 1e-4 * np.linalg.norm(eye):
            self._nearer.position = place

    def show(self, sample: Sample) -> None:
        """Put the drones, and what hangs on them, where they are at `sample`."""
        for move in self.moves(sample):
            move.show()
        self.overview.show(sample.t)
        self.arrows.show(sample, self._has_position)
        self.expected.put(sample.position_imu)

    def moves(self, sample: Sample) -> list[Move]:
        """What changes at `sample`, without what is shown on demand."""
        moves = self.imu.moves(sample.q_imu, sample.position_imu)
        moves += self.autopilot.moves(sample.q_ref, sample.position_ref)
        if self._has_position:
            moves += self._error.moves((sample.position_imu - sample.position_ref).tolist())
            for stick, place in zip(self._sticks, (sample.position_ref, sample.position_imu), strict=True):
                moves += stick.moves((0.0, 0.0, self.ground.level - float(place[2])))
        for (body, _), trajectory in zip(self._imus[1:], self._others, strict=False):
            other = trajectory.at(sample.t)
            moves += body.moves(other.q_imu, other.position_imu)
        return moves

    def annotate(self, sample: Sample, span: float, picture: Picture) -> None:
        """What a reader needs less often than an eye: the length of the error line, the size of the drones, and names.

        Those of the drones stand outside: above the one that is the upper one in the picture and below the other.
        picture: what a camera sees, in which no name lies on another.
        """
        imu, autopilot = picture.at(sample.position_imu), picture.at(sample.position_ref)
        imu_above = imu is None or autopilot is None or imu[1] >= autopilot[1]
        self.imu.resize(span, name_at=-NAME if imu_above else NAME)
        self.autopilot.resize(span, name_at=NAME if imu_above else -NAME)
        self.arrows.resize(span)
        self.expected.shape(sample.covariance if self._has_position else np.zeros((3, 3)), sample.position_imu)
        for i, (body, _) in enumerate(self._imus[1:], 2):
            body.resize(span, name_at=1.5 * NAME * i)  # each a line lower
        if self._has_position:
            self._name_distance(sample, span)
        drones = [(self.imu, sample.position_imu), (self.autopilot, sample.position_ref)]
        drones += [(body, body.position) for body, _ in self._imus[1 : 1 + len(self._others)]]
        names = [(body.label, place + body.label.position) for body, place in drones]
        names.append((self._error_name, sample.position_ref + self._error_name.position))
        taken = [picture.around(place, span) for _, place in drones]
        taken += [picture.box(name, place) for name, place in names if name.visible]
        give_way(picture, taken, [self.overview.name, *self.ground.names])

    def _name_distance(self, sample: Sample, span: float) -> None:
        # On the line when there is room between the drones, else one name for both.
        apart = f"{length(sample.position_m)} apart"
        roomy = sample.position_m > 1.5 * span
        self.imu.label.text = f"{self._label} alone" if roomy else apart
        self.autopilot.label.visible = self._error_name.visible = roomy
        if roomy:
            self._error_name.text = apart
            self._error_name.position = (sample.position_imu - sample.position_ref) / 2

    def trails(self, since: float, until: float) -> None:
        """Show both paths between two times, s."""
        for trail in (self._trail, *(trail for _, trail in self._imus)):
            trail.show(since, until)
