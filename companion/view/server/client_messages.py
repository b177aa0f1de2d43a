"""What a browser may send: the messages that the page itself sends, with numbers that are numbers.

viser takes any message of any type from any client and believes what is in it: a canvas of no height divides by zero,
NaN ends up in every picture, a request to share publishes the page on the internet, and upload parts stay in memory.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

MOST_BYTES = 1 << 16
MOST_PICTURE_BYTES = 1 << 25
_MOST_PIXELS = 1 << 25  # 8K and a little: a small PNG may claim to be of any size, and is unpacked to it
_MOST = 1e9  # m, pixels, s: nothing in a picture is larger
_LONGEST = 256  # characters of a name or a choice
_SEVERAL = 16  # numbers in one control
_LEAST = 1e-9  # of what is positive, and of the length of a direction: nothing is divided by less
_PNG = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR"

Number = Annotated[float, Meta(ge=-_MOST, le=_MOST)]  # which NaN is not
Positive = Annotated[float, Meta(gt=_LEAST, le=_MOST)]
Pixels = Annotated[int, Meta(gt=0, le=int(_MOST))]
Name = Annotated[str, Meta(max_length=_LONGEST)]
Numbers = Annotated[list[Number], Meta(max_length=_SEVERAL)]
Vector = tuple[Number, Number, Number]
Quaternion = tuple[Number, Number, Number, Number]


class _Whole(msgspec.Struct, forbid_unknown_fields=True):
    """Has its fields, and no others."""


class _Camera(_Whole, tag="ViewerCameraMessage"):
    wxyz: Quaternion
    position: Vector
    look_at: Vector
    up_direction: Vector
    fov: Annotated[float, Meta(gt=_LEAST, lt=math.pi)]
    near: Positive
    far: Positive
    image_height: Pixels
    image_width: Pixels

    def __post_init__(self) -> None:
        _check(math.hypot(*self.wxyz) > _LEAST and math.hypot(*self.up_direction) > _LEAST)


class _Updates(_Whole):
    value: bool | Number | Name | Numbers | None


class _Update(_Whole, tag="GuiUpdateMessage"):
    uuid: Name
    updates: _Updates


class _Command(_Whole, tag="CommandTriggerMessage"):
    uuid: Name


class _Click(_Whole, tag="ScenePointerMessage"):
    event_type: Literal["click"]
    ray_origin: Vector
    ray_direction: Vector
    screen_pos: tuple[tuple[Number, Number]]
    modifier: None

    def __post_init__(self) -> None:
        _check(math.hypot(*self.ray_direction) > _LEAST)


class _Picture(_Whole, tag="GetRenderResponseMessage"):
    """The canvas that was requested, a PNG of a bounded size; viser drops one that was not requested."""

    payload: bytes
    render_uuid: Name

    def __post_init__(self) -> None:
        size = self.payload[len(_PNG) : len(_PNG) + 8]
        _check(self.payload.startswith(_PNG) and len(size) == 8)
        _check(0 < int.from_bytes(size[:4]) * int.from_bytes(size[4:]) <= _MOST_PIXELS)


def _check(right: bool) -> None:
    if not right:
        raise ValueError


KINDS = frozenset(one.__struct_config__.tag for one in (_Camera, _Update, _Command, _Click, _Picture))
"""All that is received: what the controls of the pages make a browser send. A new kind of control may need another."""
_MESSAGE = msgspec.msgpack.Decoder(_Camera | _Update | _Command | _Click | _Picture)
_LONG_MESSAGE = msgspec.msgpack.Decoder(_Picture)  # nothing is built of what is none, whatever its length


def accepted(raw: object) -> bool:
    """Whether a message is one that the page sends, and whole."""
    if not isinstance(raw, bytes) or len(raw) > MOST_PICTURE_BYTES:
        return False
    try:
        (_MESSAGE if len(raw) <= MOST_BYTES else _LONG_MESSAGE).decode(raw)
    except (ValueError, TypeError, RecursionError):  # msgspec.DecodeError is a ValueError
        return False
    return True
