"""MAVLink 2 signing. https://mavlink.io/en/guide/message_signing.html"""

from __future__ import annotations

import hashlib
import hmac
import re
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt

from companion.mavlink.frames import Frames
from companion.mavlink.headers import HEADER_2, SIGNATURE_BYTES, SIGNED
from companion.model import InputError

_EPOCH = 1_420_070_400  # s UNIX: signing's clock counts 10 µs from 1 January 2015
_TICKS_S = 100_000
_STALE = 60 * _TICKS_S  # a new sender may be a minute behind


def load_key(path: str | Path) -> bytes:
    """The 32 bytes of a key: 64 hexadecimal digits, or else a passphrase, of which SHA-256 is the key.

    A passphrase as MAVProxy's `signing setup` and QGroundControl take it. Raises InputError for a file that cannot be
    read or is empty.
    """
    try:
        text = Path(path).read_bytes().strip()
    except OSError as error:
        raise InputError(f"{path}: the signing key cannot be read ({error.strerror}).") from None
    if not text:
        raise InputError(f"{path} is empty: a signing key is 64 hexadecimal digits, or a passphrase.")
    return bytes.fromhex(text.decode()) if re.fullmatch(rb"[0-9a-fA-F]{64}", text) else hashlib.sha256(text).digest()


def now_ticks() -> int:
    """The time as signatures carry it."""
    return int((time.time() - _EPOCH) * _TICKS_S)


def is_signed(frames: Frames) -> npt.NDArray[np.bool_]:
    """Which frames carry a signature, right or not: (N,)."""
    second = frames.payload - frames.start == HEADER_2
    return np.asarray(second & (frames.data[frames.start + 2] & SIGNED != 0))


class Verifier:
    """Passes frames that are signed with the key, and newer than those that their sender signed before."""

    def __init__(self, key: bytes) -> None:
        self.unsigned = 0  # frames dropped because they carry no signature
        self.wrong = 0  # ... because it is not of our key, or is repeated
        self._key = key
        self._last: dict[tuple[int, int, int], int] = {}  # link id and sender → time of the last signature

    def check(self, frames: Frames) -> Frames:
        """Those that pass."""
        good = np.array([self._passes(frames, i) for i in range(len(frames))], dtype=np.bool_)
        return frames if good.all() else frames.select(good)

    def _passes(self, frames: Frames, i: int) -> bool:
        start, end = int(frames.start[i]), int(frames.start[i] + frames.size[i])
        is_second = int(frames.payload[i]) - start == HEADER_2
        if not (is_second and frames.data[start + 2] & SIGNED):
            self.unsigned += 1
            return False
        signature = frames.data[end - SIGNATURE_BYTES : end].tobytes()
        signed = frames.data[start : end - 6].tobytes()
        right = hashlib.sha256(self._key + signed).digest()[:6]
        ticks = int.from_bytes(signature[1:7], "little")
        sender = (signature[0], int(frames.sysid[i]), int(frames.compid[i]))
        oldest = self._last.get(sender, now_ticks() - _STALE)
        if not hmac.compare_digest(right, signature[7:]) or ticks <= oldest:
            self.wrong += 1
            return False
        self._last[sender] = ticks
        return True
