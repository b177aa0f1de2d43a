"""Paths as lines: fine where a minute is shown, few where all is; dashes and dots."""

from __future__ import annotations

import numpy as np

from companion.view.scene.trail import CHUNK, CHUNKS, DASHES, dashes, dots, simplified

HOUR = np.arange(0.0, 3600.0, 0.1)
CIRCLES = np.stack([200 * np.cos(HOUR / 10), 200 * np.sin(HOUR / 10), -50 - HOUR / 100], axis=1)


def test_a_minute_of_an_hour_is_no_polygon() -> None:
    fine, few = simplified(HOUR, CIRCLES, np.array([0], dtype=np.intp))
    assert len(few.ends) <= CHUNK * CHUNKS
    minute = fine.segments[(fine.ends > 1800) & (fine.ends < 1860)]
    middles = np.linalg.norm(minute.mean(axis=1)[:, :2], axis=1)
    assert (200 - middles).max() < 0.05, "m inside the circle"
    assert len(minute) < CHUNK * (CHUNKS - 1)


def test_a_short_flight_needs_one_level_and_keeps_its_jumps() -> None:
    t, path = HOUR[:600], CIRCLES[:600].copy()
    path[300:] += 50.0
    (lines,) = simplified(t, path, np.array([0, 300], dtype=np.intp))
    lengths = np.linalg.norm(lines.segments[:, 1] - lines.segments[:, 0], axis=1)
    assert lengths.max() < 5.0, "no line across the jump"


def test_dashes_are_equally_long_and_follow_the_path() -> None:
    points, colours = dashes(CIRCLES[:700])
    lengths = np.linalg.norm(points[:, 1] - points[:, 0], axis=1)
    dark = (colours[:, 0] == colours[0, 0]).all(axis=1)
    assert lengths[dark].sum() / lengths.sum() == np.clip(lengths[dark].sum() / lengths.sum(), 0.45, 0.55)
    assert np.count_nonzero(np.diff(dark.astype(int))) == DASHES - 1
    assert np.allclose(points[1:, 0], points[:-1, 1])
    still, _ = dashes(np.zeros((5, 3)))
    assert len(still) == 0


def test_dots_lie_on_the_fixes() -> None:
    found = dots(CIRCLES[::7], 0.3)
    assert len(found) <= 602
    assert np.abs(np.linalg.norm(found[:, 0, :2], axis=1) - 200).max() < 1e-3
