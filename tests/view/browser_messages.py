"""A page without a browser: what a server tells it to show, what it answers, and what it would make of markup."""

from __future__ import annotations

import contextlib
import struct
import time
from collections.abc import Callable, Iterator
from html.parser import HTMLParser
from typing import Any

import msgspec
import viser
import websockets
import websockets.sync.client
import websockets.sync.connection
import zstandard

from tests.waiting import LIMIT_S

Message = dict[str, Any]
"""A message: its type, and its fields."""

CAMERA: Message = {
    "type": "ViewerCameraMessage", "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [5.0, 5.0, 5.0], "fov": 1.0, "near": 0.1,
    "far": 100.0, "look_at": [0.0, 0.0, 0.0], "up_direction": [0.0, 0.0, -1.0], "image_height": 600, "image_width": 800,
}  # fmt: skip


def pack(message: object) -> bytes:
    return msgspec.msgpack.encode(message)


class PlainPage:
    """A connection as viser's page has one."""

    def __init__(self, socket: websockets.sync.connection.Connection) -> None:
        self._socket = socket
        self.messages: list[Message] = []

    def send(self, message: Message) -> None:
        self._socket.send(pack(message))

    def press(self, label: str) -> None:
        self.choose(label, True)

    def choose(self, label: str, value: object) -> None:
        self.send({"type": "GuiUpdateMessage", "uuid": self.control(label)["uuid"], "updates": {"value": value}})

    def control(self, label: str) -> Message:
        return next(one for one in self.messages if one.get("props", {}).get("label") == label)

    def listen(self, until: Callable[[], bool]) -> None:
        """Take what is sent until then. Raises TimeoutError when that does not come."""
        end = time.monotonic() + LIMIT_S
        while not until():
            if time.monotonic() > end:
                raise TimeoutError
            with contextlib.suppress(TimeoutError):
                raw = self._socket.recv(timeout=0.2)
                assert isinstance(raw, bytes)
                grown, packed = struct.unpack("<QQ", raw[:16])
                inner = zstandard.ZstdDecompressor().decompress(raw[16 : 16 + packed], max_output_size=grown)
                self.messages += msgspec.msgpack.decode(inner)["messages"]


@contextlib.contextmanager
def plain_page(url: str) -> Iterator[PlainPage]:
    """Open it, and have it drawn: a page is there when it has sent where its camera is."""
    version = websockets.Subprotocol(f"viser-v{viser.__version__}")
    address = url.replace("http", "ws", 1)
    with websockets.sync.client.connect(address, subprotocols=[version], proxy=None, max_size=None) as socket:
        page = PlainPage(socket)
        page.send(CAMERA)
        yield page


class Tags(HTMLParser):
    """What a browser would make of a piece of markup: its tags, their attributes, its words."""

    def __init__(self, markup: str) -> None:
        super().__init__(convert_charrefs=True)
        self.tags, self.attributes, self.words = set[str](), set[str](), ""
        self.feed(markup)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}

    def handle_data(self, data: str) -> None:
        self.words += data
