"""The ROS 2 messages of a flight as CDR, little-endian: every field of a topic's messages has the same place.

CDR (OMG DDS-XTypes 1.3, 7.4.3, version 1): a number stands at a multiple of its size, counted from after the four bytes
of the encapsulation; a string is its length with the zero, its bytes and the zero. Definitions: ROS 2's
common_interfaces.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from companion.export.channels import Channel, Schema, Stamps
from companion.model import Array

_TIME = "int32 sec\nuint32 nanosec"
_HEADER = "builtin_interfaces/Time stamp\nstring frame_id"
_XYZ = "float64 x\nfloat64 y\nfloat64 z"
_PARTS = {
    "std_msgs/Header": _HEADER,
    "builtin_interfaces/Time": _TIME,
    "geometry_msgs/Vector3": _XYZ,
    "geometry_msgs/Point": _XYZ,
    "geometry_msgs/Quaternion": f"{_XYZ}\nfloat64 w",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance",
    "sensor_msgs/NavSatStatus": "int8 status\nuint16 service",
}


def _schema(name: str, fields: str) -> Schema:
    """With the definitions that it needs, as `ros2 bag record` writes them."""
    text, included = f"std_msgs/Header header\n{fields}", list[str]()
    waiting = [text]
    while waiting:
        own = [line.split()[0] for line in waiting.pop().splitlines()]
        new = [part for part in dict.fromkeys(own) if part in _PARTS and part not in included]
        included += new
        waiting += [_PARTS[part] for part in new]
    parts = [f"MSG: {part}\n{_PARTS[part]}" for part in included]
    return Schema(name, "ros2msg", f"\n{'=' * 80}\n".join([text, *parts]).encode() + b"\n")


IMU = _schema(
    "sensor_msgs/msg/Imu",
    "geometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
    "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
    "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance",
)
MAGNETIC_FIELD = _schema(
    "sensor_msgs/msg/MagneticField", "geometry_msgs/Vector3 magnetic_field\nfloat64[9] magnetic_field_covariance"
)
NAV_SAT_FIX = _schema(
    "sensor_msgs/msg/NavSatFix",
    "sensor_msgs/NavSatStatus status\nfloat64 latitude\nfloat64 longitude\nfloat64 altitude\n"
    "float64[9] position_covariance\nuint8 position_covariance_type",
)
ODOMETRY = _schema(
    "nav_msgs/msg/Odometry",
    "string child_frame_id\ngeometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist",
)


def imu(topic: str, stamps: Stamps, frame: str, gyro: Array, accel: Array) -> Channel:
    """gyro, accel: (N, 3) rad/s, m/s² in the frame. Without an orientation, and with covariances that are not known."""
    no_orientation = np.tile([0.0, 0.0, 0.0, 1.0, -1.0, *[0.0] * 8], (len(stamps), 1))
    unknown = np.zeros((len(stamps), 9))
    return _channel(topic, IMU, stamps, _string(frame), np.hstack([no_orientation, gyro, unknown, accel, unknown]))


def magnetic_field(topic: str, stamps: Stamps, frame: str, field: Array) -> Channel:
    """field: (N, 3) T in the frame."""
    return _channel(topic, MAGNETIC_FIELD, stamps, _string(frame), np.hstack([field, np.zeros((len(field), 9))]))


def nav_sat_fix(
    topic: str, stamps: Stamps, frame: str, place: Array, sigma: Array, status: npt.NDArray[np.int8]
) -> Channel:
    """place: (N, 3) latitude °, longitude °, height m; sigma: (N, 3) m east, north, up, NaN: unknown; status: (N,)."""
    known = np.asarray(np.isfinite(sigma).all(axis=1))
    covariance = np.zeros((len(place), 9))
    covariance[:, ::4] = np.where(known[:, None], sigma**2, 0.0)
    status_at = len(_string(frame)) + _STAMPED
    prefix = _string(frame) + struct.pack("<b", 0)
    prefix += _padding(prefix, 2) + struct.pack("<H", 1)  # SERVICE_GPS
    diagonal_known = np.where(known, 2, 0).astype(np.uint8)
    block = _block(stamps, prefix, np.hstack([place, covariance]), diagonal_known[:, None])
    block[:, status_at] = status.view(np.uint8)
    return Channel(topic, NAV_SAT_FIX, "cdr", stamps, _rows(block))


def odometry(topic: str, stamps: Stamps, frames: tuple[str, str], pose: Array, twist: Array) -> Channel:
    """frames: of the pose, and of the child, which the twist is in.

    pose: (N, 43) position m, quaternion xyzw, covariance (6, 6); twist: (N, 42) velocity m/s, rates rad/s, covariance.
    """
    parent, child = map(_string, frames)
    names = parent + _padding(parent, 4) + child
    return _channel(topic, ODOMETRY, stamps, names, np.hstack([pose, twist]))


_STAMPED = 12  # bytes of the encapsulation and the stamp


def _string(text: str) -> bytes:
    raw = text.encode() + b"\0"
    return struct.pack("<I", len(raw)) + raw


def _padding(after: bytes, size: int) -> bytes:
    """Zeros up to a multiple of size: what stands before has begun after the stamp, which is 8 bytes."""
    return bytes(-len(after) % size)


def _channel(topic: str, schema: Schema, stamps: Stamps, names: bytes, numbers: Array) -> Channel:
    return Channel(topic, schema, "cdr", stamps, _rows(_block(stamps, names, numbers)))


def _block(
    stamps: Stamps, names: bytes, numbers: Array, end: npt.NDArray[np.uint8] | None = None
) -> npt.NDArray[np.uint8]:
    """(N, bytes of a message): stamp, what is the same in all, float64 numbers (N, k), and some last bytes (N, e)."""
    seconds, ns = np.divmod(stamps, 1_000_000_000)
    times = np.stack([seconds, ns], axis=1).astype("<u4").view(np.uint8)
    same = np.frombuffer(names + _padding(names, 8), np.uint8)
    rows = len(stamps)
    return np.hstack([
        np.tile(np.array([0, 1, 0, 0], np.uint8), (rows, 1)),  # CDR, little-endian
        times,
        np.tile(same, (rows, 1)),
        np.ascontiguousarray(numbers, "<f8").view(np.uint8).reshape(rows, -1),
        *([end] if end is not None else []),
    ])  # fmt: skip


def _rows(block: npt.NDArray[np.uint8]) -> Iterator[bytes]:
    return (row.tobytes() for row in block)
