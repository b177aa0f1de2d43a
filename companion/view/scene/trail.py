"""The path behind a drone, in a fixed set of short lines of which only those that change are sent again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import viser

from companion.model import Array
from companion.present import Rgb
from companion.view.state.decimation import Indices, by_shape, evenly, windows

CHUNK = 60
"""Segments a line: sending `.points` resends the whole line, so a long trail is many short ones."""
CHUNKS = 20
"""Lines a trail: 1,200 segments in all. Software WebGL draws two such trails at about 9 frames a second."""
FINE_HZ = 6.0
"""Segments a second where only the last minute or so of a long flight is shown."""
OUTLINE = CHUNK * CHUNKS // 2
"""Points of a track that are chosen by its shape, at most."""


Segments = npt.NDArray[np.float32]


def segments(positions: Array, kept: Indices, breaks: Indices) -> tuple[Segments, Indices]:
    """Lines (M, 2, 3) between neighbours of the points `kept`, and the index at which each is complete.

    None of them crosses the jump just before an index of `breaks`.
    """
    starts, stops = kept[:-1], kept[1:]
    unbroken = np.searchsorted(breaks, starts, side="right") == np.searchsorted(breaks, stops, side="right")
    points = positions.astype(np.float32)
    return np.stack([points[starts], points[stops]], axis=1)[unbroken], stops[unbroken]


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """A track simplified."""

    segments: Segments  # (M, 2, 3)
    ends: Array  # (M,) s, when each is complete, increasing


def simplified(t: Array, positions: Array, restarts: Indices, outline: Indices | None = None) -> list[Lines]:
    """A track at t (N,) s, positions (N, 3) NED m, broken just before each of `restarts`: fine, and all in few lines.

    The fine one is left out where the few are as many. outline: `by_shape` of the positions, to OUTLINE points or more.
    """
    inner = restarts[(restarts > 0) & (restarts < len(t))]
    jumps = np.union1d(inner - 1, inner)  # both ends, so that a jump is a gap at its true place
    few = CHUNK * CHUNKS + 1 - len(jumps)
    levels = []
    if FINE_HZ * (t[-1] - t[0]) > CHUNK * CHUNKS:
        kept = np.union1d(evenly(len(t), int(FINE_HZ * (t[-1] - t[0]))), jumps)
        levels.append(_lines(t, positions, kept, inner))
    if few < CHUNK * CHUNKS / 2:
        few, inner, jumps = CHUNK * CHUNKS + 1, inner[:0], inner[:0]  # more anchors than the eye can part
    # Half by shape, for round corners in a long flight; half by time, so that the path keeps up with the drone.
    kept = np.union1d(evenly(len(t), few // 2, jumps), by_shape(positions, few // 2, outline))
    return [*levels, _lines(t, positions, kept, inner)]


class Trail:
    """The part of a track between two times. The nodes are made once and reused for every track that is loaded.

    scale: of the lines, see `scene.NEARER`.
    """

    def __init__(self, scene: viser.SceneApi, name: str, colour: Rgb, thickness: float, *, scale: float = 1.0) -> None:
        nothing = np.zeros((1, 2, 3), dtype=np.float32)
        self._colour = colour
        self._nodes = [
            scene.add_line_segments(
                f"{name}/{i}", nothing, colour, thickness=thickness, thickness_units="screen", scale=scale,
                visible=False,
            )
            for i in range(CHUNKS)
        ]  # fmt: skip
        self._levels: list[Lines] = []
        self._shown = [_NONE] * CHUNKS

    def load(self, t: Array, positions: Array, restarts: Indices, colour: Rgb, outline: Indices | None = None) -> None:
        """Take another track: times (N,) s, positions (N, 3) NED m, broken just before each index of `restarts`.

        outline: as for `simplified`.
        """
        if colour != self._colour:
            self._colour = colour
            for node in self._nodes:
                node.colors = np.array(colour, dtype=np.uint8)
        self._levels = simplified(t, positions, restarts, outline)
        self._shown = [(-1, -1, -1, -1)] * CHUNKS

    def hide(self) -> None:
        """Show nothing of it until it is loaded again."""
        self._levels = []

    def show(self, since: float, until: float) -> None:
        """Show what lies between two times, s, as finely as there are lines for it."""
        wanted = [_NONE] * CHUNKS
        for i, level in enumerate(self._levels):
            parts = windows(level.ends, since, until, CHUNK)
            if len(parts) <= CHUNKS:
                for chunk, a, b in parts:
                    wanted[chunk % CHUNKS] = (i, chunk, a, b)
                break
        for place, (node, part) in enumerate(zip(self._nodes, wanted, strict=True)):
            if part == self._shown[place]:
                continue
            self._shown[place] = part
            i, chunk, a, b = part
            if b > a:
                node.points = self._levels[i].segments[chunk * CHUNK + a : chunk * CHUNK + b]
            node.visible = b > a


_NONE = (0, 0, 0, 0)


def _lines(t: Array, positions: Array, kept: Indices, breaks: Indices) -> Lines:
    points, stops = segments(positions, kept.astype(np.intp), breaks)
    return Lines(points, t[stops])
