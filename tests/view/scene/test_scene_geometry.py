"""Laws of the shapes, the framing and the cameras, without a browser."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.model import Array
from companion.strapdown.quaternion import to_euler
from companion.view import ReplayChoice
from companion.view.scene.cameras import (
    ASPECT,
    CAMERA_MODES,
    COVERED,
    FIELD_OF_VIEW,
    camera,
    frame,
    grid_cell,
    nice,
    step_back,
    world,
)
from companion.view.scene.drone import LONGEST, SHORTEST, Arrows, arrow_length
from companion.view.state.trajectory import Sample
from tests.view.circles import make_flight, recompute

DISPLAY = recompute(make_flight(), ReplayChoice())


@given(st.floats(0.001, 1e6))
def test_grid_cells_are_one_two_or_five(length: float) -> None:
    cell = nice(length)
    digits = cell / 10.0 ** np.floor(np.log10(cell) + 1e-9)
    assert min(abs(digits - m) for m in (1, 2, 5)) < 1e-6
    assert 0.39 * length < cell <= length * (1 + 1e-6)


@given(st.floats(0.1, 1e5), st.floats(0.1, 1e5))
def test_the_grid_follows_the_camera_and_does_not_flicker(here: float, there: float) -> None:
    cell = grid_cell(there, grid_cell(here, 0.0))
    assert 0.2 * cell < there / 10 < 4.0 * cell  # neither a carpet nor a desert
    assert grid_cell(1.1 * there, cell) in (cell, nice(1.1 * there / 10))
    for wobble in (0.999, 1.001, 0.999):
        assert grid_cell(wobble * there, grid_cell(there, 0.0)) == grid_cell(there, 0.0)


def arrows_at(sample: Sample) -> dict[str, Array]:
    """Each arrow (3,) as it is drawn, m, where 10 m/s is the fastest and the drones are a metre wide."""
    drawn: dict[str, SimpleNamespace] = {}

    def add_arrows(name: str, points: Array, *_: object, **__: object) -> SimpleNamespace:
        drawn[name] = SimpleNamespace(points=points, visible=False)
        return drawn[name]

    arrows = Arrows(SimpleNamespace(add_arrows=add_arrows), "")  # type: ignore[arg-type]
    arrows.load(10.0, (0, 0, 255))
    arrows.resize(1.0)
    arrows.shown = True
    arrows.show(sample, has_position=True)
    return {name.strip("/"): handle.points[0, 1] - handle.points[0, 0] for name, handle in drawn.items()}


def test_arrows_point_along_the_velocities_and_down() -> None:
    """In the world, which is NED: what pulls down grows along the third axis."""
    sample = DISPLAY.at(DISPLAY.replay.t[len(DISPLAY.replay.t) // 2])
    along = arrows_at(sample)
    down = along["gravity"]
    assert down[2] > 0.5
    assert abs(down[:2]).max() == 0.0
    for name, velocity in (("ref", sample.velocity_ref), ("imu", sample.velocity_imu)):
        assert along[name] @ velocity == pytest.approx(np.linalg.norm(along[name]) * np.linalg.norm(velocity), rel=1e-4)


@pytest.mark.parametrize(("slower", "faster"), [("ref", "imu"), ("imu", "ref")])
def test_the_arrow_of_the_faster_one_is_the_longer(slower: str, faster: str) -> None:
    flown = {slower: np.array([0.0, 2.0, 0.0]), faster: np.array([6.0, 0.0, 0.0])}
    along = arrows_at(replace(DISPLAY.at(DISPLAY.start), velocity_ref=flown["ref"], velocity_imu=flown["imu"]))
    assert np.linalg.norm(along[faster]) > 1.5 * np.linalg.norm(along[slower])


@given(st.floats(0.0, 100.0), st.floats(0.0, 100.0))
def test_an_arrow_grows_with_the_speed(slow: float, more: float) -> None:
    lengths = [arrow_length(v, 60.0) for v in (slow, slow + more)]
    assert 0.0 <= lengths[0] <= lengths[1] <= LONGEST
    assert arrow_length(0.0, 60.0) == 0.0
    assert arrow_length(1.0, 60.0) >= SHORTEST


@given(
    st.lists(st.tuples(*[st.floats(-500, 500)] * 3), min_size=1, max_size=20),
)
def test_the_first_view_shows_the_whole_flight(points: list[tuple[float, float, float]]) -> None:
    path = np.array(points)
    view = camera("Free", frame(path))
    forward = view.look_at - view.position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, -1.0])
    right /= np.linalg.norm(right)
    depth = (path - view.position) @ forward
    assert (depth > view.near).all()
    assert (depth < view.far).all()
    tangent = np.tan(FIELD_OF_VIEW / 2)
    assert (np.abs((path - view.position) @ right) < depth * tangent * ASPECT).all()
    height = (path - view.position) @ np.cross(right, forward) / (depth * tangent)
    assert (height < 1.0).all()
    assert (height > 2 * COVERED - 1.0).all()  # above the timeline


@pytest.mark.parametrize("mode", CAMERA_MODES)
def test_a_following_camera_keeps_the_autopilot_in_the_middle(mode: str) -> None:
    for t in np.linspace(DISPLAY.start, DISPLAY.end, 7):
        sample = DISPLAY.at(float(t))
        pose = world(mode, sample)  # type: ignore[arg-type]  # the parameter is one of the modes
        where = pose.apply(sample.position_ref)
        middle = (sample.position_ref - sample.position_imu) / 2 if mode == "Follow" else np.zeros(3)
        np.testing.assert_allclose(where, sample.position_ref if mode in ("Free", "Map") else middle, atol=1e-9)
        nose: Array = pose.apply(sample.position_ref + [np.cos(a := to_euler(sample.q_ref)[2]), np.sin(a), 0.0]) - where
        if mode == "Chase":
            np.testing.assert_allclose(nose, [1.0, 0.0, 0.0], atol=1e-9)


@given(st.floats(0.0, 5000.0), st.floats(1.0, 1000.0))
def test_who_follows_steps_back_until_both_are_seen(apart: float, away: float) -> None:
    sample = replace(DISPLAY.at(DISPLAY.start), position_m=apart)
    eye = away * np.array([-0.8, 0.0, -0.6])
    moved = step_back("Follow", eye, sample)
    width = 2 * np.tan(FIELD_OF_VIEW / 2) * ASPECT * float(np.linalg.norm(eye if moved is None else moved))
    assert width >= apart
    assert moved is None or np.linalg.norm(moved) > away
    if moved is not None:
        assert np.cross(moved, eye) == pytest.approx(np.zeros(3), abs=1e-6), "along the line of sight"
        assert step_back("Follow", moved, sample) is None
    assert step_back("Free", eye, sample) is None


def test_a_flight_that_never_moves_is_framed() -> None:
    framing = frame(np.zeros((5, 3)))
    assert framing.radius > 0
    assert framing.cell >= 1.0
    assert np.isfinite(camera("Free", framing).position).all()


def test_an_imu_that_went_astray_does_not_spoil_the_picture() -> None:
    path = DISPLAY.replay.position_ref
    astray = path + np.linspace(0, 1e7, len(path))[:, None]
    assert frame(path, astray).radius < 2.0 * frame(path).radius
