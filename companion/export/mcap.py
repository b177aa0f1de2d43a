"""A flight as an MCAP file for Foxglove: poses, places on the map, IMU readings, errors, texts, findings.

Frames: `enu` (x east, y north, z up) is the root, so that what is shown in it stands the right way up; `ned` hangs in
it; `autopilot_frd`, `imu_frd` and `best_frd` (x forward, y right, z down) move in `ned`; `autopilot`, `imu` and `best`
are the same bodies with Foxglove's and ROS's axes (FLU: x forward, y left, z up), for models and cameras.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from companion.analysis import Assessment, Replay
from companion.export import foxglove
from companion.export.kml import COLOURS, geodetic, paths
from companion.export.table import Contents, Format, Table, series_name
from companion.installation import missing
from companion.model import Array, Flight, words

_NED_IN_ENU = np.array([[0.0, np.sqrt(0.5), np.sqrt(0.5), 0.0]])  # half a turn about north-east: swaps and flips
_FLU_IN_FRD = np.array([[0.0, 1.0, 0.0, 0.0]])  # half a turn about forward
_HERE = np.zeros((1, 3))
_STATIC_S = 1.0  # frames that do not move are repeated so often, for those who join in mid-file


@dataclass(frozen=True, slots=True)
class Topic:
    """One channel: its messages in order of time, without their `timestamp`."""

    name: str
    schema: foxglove.Schema
    t: Array  # (N,) s, boot clock
    messages: Iterable[foxglove.Message]  # N


def write_mcap(
    path: Path, flight: Flight, shown: Replay, assessed: Assessment, series: Iterable[Table] = ()
) -> list[Path]:
    """Every topic in order of time. Stamps are UNIX time where it is known, else the boot clock (see `about`).

    Raises InputError when mcap is not installed.
    """
    try:
        from mcap.writer import CompressionType, Writer  # noqa: PLC0415  (an extra: needed for this format alone)
    except ImportError:
        raise missing("export", "MCAP needs the mcap library") from None
    topics = [*_topics(flight, shown, assessed), *(_series(table) for table in series)]
    encoder = msgspec.json.Encoder()
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="", library="companion")
        schemas, channels = dict[str, int](), dict[str, int]()
        for topic in topics:
            title = topic.schema["title"]
            if title not in schemas:
                schemas[title] = writer.register_schema(title, "jsonschema", encoder.encode(topic.schema))
            if topic.name not in channels:
                channels[topic.name] = writer.register_channel(topic.name, "json", schemas[title])
        writer.add_metadata("about", _about(flight))
        base = round(flight.epoch.unix_s * 1e9) if flight.epoch else 0
        streams = [_stamped(channels[topic.name], base, topic) for topic in topics]
        for stamp, channel, message in heapq.merge(*streams, key=lambda item: item[0]):
            writer.add_message(channel, stamp, encoder.encode(message), stamp)
        writer.finish()  # type: ignore[no-untyped-call]  # of the library
    return [path]


def _topics(flight: Flight, shown: Replay, assessed: Assessment) -> Iterator[Topic]:
    t, best = shown.t, assessed.best
    beats = t[0] + _STATIC_S * np.unique(np.floor((t - t[0]) / _STATIC_S))  # none in gaps, which may be of any length
    bodies = [
        ("autopilot", t, shown.position_ref, shown.q_ref),
        ("imu", t, shown.position_imu, shown.q_imu),
        *([("best", best.t, best.position, best.q_ned_frd)] if best else []),
    ]
    for parent, child, q in (
        ("enu", "ned", _NED_IN_ENU),
        *((f"{name}_frd", name, _FLU_IN_FRD) for name, *_ in bodies),
    ):
        (still,) = foxglove.transforms(parent, child, _HERE, q)
        yield Topic("/tf", foxglove.TRANSFORM, beats, [still] * len(beats))
    drawn = paths(shown, best)
    for name, times, position, q in bodies:
        yield Topic("/tf", foxglove.TRANSFORM, times, foxglove.transforms("ned", f"{name}_frd", position, q))
        yield Topic(f"/{name}/pose", foxglove.POSE, times, foxglove.poses("ned", position, q))
        if name in drawn and (where := geodetic(flight, position, best if name == "best" else None)) is not None:
            yield Topic(f"/{name}/location", foxglove.LOCATION, times, foxglove.locations(name, where))
    for name, path in drawn.items():
        yield Topic("/paths", foxglove.SCENE, t[:1], [foxglove.line(name, path, COLOURS[name])])
    velocity, position = shown.velocity_error, shown.position_error
    yield Topic("/error", foxglove.ERROR, t, foxglove.errors(shown.attitude_error, velocity, position))
    for name, track in flight.imus.items():
        messages = foxglove.readings("imu_frd", track.gyro, track.accel)
        yield Topic(f"/imu/{name}", foxglove.IMU, track.t, messages)
    texts = sorted(flight.texts, key=lambda text: text.t)
    rows = [foxglove.log(foxglove.level_of(text.severity), text.text, str(flight.vehicle)) for text in texts]
    yield Topic("/statustext", foxglove.LOG, np.array([text.t for text in texts]), rows)
    findings = sorted(assessed.verdict.findings, key=lambda finding: finding.start_s)
    rows = [foxglove.log(foxglove.LEVELS[f.severity], f"{words(f.kind)}: {f.evidence}", f.side) for f in findings]
    yield Topic("/findings", foxglove.LOG, np.array([finding.start_s for finding in findings]), rows)


def _series(table: Table) -> Topic:
    columns = [column for column in table if column.name not in ("t_s", "unix_s")]
    names = [column.name for column in columns]
    rows = zip(*(column.values.tolist() for column in columns), strict=True)
    schema = foxglove.series_schema(table.name, names)
    return Topic(f"/{table.name}", schema, table["t_s"], (dict(zip(names, row, strict=True)) for row in rows))


def _stamped(channel: int, base: int, topic: Topic) -> Iterator[tuple[int, int, foxglove.Message]]:
    """(ns, channel, message with its timestamp). In whole ns: a float has lost the microseconds since 1970."""
    stamps = base + np.round(topic.t * 1e9).astype(np.int64)
    for stamp, message in zip(stamps.tolist(), topic.messages, strict=True):
        at = max(stamp, 0)  # a correction's time offset can reach to before the boot
        sec, nsec = divmod(at, 1_000_000_000)
        yield at, channel, {"timestamp": {"sec": sec, "nsec": nsec}, **message}


def _about(flight: Flight) -> dict[str, str]:
    clock = f"UNIX time by {flight.epoch.source}" if flight.epoch else "seconds of the vehicle's boot clock"
    return {
        "vehicle": f"{flight.vehicle} {flight.vehicle.autopilot} {flight.vehicle.type} {flight.vehicle.firmware}",
        "boot": str(flight.boot),
        "clock": clock,
        "boot_clock_zero_unix_s": f"{flight.epoch.unix_s:.6f}" if flight.epoch else "",
        "frames": "enu > ned > autopilot_frd > autopilot (FLU), ned > imu_frd > imu (FLU), ned > best_frd > best",
        "units": "m, m/s, m/s2, rad, rad/s; error = autopilot minus IMU",
    }


def _write(path: Path, one: Contents) -> list[Path]:
    series = (one.tables[series_name(key)] for key in one.flight.series)
    return write_mcap(path, one.flight, one.shown, one.assessment, series)


FORMATS = (Format("mcap", "Foxglove", _write),)
