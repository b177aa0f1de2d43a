"""A flight as an MCAP file for Foxglove: poses, places on the map, IMU readings, errors, texts, findings.

Frames: `enu` (x east, y north, z up) is the root, so that what is shown in it stands the right way up; `ned` hangs in
it; `autopilot_frd`, `imu_frd` and `best_frd` (x forward, y right, z down) move in `ned`; `autopilot`, `imu` and `best`
are the same bodies with Foxglove's and ROS's axes (FLU: x forward, y left, z up), for models and cameras.

Messages are JSON as Foxglove knows them, each with a schema that is matched by its name; times are {sec, nsec},
quaternions xyzw: https://docs.foxglove.dev/docs/visualization/message-schemas. The layout that shows the file in
Foxglove is imported with *Import from file*. The channels are those of any MCAP file, whatever its messages are encoded
as: a ROS 2 bag has them too.
"""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from companion.comparison import Replay
from companion.estimation import BestEstimate
from companion.export.paths import COLOURS, geodetic, offset, paths
from companion.export.table import Contents, Format, Table, series_name
from companion.installation import missing
from companion.model import Array, Flight, words
from companion.verdict import Assessment

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


Message = dict[str, Any]
JsonSchema = dict[str, Any]

_NUMBER: JsonSchema = {"type": "number"}
_COUNT: JsonSchema = {"type": "integer", "minimum": 0}
_TEXT: JsonSchema = {"type": "string"}


def _object(title: str = "", **properties: JsonSchema) -> JsonSchema:
    return {**({"title": title} if title else {}), "type": "object", "properties": properties}


_TIME = _object("time", sec=_COUNT, nsec=_COUNT)
_VECTOR = _object("foxglove.Vector3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_QUATERNION = _object("foxglove.Quaternion", x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_POSE = _object("foxglove.Pose", position=_VECTOR, orientation=_QUATERNION)


def _in_frame(title: str, **properties: JsonSchema) -> JsonSchema:
    return _object(title, timestamp=_TIME, frame_id=_TEXT, **properties)


POSE = _in_frame("foxglove.PoseInFrame", pose=_POSE)
_TRANSFORM = _object(
    "foxglove.FrameTransform", timestamp=_TIME, parent_frame_id=_TEXT, child_frame_id=_TEXT, translation=_VECTOR,
    rotation=_QUATERNION,
)  # fmt: skip
_LOCATION = _in_frame(
    "foxglove.LocationFix", latitude=_NUMBER, longitude=_NUMBER, altitude=_NUMBER,
    position_covariance={"type": "array", "items": _NUMBER, "minItems": 9, "maxItems": 9},
    position_covariance_type={**_COUNT, "maximum": 3},
)  # fmt: skip
_LOG = _object(
    "foxglove.Log", timestamp=_TIME, level={**_COUNT, "maximum": 5}, message=_TEXT, name=_TEXT, file=_TEXT, line=_COUNT
)
IMU = _in_frame("companion.Imu", angular_velocity=_VECTOR, specific_force=_VECTOR)  # rad/s, m/s²
_LENGTHS = {
    "attitude": ("attitude_deg", np.degrees(1.0)), "velocity": ("velocity_mps", 1.0), "position": ("position_m", 1.0),
}  # fmt: skip
"""Error, a vector in rad, m/s, m → the name of its length, and the factor to its unit."""
_COLOUR = _object("foxglove.Color", r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER)
_LINE = _object(
    "foxglove.LinePrimitive", type={**_COUNT, "maximum": 2}, pose=_POSE, thickness=_NUMBER,
    scale_invariant={"type": "boolean"}, points={"type": "array", "items": _VECTOR}, color=_COLOUR,
    colors={"type": "array", "items": _COLOUR}, indices={"type": "array", "items": {"type": "integer"}},
)  # fmt: skip
_ENTITY = _in_frame(
    "foxglove.SceneEntity", id=_TEXT, lifetime=_TIME, frame_locked={"type": "boolean"},
    lines={"type": "array", "items": _LINE},
)  # fmt: skip
_SCENE = _object("foxglove.SceneUpdate", timestamp=_TIME, entities={"type": "array", "items": _ENTITY})

_NO_COVARIANCE = {"position_covariance": [0.0] * 9, "position_covariance_type": 0}
_LEVELS = {"info": 2, "warning": 3, "error": 4}
_MAV_LEVELS = (5, 5, 5, 4, 3, 2, 2, 1)
"""MAV_SEVERITY 0 emergency ... 7 debug → foxglove.LogLevel."""


def poses(frame_id: str, position: Array, q: Array) -> Iterator[Message]:
    """PoseInFrame without its time."""
    for p, r in zip(_vectors(position), _quaternions(q), strict=True):
        yield {"frame_id": frame_id, "pose": {"position": p, "orientation": r}}


def transforms(parent: str, child: str, position: Array, q: Array) -> Iterator[Message]:
    """FrameTransform without its time: where the child stands in the parent; q turns the child's vectors into it."""
    for p, r in zip(_vectors(position), _quaternions(q), strict=True):
        yield {"parent_frame_id": parent, "child_frame_id": child, "translation": p, "rotation": r}


def _locations(frame_id: str, places: Array) -> Iterator[Message]:
    """LocationFix without its time, of latitude °, longitude °, height m (N, 3)."""
    for latitude, longitude, altitude in places.tolist():
        yield {
            "frame_id": frame_id, "latitude": latitude, "longitude": longitude, "altitude": altitude, **_NO_COVARIANCE,
        }  # fmt: skip


def line(name: str, position: Array, colour: tuple[int, int, int]) -> Message:
    """SceneUpdate without its time: a path (N, 3) NED m as one line, 2 pixels wide, that stays."""
    at_once = {"sec": 0, "nsec": 0}
    here = {"position": {"x": 0.0, "y": 0.0, "z": 0.0}, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
    shade = dict(zip("rgb", (c / 255 for c in colour), strict=True)) | {"a": 1.0}
    strip = {
        "type": 0, "pose": here, "thickness": 2.0, "scale_invariant": True, "points": list(_vectors(position)),
        "color": shade, "colors": [], "indices": [],
    }  # fmt: skip
    entity = {
        "timestamp": at_once, "frame_id": "ned", "id": name, "lifetime": at_once, "frame_locked": False,
        "lines": [strip],
    }  # fmt: skip
    return {"entities": [entity]}


def readings(frame_id: str, gyro: Array, accel: Array) -> Iterator[Message]:
    """companion.Imu without its time."""
    for rate, force in zip(_vectors(gyro), _vectors(accel), strict=True):
        yield {"frame_id": frame_id, "angular_velocity": rate, "specific_force": force}


def errors(known: Mapping[str, Array]) -> tuple[JsonSchema, Iterator[Message]]:
    """companion.ReckoningError, and its messages without their time: each error as a length and as a vector in NED."""
    lengths = {_LENGTHS[name]: np.linalg.norm(error, axis=1) for name, error in known.items()}
    names = [*(name for name, _ in lengths), *known]
    sizes = ((factor * size).tolist() for (_, factor), size in lengths.items())
    rows = zip(*sizes, *map(_vectors, known.values()), strict=True)
    kinds = [_NUMBER] * len(lengths) + [_VECTOR] * len(known)
    schema = _in_frame("companion.ReckoningError", **dict(zip(names, kinds, strict=True)))
    return schema, ({"frame_id": "ned", **dict(zip(names, row, strict=True))} for row in rows)


def log(level: int, message: str, name: str) -> Message:
    """Log without its time."""
    return {"level": level, "message": message, "name": name, "file": "", "line": 0}


def _level_of(severity: int) -> int:
    """foxglove.LogLevel of a MAV_SEVERITY; unknown for one that there is not."""
    return _MAV_LEVELS[severity] if 0 <= severity < len(_MAV_LEVELS) else 0


def _vectors(values: Array) -> Iterator[Message]:
    return ({"x": x, "y": y, "z": z} for x, y, z in values.tolist())


def _quaternions(q: Array) -> Iterator[Message]:
    return ({"x": x, "y": y, "z": z, "w": w} for w, x, y, z in q.tolist())


_HERE = np.zeros((1, 3))
_STATIC_S = 1.0  # frames that do not move are repeated so often, for those who join in mid-file


def write_mcap(
    path: Path, flight: Flight, shown: Replay, assessed: Assessment, series: Iterable[Table] = ()
) -> list[Path]:
    """Every topic in order of time. Stamps are UNIX time where it is known, else the boot clock (see `about`).

    Raises InputError when mcap is not installed.
    """
    write_channels(path, _channels(flight, shown, assessed, series), _about(flight))
    return [path]


def _channels(flight: Flight, shown: Replay, assessed: Assessment, series: Iterable[Table]) -> list[Channel]:
    return [*_flown(flight, shown, assessed), *(_series(flight, table) for table in series)]


def _flown(flight: Flight, shown: Replay, assessed: Assessment) -> Iterator[Channel]:
    topic = partial(_channel, flight)
    t, best, known = shown.t, assessed.best, shown.reference_valid  # in a gap the autopilot says nothing
    beats = t[0] + _STATIC_S * np.unique(np.floor((t - t[0]) / _STATIC_S))  # none in gaps, which may be of any length
    bodies = [
        ("autopilot", t[known], shown.position_ref[known], shown.q_ref[known]),
        ("imu", t, shown.position_imu, shown.q_imu),
        *([("best", best.t, _place(flight, best), best.q_ned_frd)] if best else []),
    ]
    for parent, child, q in (("enu", "ned", NED_IN_ENU), *((f"{name}_frd", name, FLU_IN_FRD) for name, *_ in bodies)):
        (still,) = transforms(parent, child, _HERE, q[None])
        yield topic("/tf", _TRANSFORM, beats, [still] * len(beats))
    drawn = paths(shown, best)
    if best and "best" in drawn:
        drawn["best"] = drawn["best"] + offset(flight, best)
    for name, times, position, q in bodies:
        yield topic("/tf", _TRANSFORM, times, transforms("ned", f"{name}_frd", position, q))
        yield topic(f"/{name}/pose", POSE, times, poses("ned", position, q))
        own = best if name == "best" else None
        if name in drawn and (where := geodetic(flight, own.position if own else position, own)) is not None:
            yield topic(f"/{name}/location", _LOCATION, times, _locations(name, where))
    for name, path in drawn.items():
        yield topic("/paths", _SCENE, t[:1], [line(name, path, COLOURS[name])])
    schema, messages = errors({name: error[known] for name, error in _errors(shown)})
    yield topic("/error", schema, t[known], messages)
    for name, track in flight.imus.items():
        yield topic(f"/imu/{name}", IMU, track.t, readings("imu_frd", track.gyro, track.accel))
    texts = sorted(flight.texts, key=lambda text: text.t)
    rows = [log(_level_of(text.severity), text.text, str(flight.vehicle)) for text in texts]
    yield topic("/statustext", _LOG, np.array([text.t for text in texts]), rows)
    findings = sorted(assessed.verdict.findings, key=lambda finding: finding.start_s)
    rows = [log(_LEVELS[f.severity], f"{words(f.kind)}: {f.evidence}", f.side) for f in findings]
    yield topic("/findings", _LOG, np.array([finding.start_s for finding in findings]), rows)


def _place(flight: Flight, best: BestEstimate) -> Array:
    """Its positions in `ned`; zeros where no GPS holds them, as those of a flight without position."""
    has_place = "gps_position" in best.residuals
    return best.position + offset(flight, best) if has_place else np.zeros_like(best.position)


def _errors(shown: Replay) -> Iterator[tuple[str, Array]]:
    """Those that there are: of a flight without position the attitude's alone."""
    yield "attitude", shown.attitude_error
    if shown.has_position:
        yield from (("velocity", shown.velocity_error), ("position", shown.position_error))


def _series(flight: Flight, table: Table) -> Channel:
    columns = [column for column in table if column.name not in ("t_s", "unix_s")]
    names = [column.name for column in columns]
    rows = zip(*(column.values.tolist() for column in columns), strict=True)
    number_or_unknown: JsonSchema = {"type": ["number", "null"]}
    schema = _object(f"companion.{table.name}", timestamp=_TIME, **dict.fromkeys(names, number_or_unknown))
    messages = (dict(zip(names, row, strict=True)) for row in rows)
    return _channel(flight, f"/{table.name}", schema, table["t_s"], messages)


def _channel(flight: Flight, topic: str, schema: JsonSchema, t: Array, messages: Iterable[Message]) -> Channel:
    """Messages without their `timestamp` at times t (N,) s of the boot clock, each as JSON with it."""
    encode = msgspec.json.Encoder().encode
    stamps = stamps_of(flight, t)

    def stamped() -> Iterator[bytes]:
        for stamp, message in zip(stamps.tolist(), messages, strict=True):
            sec, nsec = divmod(stamp, 1_000_000_000)
            yield encode({"timestamp": {"sec": sec, "nsec": nsec}, **message})

    return Channel(topic, Schema(schema["title"], "jsonschema", encode(schema)), "json", stamps, stamped())


def _about(flight: Flight) -> dict[str, str]:
    return {
        **clock_of(flight),
        "frames": "enu > ned > autopilot_frd > autopilot (FLU), ned > imu_frd > imu (FLU), ned > best_frd > best",
        "units": "m, m/s, m/s2, rad, rad/s; error = autopilot minus IMU",
    }


def _parts(one: Contents) -> tuple[Flight, Replay, Assessment, Iterable[Table]]:
    return one.flight, one.shown, one.assessment, (one.tables[series_name(key)] for key in one.flight.series)


_CAMERA = {"perspective": True, "distance": 40, "phi": 60, "thetaOffset": 45, "fovy": 45, "near": 0.5, "far": 20000}
_GRID = {
    "layerId": "foxglove.Grid", "instanceId": "grid", "visible": True, "frameId": "enu", "size": 200, "divisions": 20,
}  # fmt: skip


def layout(topics: Collection[str]) -> dict[str, Any]:
    """The layout for a file with these topics."""
    panels: dict[str, dict[str, Any]] = {
        "3D!flight": {
            "cameraState": _CAMERA,
            "followMode": "follow-position",
            "followTf": "autopilot",
            "scene": {},
            "transforms": {},
            "topics": {"/paths": {"visible": True}},
            "layers": {"grid": _GRID},
        },
        "map!flight": {"followTopic": "/autopilot/location", "disabledTopics": [], "layer": "map", "zoomLevel": 16},
        "RosOut!findings": {"topicToRender": "/findings", "minLogLevel": 1, "searchTerms": []},
        "Plot!attitude": _plot("Attitude error, °", "/error.attitude_deg"),
        "Plot!position": _plot("Position error, m", "/error.position_m"),
        "RosOut!vehicle": {"topicToRender": "/statustext", "minLogLevel": 1, "searchTerms": []},
    }
    if "/autopilot/location" not in topics:
        del panels["map!flight"]
    if "/paths" not in topics:  # a flight without position has no error of it
        del panels["Plot!position"]
    first, *others = panels
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {"direction": "row", "first": first, "second": _column(others), "splitPercentage": 60},
    }


def _plot(title: str, value: str) -> dict[str, Any]:
    path = {"value": value, "enabled": True, "timestampMethod": "headerStamp"}
    return {
        "title": title, "paths": [path], "xAxisVal": "timestamp", "isSynced": True, "showLegend": False,
        "showXAxisLabels": True, "showYAxisLabels": True,
    }  # fmt: skip


def _column(names: list[str]) -> str | dict[str, Any]:
    """Panels of one height, one under the other."""
    first, *others = names
    if not others:
        return first
    share = 100 / len(names)
    return {"direction": "column", "first": first, "second": _column(others), "splitPercentage": share}


def _write_with_layout(folder: Path, one: Contents) -> list[Path]:
    channels = _channels(*_parts(one))
    flight, arrangement = folder / "flight.mcap", folder / "layout.json"
    write_channels(flight, channels, _about(one.flight))
    text = msgspec.json.encode(layout({channel.topic for channel in channels}))
    arrangement.write_bytes(msgspec.json.format(text, indent=2))
    return [flight, arrangement]


FORMATS = (
    Format("foxglove", "the same with a layout", _write_with_layout, is_folder=True),
    Format("mcap", "Foxglove", lambda path, c: write_mcap(path, *_parts(c))),
)
