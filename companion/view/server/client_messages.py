"""What a browser may send: the messages that the page itself sends, with numbers that are numbers.

viser takes any message of any type from any client and believes what is in it: a canvas of no height divides by zero,
NaN ends up in every picture, a request to share publishes the page on the internet, and upload parts stay in memory.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import msgspec

MOST_BYTES = 1 << 16
MOST_PICTURE_BYTES = 1 << 25
_MOST_PIXELS = 1 << 25  # 8K and a little: a small PNG may claim to be of any size, and is unpacked to it
_MOST = 1e9  # m, pixels, s: nothing in a picture is larger
_LONGEST = 256  # characters of a name or a choice
_SEVERAL = 16  # numbers in one control
_LEAST = 1e-9  # of what is positive, and of the length of a direction: nothing is divided by less


def accepted(raw: object) -> bool:
    """Whether a message is one that the page sends, and whole."""
    if not isinstance(raw, bytes):
        return False
    if len(raw) > MOST_BYTES:
        return _picture(raw)
    try:
        message = msgspec.msgpack.decode(raw)
    except (ValueError, TypeError, RecursionError):  # msgspec.DecodeError is a ValueError; keys may be unhashable
        return False
    if not isinstance(message, dict):
        return False
    fields = dict(message)
    kind = fields.pop("type", None)
    if kind == "GetRenderResponseMessage":
        return _picture(raw)
    return isinstance(kind, str) and kind in _CHECKS and _CHECKS[kind](fields)


class _Picture(msgspec.Struct, tag="GetRenderResponseMessage", forbid_unknown_fields=True):
    """The canvas that was requested; viser drops one that was not."""

    payload: bytes
    render_uuid: str


_PICTURE = msgspec.msgpack.Decoder(_Picture)
_PNG = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR"


def _picture(raw: bytes) -> bool:
    """Whether it is a PNG of a bounded size; nothing is built of what is not, whatever its length."""
    if len(raw) > MOST_PICTURE_BYTES:
        return False
    try:
        message = _PICTURE.decode(raw)
    except (ValueError, TypeError, RecursionError):
        return False
    size = message.payload[len(_PNG) : len(_PNG) + 8]
    if not (_name(message.render_uuid) and message.payload.startswith(_PNG) and len(size) == 8):
        return False
    return 0 < int.from_bytes(size[:4]) * int.from_bytes(size[4:]) <= _MOST_PIXELS


def _camera(message: Mapping[str, Any]) -> bool:
    vectors = {"wxyz": 4, "position": 3, "look_at": 3, "up_direction": 3}
    numbers = ("fov", "near", "far", "image_height", "image_width")
    return (
        message.keys() == {*vectors, *numbers}
        and all(_vector(message[name], size) for name, size in vectors.items())
        and all(_number(message[name]) and message[name] > _LEAST for name in numbers)
        and all(isinstance(message[name], int) for name in ("image_height", "image_width"))
        and message["fov"] < math.pi
        and math.hypot(*message["wxyz"]) > _LEAST
        and math.hypot(*message["up_direction"]) > _LEAST
    )


def _update(message: Mapping[str, Any]) -> bool:
    updates = message.get("updates")
    return (
        message.keys() == {"uuid", "updates"}
        and _name(message["uuid"])
        and isinstance(updates, dict)
        and updates.keys() == {"value"}
        and _value(updates["value"])
    )


def _click(message: Mapping[str, Any]) -> bool:
    places = message.get("screen_pos")
    return (
        message.keys() == {"event_type", "ray_origin", "ray_direction", "screen_pos", "modifier"}
        and message["event_type"] == "click"
        and message["modifier"] is None
        and _vector(message["ray_origin"], 3)
        and _vector(message["ray_direction"], 3)
        and math.hypot(*message["ray_direction"]) > _LEAST
        and isinstance(places, list)
        and len(places) == 1
        and _vector(places[0], 2)
    )


def _command(message: Mapping[str, Any]) -> bool:
    return message.keys() == {"uuid"} and _name(message["uuid"])


_CHECKS: Mapping[str, Callable[[Mapping[str, Any]], bool]] = {
    "ViewerCameraMessage": _camera,
    "GuiUpdateMessage": _update,
    "CommandTriggerMessage": _command,
    "ScenePointerMessage": _click,
}

KINDS = frozenset({*_CHECKS, "GetRenderResponseMessage"})
"""All that is received: what the controls of the pages make a browser send. A new kind of control may need another."""


def _value(value: object) -> bool:
    if isinstance(value, list):
        return len(value) <= _SEVERAL and all(map(_number, value))
    return isinstance(value, bool) or value is None or _name(value) or _number(value)


def _vector(value: object, size: int) -> bool:
    return isinstance(value, list) and len(value) == size and all(map(_number, value))


def _number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _MOST  # which NaN is not


def _name(value: object) -> bool:
    return isinstance(value, str) and len(value) <= _LONGEST
