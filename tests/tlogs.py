"""Tlogs packed message by message, most by pymavlink: what a vehicle would have sent."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.mavlink import Messages, Packer

EPOCH = 1_700_000_000.0
"""UNIX time of boot in these logs, s."""


def resting(path: Path) -> Path:
    """A log of 12 s at rest: enough for every command, and soon examined."""
    log = Writer(path)
    log.rest(12.0)
    return log.close()


def packed(messages: Sequence[Messages]) -> bytes:
    """Messages of several types as a tlog, in order of time; each sender's sequence is counted anew."""
    times = [(t, kind, i) for kind, one in enumerate(messages) for i, t in enumerate(one.log_time.tolist())]
    senders: dict[tuple[int, int], Packer] = {}
    out = bytearray()
    for t, kind, i in sorted(times):
        one = messages[kind]
        who = int(one.sysid[i]), int(one.compid[i])
        if who not in senders:
            senders[who] = Packer(*who)
        out += struct.pack(">Q", round(t * 1e6)) + senders[who].frame(one.layout, one.rows[i].tobytes())
    return bytes(out)


class Writer:
    """Writes a tlog. Each call is one packet: its stamp is the time since the log's beginning."""

    def __init__(self, path: Path, *, v1: bool = False) -> None:
        self.path = path
        self._file = path.open("wb")
        self._v1 = v1
        self._senders: dict[tuple[int, int], Any] = {}

    def send(self, t: float, name: str, *, sysid: int = 1, compid: int = 1, **fields: Any) -> None:
        """One message of class MAVLink_<name>_message, logged at t s."""
        sender = self._senders.setdefault((sysid, compid), mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid))
        message = getattr(mavlink, f"MAVLink_{name.lower()}_message")(**fields)
        packed = message.pack(sender, force_mavlink1=self._v1)
        sender.seq = (sender.seq + 1) % 256
        self.bytes(t, packed)

    def bytes(self, t: float, packet: bytes) -> None:
        """Any bytes as one packet."""
        self._file.write(struct.pack(">Q", int((EPOCH + t) * 1e6)) + packet)

    def close(self) -> Path:
        self._file.close()
        return self.path

    def heartbeat(self, t: float, *, autopilot: int = 3, kind: int = 2, **ids: int) -> None:
        """HEARTBEAT: by default an ArduPilot quadrotor."""
        self.send(
            t, "heartbeat", type=kind, autopilot=autopilot, base_mode=0, custom_mode=0, system_status=4,
            mavlink_version=3, **ids,
        )  # fmt: skip

    def raw_imu(self, t: float, boot: float, *, accel_mg: tuple[int, int, int] = (0, 0, -1000), **ids: Any) -> None:
        """RAW_IMU of a vehicle at rest, `boot` s after boot."""
        x, y, z = accel_mg
        self.send(
            t, "raw_imu", time_usec=round(boot * 1e6), xacc=x, yacc=y, zacc=z, xgyro=0, ygyro=0, zgyro=1,
            xmag=0, ymag=0, zmag=0, **ids,
        )  # fmt: skip

    def attitude(
        self, t: float, boot: float, *, roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0, **ids: int
    ) -> None:
        """ATTITUDE without rates."""
        self.send(
            t, "attitude", time_boot_ms=round(boot * 1e3), roll=roll, pitch=pitch, yaw=yaw, rollspeed=0, pitchspeed=0,
            yawspeed=0, **ids,
        )  # fmt: skip

    def local_position(self, t: float, boot: float, **ids: int) -> None:
        """LOCAL_POSITION_NED at (1, 2, -3) m."""
        self.send(t, "local_position_ned", time_boot_ms=round(boot * 1e3), x=1, y=2, z=-3, vx=0, vy=0, vz=0, **ids)

    def rest(self, duration: float, *, begin: float = 0.0, boot: float = 20.0, hz: float = 50.0, **ids: Any) -> None:
        """A vehicle at rest: heartbeats, IMU, attitude, position; its clock begins at `boot`, the log's at `begin`."""
        for i in range(round(duration * hz) + 1):
            t = i / hz
            if i % int(hz) == 0:
                self.heartbeat(begin + t, **ids)
            self.raw_imu(begin + t, boot + t, **ids)
            self.attitude(begin + t, boot + t, **ids)
            self.local_position(begin + t, boot + t, **ids)
