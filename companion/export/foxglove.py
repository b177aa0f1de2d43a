"""The JSON messages that Foxglove knows, and their schemas: https://docs.foxglove.dev/docs/visualization/message-schemas.

A schema is matched by its name; its text has the fields of a message. Times are {sec, nsec}, quaternions xyzw.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from companion.model import Array

Message = dict[str, Any]
Schema = dict[str, Any]

_NUMBER: Schema = {"type": "number"}
_COUNT: Schema = {"type": "integer", "minimum": 0}
_TEXT: Schema = {"type": "string"}


def _object(title: str = "", **properties: Schema) -> Schema:
    return {**({"title": title} if title else {}), "type": "object", "properties": properties}


_TIME = _object("time", sec=_COUNT, nsec=_COUNT)
_VECTOR = _object("foxglove.Vector3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_QUATERNION = _object("foxglove.Quaternion", x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_POSE = _object("foxglove.Pose", position=_VECTOR, orientation=_QUATERNION)


def _in_frame(title: str, **properties: Schema) -> Schema:
    return _object(title, timestamp=_TIME, frame_id=_TEXT, **properties)


POSE = _in_frame("foxglove.PoseInFrame", pose=_POSE)
TRANSFORM = _object(
    "foxglove.FrameTransform", timestamp=_TIME, parent_frame_id=_TEXT, child_frame_id=_TEXT, translation=_VECTOR,
    rotation=_QUATERNION,
)  # fmt: skip
LOCATION = _in_frame(
    "foxglove.LocationFix", latitude=_NUMBER, longitude=_NUMBER, altitude=_NUMBER,
    position_covariance={"type": "array", "items": _NUMBER, "minItems": 9, "maxItems": 9},
    position_covariance_type={**_COUNT, "maximum": 3},
)  # fmt: skip
LOG = _object(
    "foxglove.Log", timestamp=_TIME, level={**_COUNT, "maximum": 5}, message=_TEXT, name=_TEXT, file=_TEXT, line=_COUNT
)
IMU = _in_frame("companion.Imu", angular_velocity=_VECTOR, specific_force=_VECTOR)  # rad/s, m/s²
ERROR = _in_frame(
    "companion.ReckoningError", attitude_deg=_NUMBER, velocity_mps=_NUMBER, position_m=_NUMBER,
    attitude=_VECTOR, velocity=_VECTOR, position=_VECTOR,
)  # fmt: skip
"""Vectors: rad, m/s, m."""
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
SCENE = _object("foxglove.SceneUpdate", timestamp=_TIME, entities={"type": "array", "items": _ENTITY})

_NO_COVARIANCE = {"position_covariance": [0.0] * 9, "position_covariance_type": 0}
LEVELS = {"info": 2, "warning": 3, "error": 4}
_MAV_LEVELS = (5, 5, 5, 4, 3, 2, 2, 1)
"""MAV_SEVERITY 0 emergency ... 7 debug → foxglove.LogLevel."""


def series_schema(name: str, columns: Sequence[str]) -> Schema:
    """The schema of a table of numbers: one property a column, null where the vehicle does not know."""
    numbers: Mapping[str, Schema] = {column: {"type": ["number", "null"]} for column in columns}
    return _object(f"companion.{name}", timestamp=_TIME, **numbers)


def poses(frame_id: str, position: Array, q: Array) -> Iterator[Message]:
    """PoseInFrame without its time."""
    for p, r in zip(_vectors(position), _quaternions(q), strict=True):
        yield {"frame_id": frame_id, "pose": {"position": p, "orientation": r}}


def transforms(parent: str, child: str, position: Array, q: Array) -> Iterator[Message]:
    """FrameTransform without its time: where the child stands in the parent; q turns the child's vectors into it."""
    for p, r in zip(_vectors(position), _quaternions(q), strict=True):
        yield {"parent_frame_id": parent, "child_frame_id": child, "translation": p, "rotation": r}


def locations(frame_id: str, places: Array) -> Iterator[Message]:
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


def errors(attitude: Array, velocity: Array, position: Array) -> Iterator[Message]:
    """companion.ReckoningError without its time: each as a length and as a vector in NED."""
    lengths = (np.linalg.norm(error, axis=1) for error in (np.degrees(attitude), velocity, position))
    names = ("attitude_deg", "velocity_mps", "position_m", "attitude", "velocity", "position")
    vectors = (_vectors(error) for error in (attitude, velocity, position))
    for row in zip(*(length.tolist() for length in lengths), *vectors, strict=True):
        yield {"frame_id": "ned", **dict(zip(names, row, strict=True))}


def log(level: int, message: str, name: str) -> Message:
    """Log without its time."""
    return {"level": level, "message": message, "name": name, "file": "", "line": 0}


def level_of(severity: int) -> int:
    """foxglove.LogLevel of a MAV_SEVERITY; unknown for one that there is not."""
    return _MAV_LEVELS[severity] if 0 <= severity < len(_MAV_LEVELS) else 0


def _vectors(values: Array) -> Iterator[Message]:
    return ({"x": x, "y": y, "z": z} for x, y, z in values.tolist())


def _quaternions(q: Array) -> Iterator[Message]:
    return ({"x": x, "y": y, "z": z, "w": w} for w, x, y, z in q.tolist())
