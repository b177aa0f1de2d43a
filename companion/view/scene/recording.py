"""A scene over time, as one HTML page with a player of its own."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import viser

from companion.view.scene.drone import Move

_FLOAT32 = np.dtype(np.float32).str
_POSES = {"wxyz": "SetOrientationMessage", "position": "SetPositionMessage"}


class Recording:
    """What a scene shows from now on. Moves are given to it; what else changes it sees by itself."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._recorded = server.get_scene_serializer()

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
        buffers = self._recorded._binary_buffers
        buffers.append(array.data)
        return {"__binary_index": len(buffers) - 1, "dtype": _FLOAT32}
