"""The pages that are open, each with its own camera.

Every browser gets a node of its own under the world's name. It takes the place of the shared one there, and with it
moves everything that hangs on that name, in this browser alone.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
import viser

from companion.model import Array
from companion.view.panels.controls import Controls, write
from companion.view.scene.cameras import (
    CAMERA_MODES,
    STILL,
    UNMOVED,
    Framing,
    Pose,
    camera,
    step_back,
    world,
)
from companion.view.scene.drone import WORLD
from companion.view.state.choice import CameraMode
from companion.view.state.trajectory import Sample

_NARROW = 0.6  # width by height of a phone held upright; between two panels a laptop leaves 0.77


@dataclass(slots=True)
class _Browser:
    client: viser.ClientHandle
    world: viser.FrameHandle
    chooser: viser.GuiDropdownHandle[CameraMode]
    pose: Pose
    mode: CameraMode = "Free"


class Browsers:
    """Who looks, and how. Only the view thread may call it."""

    def __init__(
        self,
        server: viser.ViserServer,
        folder: viser.GuiFolderHandle,
        controls: Controls,
        choose: Callable[[int, CameraMode], object],
        mode: CameraMode,
        framing: Framing,
    ) -> None:
        """folder: where each finds its list of cameras; choose: called where one of them is to look otherwise."""
        self._server, self._folder, self._controls, self._choose, self._mode = server, folder, controls, choose, mode
        self._open: dict[int, _Browser] = {}
        self.framing = self._opening = framing
        self.place(framing)

    def place(self, framing: Framing, opening: Framing | None = None) -> None:
        """Where cameras stand from now on; opening: where they begin, None: there too."""
        before, self.framing, self._opening = self._opening, framing, opening or framing
        camera(self._mode, self._opening).begin(self._server.initial_camera)
        for browser in self._open.values():
            if browser.mode in STILL and _stands(browser.client, browser.mode, before):
                _stand(browser.client, browser.mode, self._opening)

    def __len__(self) -> int:
        return len(self._open)

    @contextlib.contextmanager
    def atomic(self) -> Iterator[None]:
        """What is written to one browser meanwhile arrives together; to one whose world stands still nothing is."""
        with contextlib.ExitStack() as together:
            for browser in self._open.values():
                if browser.mode not in STILL:
                    together.enter_context(browser.client.atomic())
            yield

    def join(self, number: int) -> None:
        """A page has been opened. One that is closed again already is passed over."""
        client = self._server.get_clients().get(number)
        if client is None or number in self._open:
            return
        with self._folder:  # the list is this browser's own, in the folder that all share
            chooser = client.gui.add_dropdown("Camera", CAMERA_MODES, initial_value=self._mode, order=-1.0)
        self._controls.on_change(chooser, partial(self._choose, number))
        frame = client.scene.add_frame(WORLD, show_axes=False)
        self._open[number] = _Browser(client, frame, chooser, UNMOVED, self._mode)
        # a page that has found its way to another server may keep the camera of the one before
        _stand(client, self._mode, self._opening)

    def look(self, framing: Framing, number: int | None = None) -> None:
        """Take the cameras that do not follow to a part of the flight: one browser's, or all."""
        for i, browser in self._open.items():
            if number in (i, None) and browser.mode in STILL:
                _stand(browser.client, browser.mode, framing)

    def settle(self) -> None:
        """Take the cameras of phones to where they begin: the view for all, sent as a page opens, may come last."""
        for browser in self._open.values():
            wide = camera(self._mode, self._opening)
            if _narrow(browser.client) and np.allclose(browser.client.camera.position, wide.position, rtol=1e-4):
                _stand(browser.client, browser.mode, self._opening)

    def leave(self, number: int) -> None:
        """A page has been closed."""
        self._open.pop(number, None)

    def choose(self, number: int, mode: CameraMode) -> None:
        """Look otherwise in one browser."""
        browser = self._open.get(number)
        if browser is not None and mode in CAMERA_MODES:
            browser.mode = mode
            write(browser.chooser, mode)
            _stand(browser.client, mode, self.framing)

    def reframe(self) -> None:
        """Take every browser's camera to where its mode begins. From there on it is the user's."""
        for browser in self._open.values():
            _stand(browser.client, browser.mode, self.framing)

    def show(self, sample: Sample) -> None:
        """Move the world where a camera follows. A world that stands still costs nothing."""
        for browser in self._open.values():
            pose = world(browser.mode, sample)
            if not np.array_equal(pose.position, browser.pose.position):
                browser.world.position = pose.position
            if not np.array_equal(pose.wxyz, browser.pose.wxyz):
                browser.world.wxyz = pose.wxyz
            browser.pose = pose
            eye = step_back(browser.mode, browser.client.camera.position, sample)
            if eye is not None:
                browser.client.camera.position = eye

    def pose(self, number: int) -> Pose | None:
        """How the world stands in a browser; None for one that has gone."""
        browser = self._open.get(number)
        return None if browser is None else browser.pose

    def last_moved(self) -> tuple[Array, Pose]:
        """Where the camera that moved last is, and how its world stands: sizes and names are one for all browsers."""
        if not self._open:
            return camera("Free", self.framing).position, UNMOVED
        browser = max(self._open.values(), key=lambda b: b.client.camera.update_timestamp)
        return browser.client.camera.position, browser.pose


def _stand(client: viser.ClientHandle, mode: CameraMode, framing: Framing) -> None:
    view = camera(mode, framing, narrow=_narrow(client))
    client.camera.position, client.camera.look_at = view.position, view.look_at


def _stands(client: viser.ClientHandle, mode: CameraMode, framing: Framing) -> bool:
    """Whether a camera is where `_stand` took it, or where the page began: nobody has moved it."""
    places = (camera(mode, framing, narrow=narrow).position for narrow in {_narrow(client), False})
    return any(np.allclose(client.camera.position, place, rtol=1e-3) for place in places)


def _narrow(client: viser.ClientHandle) -> bool:
    return client.camera.image_width < _NARROW * client.camera.image_height
