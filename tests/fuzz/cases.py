"""What is fuzzed, how inputs are changed, and what a case may end in: a result, or a CompanionError."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc

from companion.app.correction import load_correction
from companion.app.sensors import load_imu_spec
from companion.app.settings import load_settings
from companion.cli import main
from companion.fleet.task import limited
from companion.mavlink import DEFAULT_DIALECT
from companion.model import CompanionError
from companion.telemetry import Stream
from companion.view.server.origin_check import accepted
from tests.fuzz import contents, logs
from tests.fuzz.contents import Contents

Random = np.random.Generator
SLOWEST_S, MEMORY_GB = 20.0, 1.0
_HANGING_S = 600.0  # by the clock on the wall

_NUMBERS = [
    *(struct.pack("<d", x) for x in (np.nan, np.inf, -np.inf, 1e300, -1.0, 0.0)),
    *(struct.pack("<f", x) for x in (np.nan, np.inf, 1.2e19, -1.0)),
    *(struct.pack("<Q", x) for x in (0, 1, 2**31, 2**32 - 1, 2**63, 2**64 - 1)),
    b"\xff" * 4, b"\0" * 16, b"\xa3\x95\x80", b"\xfd\x09", b"ULog",
]  # fmt: skip

_WORDS = [
    b"nan",
    b"-inf",
    b"1e999",
    b"9" * 5000,
    b"x" * 100_000,
    b"",
    b"\n",
    b"-1",
    b"\xff\x1b[31m",
    b"FMT",
    b"1e19",
    b"0x10",
]


def changed(data: bytes, random: Random) -> bytes:
    """The data with one to eight changes: bits, numbers, pieces left out, doubled, moved or cut off."""
    found = bytearray(data)
    for _ in range(int(random.integers(1, 9))):
        if not found:
            break
        at = int(random.integers(len(found)))
        size = int(random.choice([1, 8, 60, 2000]))
        match int(random.integers(7)):
            case 0 | 1:
                found[at] ^= 1 << int(random.integers(8))
            case 2 | 3:
                number = _NUMBERS[int(random.integers(len(_NUMBERS)))]
                found[at : at + len(number)] = number
            case 4:
                del found[at : at + size]
            case 5:
                found[at:at] = found[at : at + size]
            case _:
                del found[at + int(random.integers(len(found))) :]
    return bytes(found)


def text_changed(data: bytes, random: Random) -> bytes:
    """A text in which some words are others, long or of another kind; or changed as any data."""
    if random.integers(2):
        return changed(data, random)
    parts = data.split(b",")
    for _ in range(int(random.integers(1, 9))):
        parts[int(random.integers(len(parts)))] = _WORDS[int(random.integers(len(_WORDS)))]
    return b",".join(parts)


def frames_changed(data: bytes, random: Random) -> bytes:
    """A tlog in which some payloads are changed and their checksums are right again."""
    found = bytearray(data)
    starts, at = [], 8
    while at + 12 < len(found):
        starts.append(at)
        at += 12 + found[at + 1] + 8
    for start in random.choice(starts, int(random.integers(1, 30))).tolist():
        size, number = found[start + 1], int.from_bytes(found[start + 7 : start + 10], "little")
        place = start + 10 + int(random.integers(size))
        new = _NUMBERS[int(random.integers(len(_NUMBERS)))][: start + 10 + size - place]
        found[place : place + len(new)] = new
        crc = x25crc(bytes(found[start + 1 : start + 10 + size]))
        crc.accumulate(bytes([mavlink.mavlink_map[number].crc_extra]))
        found[start + 10 + size : start + 12 + size] = struct.pack("<H", crc.crc)
    return bytes(found) if random.integers(2) else changed(bytes(found), random)


def read_log(path: Path) -> None:
    """As `info` and `analyze` do. They end in a code that is documented."""
    for command in ("info", "analyze"):
        code = main([command, str(path), "--json"])
        assert code in (0, 2), f"{command} ended in {code}"


def read_toml(path: Path) -> None:
    for load in (load_settings, load_correction, lambda p: load_imu_spec(str(p))):
        try:
            load(path)
        except CompanionError:
            continue


def hear(path: Path) -> None:
    """As a live link does, in pieces."""
    data = path.read_bytes()
    stream = Stream(dialect=DEFAULT_DIALECT, window_s=60.0)
    for i in range(0, len(data), 4096):
        stream.push(data[i : i + 4096], 1.7e9 + i / 4096)
    stream.flights()
    stream.recent(5.0)


def browse(path: Path) -> None:
    accepted(path.read_bytes())


def camera() -> bytes:
    said: dict[str, Any] = {
        "type": "ViewerCameraMessage", "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [5.0, 5.0, 5.0], "fov": 1.0,
        "near": 0.1, "far": 100.0, "look_at": [0.0, 0.0, 0.0], "up_direction": [0.0, 0.0, -1.0], "image_height": 600,
        "image_width": 800,
    }  # fmt: skip
    return msgspec.msgpack.encode(said)


def messages_changed(data: bytes, random: Random) -> bytes:
    """A camera, or another message of the page, changed."""
    value = [True, 3.5, "Free", [1.0, 2.0]][int(random.integers(4))]
    others: list[dict[str, Any]] = [
        {"type": "GuiUpdateMessage", "uuid": "a", "updates": {"value": value}},
        {"type": "CommandTriggerMessage", "uuid": "a"},
        {"type": "GetRenderResponseMessage", "payload": b"\x89PNG\r\n\x1a\n" + bytes(99), "render_uuid": "a"},
    ]
    which = int(random.integers(len(others) + 1))
    return changed(msgspec.msgpack.encode(others[which]) if which < len(others) else data, random)


Target = tuple[str, bytes, Callable[[bytes, Random], bytes], Callable[[Path], None]]


def targets(folder: Path) -> dict[str, Target]:
    """By name: what its files end in, one that is good, how it is changed, and what reads it."""
    tlog = logs.tlog(folder / "good.tlog")

    def bent(of: Callable[[], Contents]) -> Callable[[bytes, Random], bytes]:
        """Another log than the small good one, which is read when it is first asked for."""
        return lambda _, random: of().bent(random)

    return {
        "tlog": (".tlog", tlog, frames_changed, read_log),
        "bin": (".bin", logs.dataflash(), changed, read_log),
        "log": (".log", logs.dataflash_text(), text_changed, read_log),
        "ulg": (".ulg", logs.ulog(), changed, read_log),
        "bent tlog": (".tlog", b"", bent(contents.of_tlog), read_log),
        "bent bin": (".bin", b"", bent(partial(contents.of_dataflash, folder)), read_log),
        "bent ulg": (".ulg", b"", bent(partial(contents.of_ulog, folder)), read_log),
        "toml": (".toml", logs.TOML.encode(), changed, read_toml),
        "live": (".raw", tlog, frames_changed, hear),
        "websocket": (".msg", camera(), messages_changed, browse),
    }


def attempt(path: Path, read: Callable[[Path], None]) -> str | None:
    """What is wrong with how a case ended; None for nothing. The time is the processor's: others may be busy too."""
    begin = time.process_time()
    try:
        with limited(MEMORY_GB, _HANGING_S):
            read(path)
    except CompanionError as error:
        return None if "longer than" not in str(error) else str(error)
    except Exception as error:  # noqa: BLE001  (it is what is looked for)
        return f"{type(error).__name__}: {error}"
    took = time.process_time() - begin
    return f"it took {took:.0f} s of a core" if took > SLOWEST_S else None
