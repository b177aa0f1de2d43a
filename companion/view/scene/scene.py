"""The world in three dimensions: two drones, their trails, the line between them, the ground below, and names.

The ground: a grid whose squares fit the camera's distance, which way north is, where the flight began. Of the names
whoever comes first keeps its place, and what would lie on it, or be cut off, gives way.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import viser

from companion.model import Array
from companion.present import Rgb, length, palette
from companion.view.scene.cameras import TANGENT, UNMOVED, Camera, Framing, Pose, screen_up
from companion.view.scene.drone import AUTOPILOT, IMU, NEARER, NEARER_SCALE, WORLD, Arrows, Body, Ellipsoid, Move
from companion.view.scene.trail import OUTLINE, AttachedLine, ExtraPaths, Overview, Trail, add_lines
from companion.view.scene.vehicle_shapes import Drone
from companion.view.state.places import MapPicture
from companion.view.state.sending import by_shape
from companion.view.state.trajectory import DisplayTrajectory, Sample

_EM = 12.0  # pixels of viser's labels, times their scale
_LETTER, _LINE = 0.6, 1.6  # em: the width of a letter, the height of a line with its ground


@dataclass(frozen=True, slots=True, eq=False)
class _Box:
    """What is taken of a picture, pixels from its middle, right and up."""

    low: Array  # (2,)
    high: Array  # (2,)

    def overlaps(self, other: _Box) -> bool:
        """Whether both share a pixel."""
        return bool((self.low < other.high).all() and (other.low < self.high).all())


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """What a browser's camera sees. eye, look_at: in the browser's own world, m; pose: how NED stands in it."""

    eye: Array  # (3,)
    look_at: Array  # (3,)
    size: tuple[float, float]  # pixels, width and height
    pose: Pose = UNMOVED

    def at(self, point: Array) -> Array | None:
        """Pixels (2,) from the middle, right and up, of a place (NED, m); None: it lies behind the camera."""
        along = self.look_at - self.eye
        along, up = along / np.linalg.norm(along), screen_up(along)
        up = up / np.linalg.norm(up)
        offset = self.pose.apply(point) - self.eye
        depth = float(offset @ along)
        if depth <= 0:
            return None
        scale = self.size[1] / (2 * TANGENT * depth)
        return np.array([scale * float(offset @ np.cross(along, up)), scale * float(offset @ up)])

    def around(self, point: Array, metres: float) -> _Box | None:
        """A square so many metres wide."""
        place = self.at(point)
        if place is None:
            return None
        depth = float(np.linalg.norm(self.pose.apply(point) - self.eye))
        half = metres / 2 * self.size[1] / (2 * TANGENT * depth)
        return _Box(place - half, place + half)

    def box(self, name: viser.LabelHandle, place: Array) -> _Box | None:
        """Of a name that stands at a place (NED, m)."""
        middle = self.at(place)
        if middle is None:
            return None
        em = _EM * name.font_screen_scale
        half = np.array([0.5 * _LETTER * len(name.text), 0.5 * _LINE]) * em
        middle = middle + np.array([0.0, {"top": -1, "bottom": 1}.get(name.anchor.partition("-")[0], 0) * half[1]])
        return _Box(middle - half, middle + half)

    def shows(self, box: _Box) -> bool:
        """Whether nothing of it is cut off at the sides."""
        half = self.size[0] / 2
        return bool(box.low[0] >= -half and box.high[0] <= half)


def unseen(camera: Camera) -> Picture:
    """What a browser would see that begins there."""
    return Picture(camera.position, camera.look_at, (1280.0, 800.0))


def _give_way(picture: Picture, taken: Iterable[_Box | None], names: Iterable[tuple[viser.LabelHandle, bool]]) -> None:
    """Show those names, if they are wanted, that lie on nothing that is taken, nor on one before them.

    names: each stands in the world itself, so that its position is NED, m.
    """
    boxes = [box for box in taken if box is not None]
    for name, wanted in names:
        box = picture.box(name, name.position) if wanted else None
        free = box is not None and picture.shows(box) and not any(box.overlaps(other) for other in boxes)
        name.visible = free
        if box is not None and free:
            boxes.append(box)


_GREY = (90, 90, 90)
_EAST_UP = (float(np.sqrt(0.5)), 0.0, 0.0, float(np.sqrt(0.5)))
"""Turns viser's pictures, whose right is x and whose foot is y, so that their right is east and their foot south."""


class Ground:
    """Only the view thread may call it."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._grid = scene.add_grid(f"{root}/grid", plane="xy", infinite_grid=True, shadow_opacity=0.0)
        # Seen on a light page and on a dark one: each browser has its own.
        self._grid.cell_color, self._grid.section_color = (172, 172, 172), (140, 140, 140)
        self._north = scene.add_arrows(f"{root}/north", np.zeros((1, 2, 3)), _GREY)
        self._north_name = scene.add_label(f"{root}/north_name", "North", anchor="center-center")
        self._crosses = [
            (
                add_lines(scene, f"{root}/{name.lower()}", _GREY, 3.0),
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


_NAME = 0.42  # spans from a drone to its name


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
        self._scene = scene
        # They hang on the drones: a browser moves what is in a place at once, but a busy one is late with new points.
        self._error = AttachedLine(scene, f"{AUTOPILOT}/error", palette.DIFFERENCE, 4.0)
        self._error_name = scene.add_label(
            f"{AUTOPILOT}/error_name", "", anchor="center-center", font_screen_scale=1.1, visible=False
        )
        self._sticks = [AttachedLine(scene, f"{drone}/stick", (140, 140, 140), 1.0) for drone in (AUTOPILOT, IMU)]

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
        self._display, replay, known = display, display.replay, display.replay.has_position
        colours = colours or {}
        colour = colours.get(display.source, palette.IMU)
        self.autopilot.reshape(drone, palette.AUTOPILOT)
        self.arrows.load(float(np.linalg.norm(replay.velocity_ref, axis=1).max()), colour)
        self.expected.load(colour)
        self.ground.load(framing, replay.position_ref[0] if known else None, home if known else None)
        outlines = {"imu": by_shape(replay.position_imu, OUTLINE), "autopilot": by_shape(replay.position_ref, OUTLINE)}
        self._trail.load(replay.t, replay.position_ref, display.restarts[:0], palette.AUTOPILOT, outlines["autopilot"])
        if whole:
            self.overview.load(display, colour, outlines["autopilot"])
        for line in (self._error, *self._sticks):
            line.node.visible = known
        self._error_name.visible, self.autopilot.label.visible = False, True
        for i in range(len(self._imus), 1 + len(display.others)):
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
        self.arrows.show(sample, self._display.replay.has_position)
        self.expected.put(sample.position_imu)

    def moves(self, sample: Sample) -> list[Move]:
        """What changes at `sample`, without what is shown on demand."""
        moves = self.imu.moves(sample.q_imu, sample.position_imu)
        moves += self.autopilot.moves(sample.q_ref, sample.position_ref)
        if self._display.replay.has_position:
            moves += self._error.moves((sample.position_imu - sample.position_ref).tolist())
            for stick, place in zip(self._sticks, (sample.position_ref, sample.position_imu), strict=True):
                moves += stick.moves((0.0, 0.0, self.ground.level - float(place[2])))
        for (body, _), trajectory in zip(self._imus[1:], self._display.others.values(), strict=False):
            other = trajectory.at(sample.t)
            moves += body.moves(other.q_imu, other.position_imu)
        return moves

    def annotate(self, sample: Sample, span: float, picture: Picture) -> None:
        """What a reader needs less often than an eye: the length of the error line, the size of the drones, and names.

        Those of the drones stand outside: above the one that is the upper one in the picture and below the other.
        picture: what a camera sees, in which no name lies on another.
        """
        has_position = self._display.replay.has_position
        imu, autopilot = picture.at(sample.position_imu), picture.at(sample.position_ref)
        imu_above = imu is None or autopilot is None or imu[1] >= autopilot[1]
        self.imu.resize(span, name_at=-_NAME if imu_above else _NAME)
        self.autopilot.resize(span, name_at=_NAME if imu_above else -_NAME)
        self.arrows.resize(span)
        self.expected.shape(sample.covariance if has_position else np.zeros((3, 3)), sample.position_imu)
        for i, (body, _) in enumerate(self._imus[1:], 2):
            body.resize(span, name_at=1.5 * _NAME * i)  # each a line lower
        if has_position:
            self._name_distance(sample, span)
        drones = [(self.imu, sample.position_imu), (self.autopilot, sample.position_ref)]
        drones += [(body, body.position) for body, _ in self._imus[1 : 1 + len(self._display.others)]]
        names = [(body.label, place + body.label.position) for body, place in drones]
        names.append((self._error_name, sample.position_ref + self._error_name.position))
        taken = [picture.around(place, span) for _, place in drones]
        taken += [picture.box(name, place) for name, place in names if name.visible]
        _give_way(picture, taken, [self.overview.name, *self.ground.names])

    def _name_distance(self, sample: Sample, span: float) -> None:
        # On the line when there is room between the drones, else one name for both.
        apart = f"{length(sample.position_m)} apart"
        roomy = sample.position_m > 1.5 * span
        self.imu.label.text = f"{self._display.source} alone" if roomy else apart
        self.autopilot.label.visible = self._error_name.visible = roomy
        if roomy:
            self._error_name.text = apart
            self._error_name.position = (sample.position_imu - sample.position_ref) / 2

    def trails(self, since: float, until: float) -> None:
        """Show both paths between two times, s."""
        for trail in (self._trail, *(trail for _, trail in self._imus)):
            trail.show(since, until)
