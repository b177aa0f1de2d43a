"""Where to stand and what to hold still: how a flight is framed, and the cameras that move with it.

A camera that follows does so by moving the world under it, not by sending camera poses: the browser's own orbit
and zoom go on working while it follows, and nothing fights with the user's hand.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
import viser

from companion.model import Array
from companion.strapdown import quaternion
from companion.view.state.trajectory import CameraMode, DisplayTrajectory, Sample, worst_stretch

CAMERA_MODES: tuple[CameraMode, ...] = get_args(CameraMode)

STILL: tuple[CameraMode, ...] = ("Free", "Map")
"""In these the world stands still."""

FIELD_OF_VIEW = np.radians(45.0)  # vertical
TANGENT = float(np.tan(FIELD_OF_VIEW / 2))  # half the height of what is seen, by its distance

ASPECT = 0.8  # width by height of what the panels leave of a window; a wider one shows more
MARGIN = 0.9  # share of the picture that a flight may fill
COVERED = 0.3  # share of the height that the timeline covers, at the bottom, of a window of 800 pixels
ASTRAY = 4.0  # times the size of a path is a point of the other that is not framed with it
WORST_ASTRAY = 12.0  # the same of the worst stretch, which is what is looked for
ENOUGH = 5000  # points of a path to frame it by
NARROW_COVERED, NARROW_AWAY = 0.6, 1.9  # the same of a phone held upright, and how much farther away that is
ROOM = 1.6  # times how far apart both drones are, the width that a camera that follows them shows at least
OVERVIEW = (25.0, 28.0)  # degrees, azimuth and elevation of the first view
DOWN = (0.0, 89.0)  # not quite: straight down the camera would not know which way is up, and north must be


@dataclass(frozen=True, slots=True, eq=False)
class Framing:
    """The room a flight takes up in the world, NED, m."""

    low: Array  # (3,) least north, east, down
    high: Array  # (3,) greatest
    radius: float  # of the sphere around everything
    ground: float  # down coordinate of the grid: the lowest point that was flown
    cell: float  # of the grid: 1, 2 or 5 times a power of ten
    distance: float  # from which the whole of it is seen

    @property
    def centre(self) -> Array:
        """(3,)."""
        return (self.low + self.high) / 2


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Of the world node in the browser's world: identity leaves NED as it is."""

    wxyz: Array  # (4,)
    position: Array  # (3,) m

    def apply(self, point: Array) -> Array:
        """Where `point` (NED) stands in the browser's world."""
        return quaternion.rotate(self.wxyz, point) + self.position

    def back(self, point: Array) -> Array:
        """Where in NED a point of the browser's world is: `apply` undone."""
        return self.back_along(point - self.position)

    def back_along(self, direction: Array) -> Array:
        """The same of a direction."""
        return quaternion.rotate(quaternion.conjugate(self.wxyz), direction)


UNMOVED = Pose(np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A standpoint in the browser's world, m, with its clipping planes."""

    position: Array  # (3,)
    look_at: Array  # (3,)
    near: float
    far: float

    def begin(self, initial: viser.InitialCameraConfig) -> None:
        """Let a page begin here."""
        initial.position, initial.look_at = self.position, self.look_at
        initial.near, initial.far, initial.fov = self.near, self.far, float(FIELD_OF_VIEW)


def frame(positions: Array, others: Array | None = None, astray: float = ASTRAY) -> Framing:
    """Frame the path `positions` (N, 3), NED, m, and of the path `others` what is not far astray."""
    ground = float(positions[:, 2].max())
    positions = positions[:: max(len(positions) // ENOUGH, 1)]
    if others is not None:
        others = others[:: max(len(others) // ENOUGH, 1)]
        far = np.linalg.norm(others - positions.mean(axis=0), axis=1)
        near = far < astray * np.linalg.norm(positions - positions.mean(axis=0), axis=1).max()
        positions = np.concatenate([positions, others[near]])
    low, high = positions.min(axis=0), positions.max(axis=0)
    radius = max(float(np.linalg.norm(high - low)) / 2, 4.0)
    distance = max(_distance(positions - (low + high) / 2), 2 * radius)
    return Framing(low, high, radius, ground, nice(radius / 4), distance)


def frame_of(display: DisplayTrajectory) -> Framing:
    """The room of a flight with its worst stretch; without a position both drones hang in the air above the origin."""
    replay = display.replay
    worst = worst_stretch(replay)
    astray = replay.position_imu[:0] if worst is None else replay.position_imu[between(replay.t, *worst.span)]
    framing = frame(replay.position_ref, astray, WORST_ASTRAY)
    return framing if replay.has_position else replace(framing, ground=0.5 * framing.radius)


WITH_DRONES = 1.2
"""Times as far away as the paths alone need: at their ends are drones, with their names."""


def frame_between(display: DisplayTrajectory, whole: Framing, start: float, end: float) -> Framing:
    """The room of both paths between two times, s, over the ground of the whole flight."""
    replay = display.replay
    part = between(replay.t, start, end)
    if not replay.has_position or part.stop - part.start < 2:
        return whole
    near = frame(replay.position_ref[part], replay.position_imu[part], np.inf)
    return replace(near, ground=whole.ground, distance=WITH_DRONES * near.distance)


def between(t: Array, start: float, end: float) -> slice:
    """The samples from one time to another, both included, s."""
    return slice(*np.searchsorted(t, [start, end + 1e-6]).tolist())


def nice(length: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above `length`."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(power * max(m for m in (1.0, 2.0, 5.0) if m * power <= length * (1 + 1e-9)))


def grid_cell(distance: float, cell: float) -> float:
    """Side of the grid's squares, m, for a camera `distance` m away, where `cell` is drawn now.

    A tenth of the distance, and no change before it is worth one: at a border between two sizes it must not flicker.
    """
    side = max(distance, 1e-3) / 10
    return cell if cell > 0 and cell / 1.25 < side < 3.0 * cell else nice(side)


def camera(mode: CameraMode, framing: Framing, *, narrow: bool = False) -> Camera:
    """Where a browser's camera starts in `mode`. narrow: on a phone, whose panel covers more than half of it."""
    distance = framing.distance * (NARROW_AWAY if narrow else 1.0)
    covered = NARROW_COVERED if narrow else COVERED
    close = min(max(0.45 * distance, 8.0), 60.0)
    angles, away = {
        "Free": (OVERVIEW, distance),
        "Follow": ((25.0, 25.0), close),
        "Chase": ((0.0, 18.0), 0.6 * close),
        "From above": (DOWN, 0.8 * distance),
        "Map": (DOWN, distance),
    }[mode]
    towards = _direction(*angles)
    look_at = framing.centre if mode in STILL else np.zeros(3)
    if mode in STILL or narrow:
        # Everything moves up by what is covered below: the camera looks at what is that much lower.
        look_at = look_at - covered * TANGENT * away * _upright(towards)
    return Camera(look_at + away * towards, look_at, max(distance / 2000, 0.01), 60 * distance + 2000.0)


def world(mode: CameraMode, sample: Sample) -> Pose:
    """How the world has to stand at `sample` for the camera of `mode` to keep its view.

    Of the autopilot's drone, and not the IMU's, because the latter jumps at every anchor; "Follow": of the place
    between both.
    """
    if mode in STILL:
        return UNMOVED
    turn = UNMOVED.wxyz
    if mode == "Chase":
        half = -float(quaternion.to_euler(sample.q_ref)[2]) / 2
        turn = np.array([np.cos(half), 0.0, 0.0, np.sin(half)])
    held = (sample.position_ref + sample.position_imu) / 2 if mode == "Follow" else sample.position_ref
    return Pose(turn, -Pose(turn, np.zeros(3)).apply(held))


def step_back(mode: CameraMode, eye: Array, sample: Sample) -> Array | None:
    """Where a camera at `eye` (3,) m that follows both drones has to go to see both; None: it may stay.

    Only ever away from them, along its line of sight: nearer is the user's to choose.
    """
    if mode != "Follow":
        return None
    distance = float(np.linalg.norm(eye))
    least = ROOM * sample.position_m / (2 * TANGENT * ASPECT)
    return None if distance >= least or distance == 0 else np.asarray(eye * (1.25 * least / distance))


def readable_span(distance: float, true_span: float, size: float) -> float:
    """How large to draw a vehicle seen from `distance` m so that its attitude can be read; never below true size."""
    return max(true_span, 0.075 * size * distance * 2 * TANGENT)


def screen_up(line_of_sight: Array) -> Array:
    """What is up in the picture for a camera that looks along `line_of_sight` (3,), NED; of any length."""
    up = np.array([0.0, 0.0, -1.0])
    along = float(up @ line_of_sight) / max(float(line_of_sight @ line_of_sight), 1e-12)
    return np.asarray(up - along * line_of_sight, dtype=np.float64)


def _distance(offsets: Array) -> float:
    """How far from the centre to stand so that the points at `offsets` (N, 3) from it are all in the picture.

    Above what the timeline covers: with D the distance, T the tangent of half the field of view, M the margin and c
    what is covered, a point that lies `up` above the centre and `near` towards the camera is seen at the height
    (up + c T D) / (T (D - near)), which has to lie between -(1 - 2c) M and M. Solved for D, each bound is linear.
    """
    towards = _direction(*OVERVIEW)
    up = _upright(towards)
    right = np.cross(towards, up)
    low = (1 - 2 * COVERED) * MARGIN
    near, above = offsets @ towards, offsets @ up
    aside = near + np.abs(offsets @ right) / (MARGIN * TANGENT * ASPECT)
    top = (above / TANGENT + MARGIN * near) / (MARGIN - COVERED)
    bottom = (-above / TANGENT + low * near) / (low + COVERED)
    return float(np.max([aside, top, bottom]))


def _upright(towards: Array) -> Array:
    """Unit vector that is up in the picture of a camera that lies `towards` (unit) from what it looks at, NED."""
    up = screen_up(-towards)
    return np.asarray(up / np.linalg.norm(up), dtype=np.float64)


def _direction(azimuth: float, elevation: float) -> Array:
    """From what is looked at towards a camera that looks north when `azimuth` is 0 and east of north when positive.

    Degrees; the result is a unit vector, NED.
    """
    a, e = np.radians(azimuth), np.radians(elevation)
    return np.array([-np.cos(a) * np.cos(e), -np.sin(a) * np.cos(e), -np.sin(e)])


REACH = np.radians(0.8)
"""How far from a path a click may be, as an angle at the camera: 16 pixels of a window 900 high."""
_MOST = 200_000  # samples that are looked at


def picked(display: DisplayTrajectory, origin: Array, direction: Array) -> float | None:
    """The time, s, of the place on either path that a ray passes closest to, seen from its origin; NED, m.

    None where both paths are farther away than a click can mean, and without a position.
    """
    if not display.replay.has_position or not np.linalg.norm(direction) > 0:
        return None
    some = slice(None, None, len(display.replay.t) // _MOST + 1)
    t = display.replay.t[some]
    nearest = [_nearest(p[some], origin, direction) for p in (display.replay.position_ref, display.replay.position_imu)]
    angle, at = min(nearest)
    return float(t[at]) if angle < REACH else None


def _nearest(points: Array, origin: Array, direction: Array) -> tuple[float, int]:
    """The least angle, rad, between the ray and what is seen from its origin, and which of `points` (N, 3) that is."""
    offsets = points - origin
    along = offsets @ (direction / np.linalg.norm(direction))
    aside = np.sqrt(np.maximum(np.einsum("ij,ij->i", offsets, offsets) - along**2, 0.0))
    angles = np.arctan2(aside, along)
    at = int(np.argmin(angles))
    return float(angles[at]), at
