"""Frames packed by pymavlink: the independent writer that the reader is tested against."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
import pymavlink.dialects.v20.ardupilotmega as mavlink


def stamped(frame: bytes, microseconds: int) -> bytes:
    """A frame as it lies in a tlog."""
    return struct.pack(">Q", microseconds) + frame


def link_frames(count: int, *, seed: int = 1, version: int = 2, signed: bool = False) -> Iterator[bytes]:
    """Frames of a link with varied messages, lengths and trimmed zeros, as pymavlink packs them."""
    rng = np.random.default_rng(seed)
    link: Any = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    if signed:
        link.signing.secret_key = bytes(range(32))
        link.signing.sign_outgoing = True
    for index in range(count):
        small = [int(v) for v in rng.integers(-3000, 3000, 9)]
        floats = [float(v) for v in rng.normal(size=7)]
        messages = (
            mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 4, 3),
            mavlink.MAVLink_raw_imu_message(index * 10_000, *small, id=0, temperature=4500 if index % 2 else 0),
            mavlink.MAVLink_attitude_message(index * 10, *floats[:6]),
            mavlink.MAVLink_local_position_ned_message(index * 10, *floats[:6]),
            mavlink.MAVLink_statustext_message(6, b"EKF3 IMU0 is using GPS"),
            mavlink.MAVLink_param_value_message(b"AHRS_TRIM_X", floats[0], 9, 1000, index % 1000),
            mavlink.MAVLink_attitude_quaternion_message(index, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        )
        yield messages[index % len(messages)].pack(link, force_mavlink1=version == 1)
        link.seq = (link.seq + 1) % 256


def unknown_frame(number: int, payload: bytes, seq: int) -> bytes:
    """A frame of a message that the dialect does not have, with the CRC_EXTRA that its own dialect gives it."""
    body = struct.pack("<BBBBBBHB", len(payload), 0, 0, seq, 1, 1, number & 0xFFFF, number >> 16) + payload
    return b"\xfd" + body + struct.pack("<H", mavlink.x25crc(body + bytes([number % 251])).crc)
