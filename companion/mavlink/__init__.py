"""Bytes to messages and back: the only part that knows MAVLink's formats (and imports pymavlink). Knows no physics."""

from companion.mavlink.address import Address, is_link, parse_address
from companion.mavlink.dataflash import DataflashLog, Records, read_dataflash
from companion.mavlink.dataflash_text import read_dataflash_text
from companion.mavlink.declarations import RecordLayout
from companion.mavlink.dialect import DEFAULT_DIALECT, Dialect, MessageLayout, dialect_names, enum_names, load_dialect
from companion.mavlink.encode import encode, make_messages
from companion.mavlink.frames import Damage, Decoder, Frames
from companion.mavlink.link import Link, LinkHealth, open_port
from companion.mavlink.logfile import MOST_BYTES, Contents, log_format
from companion.mavlink.messages import Messages, join, split_messages
from companion.mavlink.modes import mode_name, px4_nav_state_name
from companion.mavlink.pack import Packer, Value
from companion.mavlink.playback import Played, play
from companion.mavlink.ports import NotThereError, Port
from companion.mavlink.rates import Rates
from companion.mavlink.recognise import looks_like_a_log
from companion.mavlink.recorder import Recorder
from companion.mavlink.requests import ForbiddenMessageError, Request, Target, announce
from companion.mavlink.session import Arriving, Choice, Report, Session
from companion.mavlink.signing import load_key
from companion.mavlink.timesync import Clock
from companion.mavlink.tlog import Log, TlogWriter, follow_tlog, read_tlog, write_tlog
from companion.mavlink.wishes import State, Wish

__all__ = [
    "DEFAULT_DIALECT",
    "MOST_BYTES",
    "Address",
    "Arriving",
    "Choice",
    "Clock",
    "Contents",
    "Damage",
    "DataflashLog",
    "Decoder",
    "Dialect",
    "ForbiddenMessageError",
    "Frames",
    "Link",
    "LinkHealth",
    "Log",
    "MessageLayout",
    "Messages",
    "NotThereError",
    "Packer",
    "Played",
    "Port",
    "Rates",
    "RecordLayout",
    "Recorder",
    "Records",
    "Report",
    "Request",
    "Session",
    "State",
    "Target",
    "TlogWriter",
    "Value",
    "Wish",
    "announce",
    "dialect_names",
    "encode",
    "enum_names",
    "follow_tlog",
    "is_link",
    "join",
    "load_dialect",
    "load_key",
    "log_format",
    "looks_like_a_log",
    "make_messages",
    "mode_name",
    "open_port",
    "parse_address",
    "play",
    "px4_nav_state_name",
    "read_dataflash",
    "read_dataflash_text",
    "read_tlog",
    "split_messages",
    "write_tlog",
]
