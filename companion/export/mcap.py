"""A flight as an MCAP file for Foxglove: poses, places on the map, IMU readings, errors, texts, findings.

Frames: `enu` (x east, y north, z up) is the root, so that what is shown in it stands the right way up; `ned` hangs in
it; `autopilot_frd`, `imu_frd` and `best_frd` (x forward, y right, z down) move in `ned`; `autopilot`, `imu` and `best`
are the same bodies with Foxglove's and ROS's axes (FLU: x forward, y left, z up), for models and cameras.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from companion.analysis import Assessment, Replay
from companion.export import foxglove
from companion.export.channels import Channel, Schema, clock_of, stamps_of, write_channels
from companion.export.kml import COLOURS, geodetic, paths
from companion.export.table import Contents, Format, Table, series_name
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
    write_channels(path, _channels(flight, shown, assessed, series), _about(flight))
    return [path]


def _channels(flight: Flight, shown: Replay, assessed: Assessment, series: Iterable[Table]) -> list[Channel]:
    topics = [*_topics(flight, shown, assessed), *(_series(table) for table in series)]
    return [_channel(flight, topic) for topic in topics]


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


def _channel(flight: Flight, topic: Topic) -> Channel:
    """Each message as JSON with its timestamp."""
    encode = msgspec.json.Encoder().encode
    stamps = stamps_of(flight, topic.t)

    def messages() -> Iterator[bytes]:
        for stamp, message in zip(stamps.tolist(), topic.messages, strict=True):
            sec, nsec = divmod(stamp, 1_000_000_000)
            yield encode({"timestamp": {"sec": sec, "nsec": nsec}, **message})

    schema = Schema(topic.schema["title"], "jsonschema", encode(topic.schema))
    return Channel(topic.name, schema, "json", stamps, messages())


def _about(flight: Flight) -> dict[str, str]:
    return {
        **clock_of(flight),
        "frames": "enu > ned > autopilot_frd > autopilot (FLU), ned > imu_frd > imu (FLU), ned > best_frd > best",
        "units": "m, m/s, m/s2, rad, rad/s; error = autopilot minus IMU",
    }


def of_contents(one: Contents) -> tuple[list[Channel], dict[str, str]]:
    """The channels of a flight, and what is said about them."""
    series = (one.tables[series_name(key)] for key in one.flight.series)
    return _channels(one.flight, one.shown, one.assessment, series), _about(one.flight)


def _write(path: Path, one: Contents) -> list[Path]:
    write_channels(path, *of_contents(one))
    return [path]


FORMATS = (Format("mcap", "Foxglove", _write),)
