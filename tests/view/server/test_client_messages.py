"""What a browser may say, and that nothing else ends or changes anything."""

from __future__ import annotations

import struct
import time

import pytest
import viser
import websockets
import websockets.sync.client
from hypothesis import given
from hypothesis import strategies as st

from companion.model import Flight
from companion.view import Viewer
from companion.view.server.origin_check import MOST_BYTES, MOST_PICTURE_BYTES, accepted
from tests.view.browser_messages import CAMERA, Message, pack
from tests.view.circles import examine, recompute
from tests.waiting import wait_for

CLICK: Message = {
    "type": "ScenePointerMessage", "event_type": "click", "ray_origin": [1.0, 2.0, 3.0], "modifier": None,
    "ray_direction": [0.0, 0.6, 0.8], "screen_pos": [[0.5, 0.5]],
}  # fmt: skip
NAN, INF = float("nan"), float("inf")
HOSTILE: list[Message] = [
    CAMERA | {"image_height": 0}, CAMERA | {"image_width": -1}, CAMERA | {"image_height": 1e300},
    CAMERA | {"look_at": [0.0, 0.0, NAN]}, CAMERA | {"position": [INF, 0.0, 0.0]}, CAMERA | {"position": [1.0]},
    CAMERA | {"wxyz": [0.0, 0.0, 0.0, 0.0]}, CAMERA | {"wxyz": [1e-200, 0.0, 0.0, 0.0]}, CAMERA | {"near": 5e-324},
    CAMERA | {"up_direction": [0.0, 0.0, 1e-300]}, CAMERA | {"fov": 0.0}, CAMERA | {"fov": "1"},
    CAMERA | {"near": None},
    {"type": "ViewerCameraMessage"}, {"type": "GuiUpdateMessage", "uuid": "x", "updates": {"value": NAN}},
    {"type": "GuiUpdateMessage", "uuid": "x", "updates": {"content": "<script>"}},
    {"type": "GuiUpdateMessage", "uuid": 7, "updates": {"value": 1}},
    {"type": "GuiUpdateMessage", "uuid": "x", "updates": {"value": "x" * 10_000}},
    {"type": "ShareUrlRequest"}, {"type": "GetRenderResponseMessage", "payload": b"x"},
    {"type": "FileTransferStartUpload", "source_component_uuid": "x", "transfer_uuid": "y", "filename": "z",
     "mime_type": "", "part_count": 1 << 40, "size_bytes": 1 << 60},
    {"type": "FileTransferPart", "source_component_uuid": "x", "transfer_uuid": "y", "part_index": 0, "content": b"0"},
    CLICK | {"event_type": "rect-select"}, CLICK | {"ray_origin": None}, CLICK | {"ray_direction": [0.0, 0.0, 0.0]},
    CLICK | {"ray_direction": [NAN, 0.0, 1.0]}, CLICK | {"screen_pos": []}, CLICK | {"modifier": "shift"},
    {"type": ["unhashable"]}, {"type": None}, {},
]  # fmt: skip


@pytest.mark.parametrize("message", HOSTILE)
def test_what_no_page_sends_is_dropped(message: Message) -> None:
    assert not accepted(pack(message))


def test_what_pages_send_is_heard() -> None:
    assert accepted(pack(CAMERA))
    assert accepted(pack(CLICK))
    assert accepted(pack({"type": "CommandTriggerMessage", "uuid": "a"}))
    for value in (True, 3, 2.5, "Free", [1.0, 2.0], None):
        assert accepted(pack({"type": "GuiUpdateMessage", "uuid": "a", "updates": {"value": value}}))


def picture(width: int, height: int, body: bytes = b"") -> bytes:
    header = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", width, height)
    return pack({"type": "GetRenderResponseMessage", "payload": header + body, "render_uuid": "a"})


def test_a_picture_that_was_asked_for_is_heard() -> None:
    assert accepted(picture(1280, 800))
    assert accepted(picture(3840, 2160, b"x" * 20_000_000))


@pytest.mark.parametrize(
    "raw",
    [
        picture(1 << 20, 1 << 20),
        picture(0, 5),
        picture(10, 10, b"x" * MOST_PICTURE_BYTES),
        pack({"type": "GetRenderResponseMessage", "payload": b"GIF89a" + b"x" * MOST_BYTES, "render_uuid": "a"}),
        pack({"type": "GetRenderResponseMessage", "payload": b"\x89PNG", "render_uuid": "a"}),
        pack({"type": "FileTransferPart", "content": b"x" * MOST_BYTES}),
    ],
    ids=["a bomb", "no pixels", "too long", "no PNG", "no header", "an upload"],
)
def test_a_picture_of_no_bounded_size_is_dropped(raw: bytes) -> None:
    assert not accepted(raw)


@given(st.binary(max_size=200))
def test_any_bytes_get_an_answer(raw: bytes) -> None:
    accepted(raw)


@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.integers(-(2**63), 2**64 - 1) | st.text(max_size=9),
        lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=9), inner, max_size=4),
    )
)
def test_any_field_of_a_camera_may_be_anything(value: object) -> None:
    for name in CAMERA:
        accepted(pack(CAMERA | {name: value}))


def test_too_long_or_too_deep_is_dropped() -> None:
    assert not accepted(b"\x91" * 20_000)
    assert not accepted(pack(CAMERA | {"x": b"0" * MOST_BYTES}))
    assert not accepted("text")


def test_no_message_ends_the_page(flight: Flight, capfd: pytest.CaptureFixture[str]) -> None:
    def attack(url: str) -> None:
        version = websockets.Subprotocol(f"viser-v{viser.__version__}")
        with websockets.sync.client.connect(url, subprotocols=[version], proxy=None, max_size=None) as socket:
            for message in (*map(pack, HOSTILE), b"", b"\xc1", b"\x91" * 20_000, pack(CAMERA)):
                socket.send(message)
            socket.send("text")
            socket.send(pack({"type": "GuiUpdateMessage", "uuid": "none", "updates": {"value": "x"}}))
            time.sleep(0.5)

    with Viewer([flight], recompute, examine, port=0) as viewer:
        attack(viewer.url.replace("http", "ws", 1))
        before = viewer.controller.pose_updates

        def goes_on() -> bool:
            viewer.player.playing = True
            return viewer.controller.pose_updates > before

        wait_for(goes_on, "the page plays on")
        assert not viewer.stopped
    out, err = capfd.readouterr()
    assert "Traceback" not in out + err
