"""Bytes to messages and back: the only part that knows MAVLink's formats (and imports pymavlink). Knows no physics."""

from companion.mavlink.dataflash import DataflashLog, RecordLayout, Records, read_dataflash
from companion.mavlink.dialect import DEFAULT_DIALECT, Dialect, MessageLayout, dialect_names, enum_names, load_dialect
from companion.mavlink.encode import encode, make_messages
from companion.mavlink.frames import Damage, Decoder, Frames
from companion.mavlink.logfile import log_format
from companion.mavlink.messages import Messages, split_messages
from companion.mavlink.tlog import Log, TlogWriter, follow_tlog, read_tlog, write_tlog

__all__ = [
    "DEFAULT_DIALECT",
    "Damage",
    "DataflashLog",
    "Decoder",
    "Dialect",
    "Frames",
    "Log",
    "MessageLayout",
    "Messages",
    "RecordLayout",
    "Records",
    "TlogWriter",
    "dialect_names",
    "encode",
    "enum_names",
    "follow_tlog",
    "load_dialect",
    "log_format",
    "make_messages",
    "read_dataflash",
    "read_tlog",
    "split_messages",
    "write_tlog",
]
