"""What the pages make a browser say is what is heard: no control is there that nobody listens to."""

from __future__ import annotations

import contextlib
import functools
import io
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import viser
from PIL import Image

from companion.model import StatusText
from companion.view import LiveViewer, Offer, ReplayChoice, Seen, Viewer
from companion.view.server.origin_check import KINDS, accepted
from tests.view.browser_messages import Message, PlainPage, pack, plain_page
from tests.view.circles import dead_reckon, examine, make_flight, recompute
from tests.view.test_live_controller import Script

ANSWERS = {
    "GetRenderRequestMessage": "GetRenderResponseMessage",
    "GuiFormMessage": "GuiFormSubmitMessage GuiFormDirtyMessage",
    "GuiUploadButtonMessage": "FileTransferStartUpload FileTransferPart",
    "LocalStorageGetItemRequestMessage": "LocalStorageGetItemResponseMessage",
    "RegisterCommandMessage": "CommandTriggerMessage",
    "ScenePointerEnableMessage": "ScenePointerMessage",
    "SetSceneNodeClickBindingsMessage": "SceneNodeClickMessage",
    "SetSceneNodeDragBindingsMessage": "SceneNodeDragMessage",
    "TransformControlsMessage": (
        "TransformControlsUpdateMessage TransformControlsDragStartMessage TransformControlsDragEndMessage"
    ),
}
"""What a server says → what a browser may say then. Each control answers with GuiUpdateMessage besides."""
BESIDE = {"ViewerCameraMessage", "GuiUpdateMessage", "GuiButtonHoldMessage", "ShareUrlRequest", "ShareUrlDisconnect"}


def png(kind: str = "RGBA") -> bytes:
    """The smallest that a decoder takes."""
    out = io.BytesIO()
    Image.new(kind, (2, 2)).save(out, "PNG")
    return out.getvalue()


@contextlib.contextmanager
def replay_page(viewer: Viewer) -> Iterator[PlainPage]:
    """The page of a log, with all of its controls."""
    with plain_page(viewer.url) as page:
        page.listen(lambda: has(page, "This picture (PNG)") and has(page, "Camera"))
        yield page


@contextlib.contextmanager
def live_page() -> Iterator[tuple[LiveViewer, PlainPage]]:
    """The page of a link, with a vehicle on it."""
    flight = make_flight()
    feed = Script(Seen(flight, "RAW_IMU", dead_reckon(flight, ReplayChoice(imu="RAW_IMU")), None))
    with LiveViewer(feed, window_s=60.0, port=0) as viewer, plain_page(viewer.url) as page:
        page.listen(lambda: has(page, "Pause") and has(page, "Camera") and viewer.controller.scene.imu.place.visible)
        yield viewer, page


@pytest.fixture(scope="module")
def replayed() -> Iterator[list[Message]]:
    """All that a page of two flights is sent, with a picture that was asked for."""
    texts = tuple(StatusText(110.0 + i, 2, "a text of the vehicle, as long as it may be, " * 9) for i in range(3))
    flights = [replace(make_flight(), texts=texts), make_flight(sysid=2)]
    offer = Offer(correction_file="a-file-with-a-long-name.toml", report=lambda *_: "<p>")
    with Viewer(flights, recompute, examine, offer=offer, port=0) as viewer, replay_page(viewer) as page:
        page.press("This picture (PNG)")
        page.listen(lambda: "GetRenderRequestMessage" in kinds(page.messages))
        requested = next(one for one in page.messages if one["type"] == "GetRenderRequestMessage")
        page.send({"type": "GetRenderResponseMessage", "payload": png(), "render_uuid": requested["render_uuid"]})
        page.listen(lambda: "FileTransferStartDownload" in kinds(page.messages))
        yield page.messages


@pytest.fixture(scope="module")
def live() -> Iterator[list[Message]]:
    """All that the page of a link is told."""
    with live_page() as (_, page):
        yield page.messages


def kinds(sent: list[Message]) -> set[str]:
    return {one["type"] for one in sent}


def has(page: PlainPage, label: str) -> bool:
    return any(one.get("props", {}).get("label") == label for one in page.messages)


@pytest.mark.parametrize("which", ["replayed", "live"])
def test_whatever_a_page_makes_a_browser_say_is_heard(which: str, request: pytest.FixtureRequest) -> None:
    sent: list[Message] = request.getfixturevalue(which)
    assert len(sent) > 50
    for one in sent:
        for answer in ANSWERS.get(one["type"], "").split():
            if one.get("bindings", True) and one.get("enable", True):
                assert answer in KINDS, f"{one['type']} makes a browser say {answer}"
        assert not one.get("props", {}).get("_hold_callback_freqs"), "GuiButtonHoldMessage is not heard"
        assert not one.get("show_share_button"), "ShareUrlRequest is not heard"


@pytest.mark.parametrize("which", ["replayed", "live"])
def test_every_value_that_a_control_can_have_is_heard(which: str, request: pytest.FixtureRequest) -> None:
    sent: list[Message] = request.getfixturevalue(which)
    controls = [one for one in sent if one["type"].startswith("Gui") and "value" in one]
    assert len(controls) > 5
    for one in controls:
        values = [one["value"], *(one.get("props", {}).get("options") or ())]
        for value in values:
            answer = {"type": "GuiUpdateMessage", "uuid": one["uuid"], "updates": {"value": value}}
            assert accepted(pack(answer)), (one["props"].get("label"), value)
    for one in sent:
        if one["type"] == "GuiUpdateMessage":
            for option in one["updates"].get("options", ()):
                answer = {"type": "GuiUpdateMessage", "uuid": one["uuid"], "updates": {"value": option}}
                assert accepted(pack(answer)), option


def test_every_kind_that_viser_hears_is_known_here() -> None:
    """A new viser that lets browsers say more is looked at before it is let in."""
    folder = Path(viser.__file__).parent
    text = "".join((folder / name).read_text() for name in ("_viser.py", "_gui_api.py", "_scene_api.py"))
    hears = set(re.findall(r"register\w*_handler\(\s*_messages\.(\w+)", text))
    known = BESIDE | {answer for answers in ANSWERS.values() for answer in answers.split()}
    assert hears == known
    assert known >= KINDS


ODD = [1e9, -1e9, 0, 2.5, True, None, "", "x" * 256, "nan", "nan×", "inf×", "-1×", "9999999: x", [], [1e9] * 16]


def attack(page: PlainPage) -> None:
    """Every value that passes, to every control but the buttons that save: what they begin outlives the page."""
    saving = {one["uuid"] for one in page.messages if "(" in (one.get("props", {}).get("label") or "")}
    inputs = [one for one in page.messages if one["type"].startswith("Gui") and "value" in one]
    inputs = [one for one in inputs if one["type"] != "GuiButtonMessage" or one["uuid"] not in saving]
    for value in ODD:
        for one in inputs:
            page.send({"type": "GuiUpdateMessage", "uuid": one["uuid"], "updates": {"value": value}})


def test_no_value_of_a_control_ends_a_replay(capfd: pytest.CaptureFixture[str]) -> None:
    with Viewer([make_flight(), make_flight(sysid=2)], recompute, examine, port=0) as viewer:
        with replay_page(viewer) as page:
            attack(page)
            for payload in (png("RGB"), png()[:40], png()[:-15]):
                before = len(renders(page))
                page.press("This picture (PNG)")
                page.listen(functools.partial(more, page, before))
                for requested in renders(page):
                    answer = {
                        "type": "GetRenderResponseMessage",
                        "payload": payload,
                        "render_uuid": requested["render_uuid"],
                    }
                    page.send(answer)
        assert lives(viewer)
    assert "Traceback" not in "".join(capfd.readouterr())


def test_no_value_of_a_control_ends_a_live_page(capfd: pytest.CaptureFixture[str]) -> None:
    with live_page() as (viewer, page):
        attack(page)
        assert lives(viewer)
    assert "Traceback" not in "".join(capfd.readouterr())


def renders(page: PlainPage) -> list[Message]:
    return [one for one in page.messages if one["type"] == "GetRenderRequestMessage"]


def more(page: PlainPage, renders_before: int) -> bool:
    return len(renders(page)) > renders_before


def lives(viewer: Viewer | LiveViewer) -> bool:
    """Whether another page is drawn, with nothing that is no number in it."""
    with plain_page(viewer.url) as page:
        page.listen(lambda: has(page, "Camera"))
        for one in page.messages:
            pack(one)
            for value in one.values():
                assert value == value, one  # noqa: PLR0124  (which NaN is not)
    return not viewer.stopped
