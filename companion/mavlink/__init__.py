"""MAVLink itself, bytes to messages and back: the only part that imports pymavlink. Knows no link and no physics."""

from companion.mavlink.dialect import (
    DEFAULT_DIALECT,
    NO_VEHICLES,
    Dialect,
    MessageLayout,
    dialect_names,
    load_dialect,
    mode_name,
    px4_nav_state_name,
)
from companion.mavlink.encode import Packer, Value, Verifier, is_signed, load_key
from companion.mavlink.frames import Damage, Decoder, Frames
from companion.mavlink.headers import HEADER_1, MAGIC_1, MAGIC_2, Bytes, Index, first_come, gather
from companion.mavlink.messages import Collected, Messages, as_bytes, log_time, split_messages, together
