"""What leaves the page: the picture over its background, a replay that needs no server, and what it records."""

from __future__ import annotations

import base64
import re
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest
import viser
import zstandard

from companion.model import Flight
from companion.view import ReplayChoice, display_trajectory
from companion.view.export import Recording, over, replay_page
from companion.view.scene.cameras import frame_of
from companion.view.scene.drone import AUTOPILOT, IMU
from companion.view.scene.scene import Scene
from companion.view.scene.vehicle_shapes import drone_for
from tests.view.circles import dead_reckon, make_flight, recompute


def test_what_is_see_through_shows_the_page_behind() -> None:
    rgba = np.array([[[10, 20, 30, 255], [10, 20, 30, 0], [0, 0, 0, 128]]], dtype=np.uint8)
    np.testing.assert_array_equal(over(rgba, 255)[0], [[10, 20, 30], [255, 255, 255], [127, 127, 127]])


def test_the_page_is_one_file_that_asks_nobody(flight: Flight) -> None:
    html = replay_page(recompute(flight, ReplayChoice()), flight)
    assert html.lstrip().lower().startswith("<!doctype html>")
    assert "__VISER_EMBED_DATA__" in html
    assert len(html) < 12e6


DISPLAY = recompute(make_flight(), ReplayChoice())
STEP = 0.5


def recorded(html: str) -> dict[tuple[float, str, str], Any]:
    """What the recording of a page writes: time, s, node and property → value. What a node began with is left out."""
    (data,) = re.findall('__VISER_EMBED_DATA__="(.*?)"', html)
    packed = base64.b64decode(data)
    inner = zstandard.ZstdDecompressor().decompress(packed[8:], int.from_bytes(packed[:8], "little"))
    end = 8 + int.from_bytes(inner[:8], "little")
    recording = msgspec.msgpack.decode(inner[8:end])
    buffers = []
    for length in recording["binaryBufferLengths"]:
        start = end + -end % 8
        buffers.append(inner[start : start + length])
        end = start + length

    def plain(value: Any) -> Any:
        if isinstance(value, dict) and "__binary_index" in value:
            return np.frombuffer(buffers[value["__binary_index"]], value["dtype"]).tolist()
        return value

    return {
        (t, message.get("name", ""), name): plain(value)
        for t, message in recording["messages"]
        for name, value in (message | message.get("updates", {})).items()
        if name in {"wxyz", "position", "points"}
    }


def test_moves_are_recorded_as_viser_records_them(server: viser.ViserServer) -> None:
    scene = Scene(server.scene, drone_for("QUADROTOR"))
    scene.load(DISPLAY, frame_of(DISPLAY), drone_for("QUADROTOR"))
    frames = [scene.moves(sample) for sample in DISPLAY.samples(np.linspace(DISPLAY.start, DISPLAY.end, 20))]
    ours, theirs = Recording(server), server.get_scene_serializer()
    for moves in frames:
        ours.add(moves)
        ours.wait(STEP)
    buffers = [bytes(buffer) for buffer in ours._recorded._binary_buffers]
    assert len(set(buffers)) == len(buffers) < len(theirs._binary_buffers) + len(frames), "each is kept once"
    html = ours.html(dark=False)
    for moves in frames:
        for move in moves:
            move.show()
        theirs.insert_sleep(STEP)
    mine, true = recorded(html), recorded(theirs.as_html())
    for place in true:  # viser leaves out what has hardly changed
        assert mine[place] == pytest.approx(true[place], rel=1e-6, abs=1e-6)
    assert {(STEP * i, IMU, "position") for i in range(20)} <= mine.keys()
    assert {(STEP * i, f"{AUTOPILOT}/attitude", "wxyz") for i in range(20)} <= mine.keys()
    assert any(name == "points" and t > 0 for t, _, name in true)


def test_a_flight_without_a_position_hangs_in_the_air_as_on_the_page(flight: Flight) -> None:
    shown = dead_reckon(flight, ReplayChoice())
    none = np.zeros_like(shown.position_ref)
    display = display_trajectory(
        replace(shown, has_position=False, position_ref=none, position_imu=none, position_error=none)
    )
    heights = [value[2] for (_, node, name), value in recorded(replay_page(display, flight)).items()
               if (node, name) == ("/world/grid", "position")]  # fmt: skip
    assert heights[-1] == frame_of(display).ground > 0
