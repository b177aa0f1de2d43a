"""The path behind a drone, in a fixed set of short lines of which only those that change are sent again."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import viser

from companion.model import Array
from companion.view.palette import Rgb
from companion.view.thin import Indices, by_shape, evenly, windows

CHUNK = 60
"""Segments a line: sending `.points` resends the whole line, so a long trail is many short ones."""
CHUNKS = 20
"""Lines a trail: 1,200 segments in all. Software WebGL draws two such trails at about 9 frames a second."""


Segments = npt.NDArray[np.float32]


def segments(positions: Array, kept: Indices, breaks: Indices) -> tuple[Segments, Indices]:
    """Lines (M, 2, 3) between neighbours of the points `kept`, and the index at which each is complete.

    None of them crosses the jump just before an index of `breaks`.
    """
    starts, stops = kept[:-1], kept[1:]
    unbroken = np.searchsorted(breaks, starts, side="right") == np.searchsorted(breaks, stops, side="right")
    points = positions.astype(np.float32)
    return np.stack([points[starts], points[stops]], axis=1)[unbroken], stops[unbroken]


class Trail:
    """The part of a track between two times. The nodes are made once and reused for every track that is loaded."""

    def __init__(self, scene: viser.SceneApi, name: str, colour: Rgb, thickness: float) -> None:
        nothing = np.zeros((1, 2, 3), dtype=np.float32)
        self._colour = colour
        self._lines = [
            scene.add_line_segments(
                f"{name}/{i}", nothing, colour, thickness=thickness, thickness_units="screen", visible=False
            )
            for i in range(CHUNKS)
        ]
        self._segments = np.zeros((0, 2, 3), dtype=np.float32)
        self._ends: Array = np.zeros(0)
        self._shown = [(0, 0)] * CHUNKS

    def load(self, t: Array, positions: Array, restarts: Indices, colour: Rgb) -> None:
        """Take another track: times (N,) s, positions (N, 3) NED m, broken just before each index of `restarts`."""
        if colour != self._colour:
            self._colour = colour
            for line in self._lines:
                line.colors = np.array(colour, dtype=np.uint8)
        inner = restarts[(restarts > 0) & (restarts < len(t))]
        room = CHUNK * CHUNKS + 1
        if 4 * len(inner) > room:
            inner = inner[:0]  # more anchors than the eye can part: one line through all of them
        keep = np.union1d(inner - 1, inner)  # both ends of a jump, so that it is a gap at its true place
        room -= len(keep)
        # Half by shape, for round corners in a long flight; half by time, so that the path keeps up with the drone.
        kept = np.union1d(evenly(len(t), room // 2, keep), by_shape(positions, room // 2))
        self._segments, stops = segments(positions, kept, inner)
        self._ends = t[stops]
        self._shown = [(-1, -1)] * CHUNKS

    def hide(self) -> None:
        """Show nothing of it until it is loaded again."""
        self._segments, self._ends = self._segments[:0], self._ends[:0]

    def show(self, since: float, until: float) -> None:
        """Show what lies between two times, s."""
        for i, part in enumerate(windows(self._ends, since, until, CHUNK, CHUNKS)):
            if part == self._shown[i]:
                continue
            self._shown[i] = part
            a, b = part
            if b > a:
                self._lines[i].points = self._segments[i * CHUNK + a : i * CHUNK + b]
            self._lines[i].visible = b > a
