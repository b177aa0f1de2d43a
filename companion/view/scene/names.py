"""Names in the picture: whoever comes first keeps its place, and what would lie on it, or be cut off, gives way."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import viser

from companion.model import Array
from companion.view.scene.cameras import TANGENT, UNMOVED, Camera, Pose, screen_up

EM = 12.0  # pixels of viser's labels, times their scale
_LETTER, _LINE = 0.6, 1.6  # em: the width of a letter, the height of a line with its ground


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """What is taken of a picture, pixels from its middle, right and up."""

    low: Array  # (2,)
    high: Array  # (2,)

    def overlaps(self, other: Box) -> bool:
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

    def around(self, point: Array, metres: float) -> Box | None:
        """A square so many metres wide."""
        place = self.at(point)
        if place is None:
            return None
        depth = float(np.linalg.norm(self.pose.apply(point) - self.eye))
        half = metres / 2 * self.size[1] / (2 * TANGENT * depth)
        return Box(place - half, place + half)

    def box(self, name: viser.LabelHandle, place: Array) -> Box | None:
        """Of a name that stands at a place (NED, m)."""
        middle = self.at(place)
        if middle is None:
            return None
        em = EM * name.font_screen_scale
        half = np.array([0.5 * _LETTER * len(name.text), 0.5 * _LINE]) * em
        middle = middle + np.array([0.0, {"top": -1, "bottom": 1}.get(name.anchor.partition("-")[0], 0) * half[1]])
        return Box(middle - half, middle + half)

    def shows(self, box: Box) -> bool:
        """Whether nothing of it is cut off at the sides."""
        half = self.size[0] / 2
        return bool(box.low[0] >= -half and box.high[0] <= half)


def unseen(camera: Camera) -> Picture:
    """What a browser would see that begins there."""
    return Picture(camera.position, camera.look_at, (1280.0, 800.0))


def give_way(picture: Picture, taken: Iterable[Box | None], names: Iterable[tuple[viser.LabelHandle, bool]]) -> None:
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
