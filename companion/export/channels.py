"""MCAP, whatever its messages are encoded as: channels, merged in order of time."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from companion.installation import missing
from companion.model import Array, Flight

Stamps = npt.NDArray[np.int64]
"""(N,) ns."""


NED_IN_ENU = np.array([0.0, np.sqrt(0.5), np.sqrt(0.5), 0.0])  # half a turn about north-east: swaps and flips
FLU_IN_FRD = np.array([0.0, 1.0, 0.0, 0.0])  # half a turn about forward


@dataclass(frozen=True, slots=True)
class Schema:
    """What the messages of a channel are: their name, and the text that describes their fields."""

    name: str
    encoding: str  # jsonschema, ros2msg
    text: bytes


@dataclass(frozen=True, slots=True)
class Channel:
    """Some messages of a topic, in order of time; other channels may have the same topic."""

    topic: str
    schema: Schema
    encoding: str  # of the messages: json, cdr
    stamps: Stamps
    messages: Iterable[bytes]  # N


def stamps_of(flight: Flight, t: Array) -> Stamps:
    """UNIX time of the boot clock's t (N,) s, where known, else t. In whole ns: a float has lost the µs since 1970."""
    base = round(flight.epoch.unix_s * 1e9) if flight.epoch else 0
    # A correction's time offset can reach to before the boot.
    return np.maximum(base + np.round(t * 1e9).astype(np.int64), 0)


def clock_of(flight: Flight) -> dict[str, str]:
    """What the stamps are, for the file's metadata."""
    return {
        "vehicle": f"{flight.vehicle} {flight.vehicle.autopilot} {flight.vehicle.type} {flight.vehicle.firmware}",
        "boot": str(flight.boot),
        "clock": f"UNIX time by {flight.epoch.source}" if flight.epoch else "seconds of the vehicle's boot clock",
        "boot_clock_zero_unix_s": f"{flight.epoch.unix_s:.6f}" if flight.epoch else "",
    }


def write_channels(path: Path, channels: Sequence[Channel], about: Mapping[str, str], *, profile: str = "") -> None:
    """Every message in order of time. profile: of MCAP's registry. Raises InputError when mcap is not installed."""
    try:
        from mcap.writer import CompressionType, Writer  # noqa: PLC0415  (an extra: needed for these formats alone)
    except ImportError:
        raise missing("export", "MCAP needs the mcap library") from None
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile=profile, library="companion")
        schemas, ids = dict[str, int](), dict[str, int]()
        for channel in channels:
            schema = channel.schema
            if schema.name not in schemas:
                schemas[schema.name] = writer.register_schema(schema.name, schema.encoding, schema.text)
            if channel.topic not in ids:
                ids[channel.topic] = writer.register_channel(channel.topic, channel.encoding, schemas[schema.name])
        writer.add_metadata("about", dict(about))
        streams = (_numbered(ids[channel.topic], channel) for channel in channels)
        for stamp, number, message in heapq.merge(*streams, key=lambda item: item[0]):
            writer.add_message(number, stamp, message, stamp)
        writer.finish()  # type: ignore[no-untyped-call]  # of the library


def _numbered(number: int, channel: Channel) -> Iterator[tuple[int, int, bytes]]:
    return ((stamp, number, one) for stamp, one in zip(channel.stamps.tolist(), channel.messages, strict=True))
