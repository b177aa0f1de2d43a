"""A scene over time, as one HTML page with a player of its own."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import viser
from viser.infra._infra import _remap_binary_placeholder_indices

from companion.view.scene.drone import Move

_FLOAT32 = np.dtype(np.float32).str
_POSES = {"wxyz": "SetOrientationMessage", "position": "SetPositionMessage"}


class Recording:
    """What a scene shows from now on. Moves are given to it; what else changes it sees by itself."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._recorded = recorded = server.get_scene_serializer()
        self._places: dict[bytes, int] = {}  # of the bytes of a buffer, in the recording
        buffers, recorded._binary_buffers = recorded._binary_buffers, []
        places = [self._place(buffer) for buffer in buffers]
        for _, message in recorded._messages:
            _remap_binary_placeholder_indices(message, places)

    def add(self, moves: Iterable[Move]) -> None:
        """Record moves of this instant, without a write to the server, to which nobody listens.

        Messages as viser 1.1 records them: its handles take twenty times as long to come to the same, and there are
        seven in each picture.
        """
        when, messages = self._recorded._time, self._recorded._messages
        for node, name, value in moves:
            # float32, of which the browser's numbers are made: the digits behind only make the file larger.
            rounded = value.astype(np.float32)
            message: dict[str, object]
            if name == "points":
                message = {"type": "SceneNodeUpdateMessage", "updates": {name: self._buffered(rounded)}}
            else:
                message = {"type": _POSES[name], name: rounded.tolist()}
            message["name"], message["owner"] = node.name, ""
            messages.append((when, message))

    def wait(self, seconds: float) -> None:
        """What follows is shown so much later."""
        self._recorded.insert_sleep(seconds)

    def html(self, *, dark: bool) -> str:
        """The page. To be asked for once."""
        return self._recorded.as_html(dark_mode=dark)

    def _buffered(self, array: np.ndarray[Any, Any]) -> dict[str, object]:
        """Where the bytes of an array are in the recording."""
        return {"__binary_index": self._place(array.data), "dtype": _FLOAT32}

    def _place(self, buffer: memoryview) -> int:
        """Where these bytes are, each kept once: what is there twice viser looks for in every message at the end."""
        buffers = self._recorded._binary_buffers
        place = self._places.setdefault(bytes(buffer), len(buffers))
        if place == len(buffers):
            buffers.append(buffer)
        return place
