"""Bytes to messages and back: the only part that knows MAVLink's formats (and imports pymavlink). Knows no physics."""

from companion.mavlink.dialect import DEFAULT_DIALECT, Dialect, MessageLayout, dialect_names, enum_names, load_dialect
from companion.mavlink.frames import Damage, Decoder, Frames
from companion.mavlink.messages import Messages
from companion.mavlink.tlog import Log, read_tlog

__all__ = [
    "DEFAULT_DIALECT",
    "Damage",
    "Decoder",
    "Dialect",
    "Frames",
    "Log",
    "MessageLayout",
    "Messages",
    "dialect_names",
    "enum_names",
    "load_dialect",
    "read_tlog",
]
