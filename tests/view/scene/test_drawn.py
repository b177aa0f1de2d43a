"""Where things stand in the world, which is NED, as they are handed to the browser."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from companion.strapdown import quaternion
from companion.view import ReplayChoice, worst_stretch
from companion.view.scene.cameras import camera, frame_of
from companion.view.scene.drone import AUTOPILOT, IMU
from companion.view.scene.scene import Ground, Picture, Scene, unseen
from companion.view.scene.vehicle_shapes import drone_for
from companion.view.state.places import MapPicture
from tests.view.circles import make_flight, recompute

DISPLAY = recompute(make_flight(), ReplayChoice())


class Drawn:
    """Stands for viser's scene: keeps what is drawn, by name."""

    world_axes = SimpleNamespace()

    def __init__(self) -> None:
        self.nodes: dict[str, Any] = {}

    def __getattr__(self, call: str) -> Callable[..., SimpleNamespace]:
        def keep(name: object = "", *values: Any, **named: Any) -> SimpleNamespace:
            label = {"text": values[0] if values else "", "anchor": "top-left", "font_screen_scale": 1.0}
            node = SimpleNamespace(**({"values": values, "visible": True, "position": np.zeros(3)} | label | named))
            self.nodes[str(name)] = node
            return node

        return keep


def test_the_arrow_to_the_north_points_north_and_lies_on_the_ground() -> None:
    drawn: Any = Drawn()
    framing = frame_of(DISPLAY)
    Ground(drawn, "").load(framing, None, None)
    foot, tip = drawn.nodes["/north"].points[0]
    assert tip[0] - foot[0] > 1.0
    assert tip[1:] == pytest.approx(foot[1:])
    assert foot[2] == pytest.approx(framing.ground)
    assert drawn.nodes["/north_name"].position[0] > tip[0]


def test_the_corners_of_the_map_lie_where_the_map_says() -> None:
    """viser's picture reaches to the right along its x and to its foot along its y."""
    drawn: Any = Drawn()
    picture = MapPicture(np.zeros((2, 3, 3), np.uint8), np.array([100.0, -50.0]), np.array([400.0, 600.0]), "")
    ground = Ground(drawn, "")
    ground.sink(7.0)
    ground.show_map(picture)
    image = drawn.nodes["/map"]
    _, width, height = image.values
    for right, up in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        corner = np.array([right * width / 2, -up * height / 2, 0.0])
        north, east, down = image.position + quaternion.rotate(np.array(image.wxyz), corner)
        assert (north, east) == pytest.approx((100.0 + 200.0 * up, -50.0 + 300.0 * right))
        assert 7.0 < down < 8.0, "under the grid, and hardly"


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_a_stick_reaches_from_each_drone_straight_to_the_ground(share: float) -> None:
    drawn: Any = Drawn()
    scene = Scene(drawn, drone_for("QUADROTOR"))
    scene.load(DISPLAY, frame_of(DISPLAY), drone_for("QUADROTOR"))
    sample = DISPLAY.at(DISPLAY.start + share * (DISPLAY.end - DISPLAY.start))
    scene.show(sample)
    for drone, place in ((AUTOPILOT, sample.position_ref), (IMU, sample.position_imu)):
        foot = drawn.nodes[drone].position + drawn.nodes[f"{drone}/stick"].points[0, 1]
        assert foot == pytest.approx([place[0], place[1], scene.ground.level], abs=0.02)


def test_the_words_at_the_worst_place_are_gone_where_those_of_the_instant_stand() -> None:
    """At the worst instant both would say how far apart the drones are, at the same place."""
    drawn: Any = Drawn()
    scene = Scene(drawn, drone_for("QUADROTOR"))
    scene.load(DISPLAY, frame_of(DISPLAY), drone_for("QUADROTOR"))
    worst = worst_stretch(DISPLAY.replay)
    assert worst is not None
    (words,) = (node for name, node in drawn.nodes.items() if name.endswith("/worst_name"))
    whole = unseen(camera("Free", frame_of(DISPLAY)))
    for t, there in ((worst.end_s, False), (DISPLAY.start, True)):
        scene.annotate(DISPLAY.at(t), 1.0, whole)
        assert words.visible == there


@pytest.mark.parametrize("seed", range(20))
def test_no_name_lies_on_another_or_is_cut_off_at_a_side(seed: int) -> None:
    """From wherever the flight is seen, on a phone too."""
    random = np.random.default_rng(seed)
    drawn: Any = Drawn()
    scene = Scene(drawn, drone_for("QUADROTOR"))
    framing = frame_of(DISPLAY)
    scene.load(DISPLAY, framing, drone_for("QUADROTOR"), home=framing.centre)
    eye = framing.centre + framing.distance * random.uniform([-1, -1, -1], [1, 1, -0.2])
    picture = Picture(eye, framing.centre, (390.0, 844.0) if seed % 2 else (780.0, 900.0))
    sample = DISPLAY.at(random.uniform(DISPLAY.start, DISPLAY.end))
    scene.show(sample)
    scene.annotate(sample, 0.1 * framing.distance, picture)
    givers = [node for name, node in drawn.nodes.items() if name.endswith(("worst_name", "north_name", "home_name"))]
    drones = [scene.imu.label, scene.autopilot.label]
    places = [drone.place.position + drone.label.position for drone in (scene.imu, scene.autopilot)]
    shown = [*zip(drones, places, strict=True), *((node, node.position) for node in givers)]
    boxes = [picture.box(node, place) for node, place in shown if node.visible]
    for i, box in enumerate(boxes):
        assert box is not None
        for other in boxes[max(i + 1, 2) :]:
            assert other is not None
            assert not box.overlaps(other)
            assert picture.shows(other)
