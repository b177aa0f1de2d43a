"""Extra paths of a flight, each of which can be shown or not: the GPS fixes and the best estimate."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import viser

from companion.model import Array, interpolated
from companion.present import palette
from companion.view.scene.trail import Segments
from companion.view.state.choice import SHOWN, ExtraPath
from companion.view.state.decimation import by_shape, evenly
from companion.view.state.places import Path
from companion.view.state.sending import update

MOST_POINTS = 600
DASHES = 240
"""Of the best estimate, dark and light in turn: it is seen on a light page and on a dark one."""
_NOTHING = np.zeros((1, 2, 3), dtype=np.float32)


class ExtraPaths:
    """Only the view thread may call it."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._lines = {
            name: scene.add_line_segments(
                f"{root}/{name}", _NOTHING, colour, thickness=thickness, thickness_units="screen", visible=False
            )
            for name, colour, thickness in (("gps", palette.GPS, 5.0), ("best", palette.BEST, 2.5))
        }
        self.shown = dict(SHOWN)
        self.there = dict.fromkeys(SHOWN, False)

    def load(self, gps: Path | None, best: Path | None, size: float) -> None:
        """Lay out another flight; None: it has no such path. size: m, about a pixel of a picture of the whole."""
        self.there = {"gps": gps is not None, "best": best is not None}
        if gps is not None:
            self._lines["gps"].points = dots(gps.position, size)
        if best is not None:
            points, colours = dashes(best.position)
            self._lines["best"].points, self._lines["best"].colors = points, colours
        self._update()

    def choose(self, shown: Mapping[ExtraPath, bool]) -> None:
        """Show some of them, where they are there."""
        self.shown = dict(shown)
        self._update()

    @property
    def visible(self) -> tuple[ExtraPath, ...]:
        """Those in the picture."""
        return tuple(name for name, there in self.there.items() if there and self.shown[name])

    def _update(self) -> None:
        for name, line in self._lines.items():
            update(line, visible=name in self.visible)


def dots(positions: Array, size: float) -> Segments:
    """Lines (M, 2, 3) so short, m, that each looks like a dot."""
    kept = np.union1d(evenly(len(positions), MOST_POINTS // 2), by_shape(positions, MOST_POINTS // 2))
    points = positions[kept]
    return np.stack([points, points + np.array([size, 0.0, 0.0])], axis=1).astype(np.float32)


def dashes(positions: Array) -> tuple[Segments, npt.NDArray[np.uint8]]:
    """A path (N, 3) as lines (M, 2, 3) with their colours: dark and light in turn, each dash as long as the others."""
    points = positions[by_shape(positions, MOST_POINTS)]
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    distinct = np.concatenate([[True], np.diff(along) > 0])
    points, along = points[distinct], along[distinct]
    edges = np.linspace(0.0, along[-1], DASHES + 1)
    at = np.union1d(edges, along)
    path = interpolated(at, along, points)
    dash = np.searchsorted(edges, (at[:-1] + at[1:]) / 2, side="right") - 1
    shades = np.array([palette.BEST, palette.BEST_LIGHT], dtype=np.uint8)[dash % 2]
    return np.stack([path[:-1], path[1:]], axis=1).astype(np.float32), np.repeat(shades[:, None], 2, axis=1)
