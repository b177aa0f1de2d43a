"""A flight as a ROS 2 bag: a folder with an MCAP file of CDR messages and its metadata. No ROS is needed.

Frames as in ROS (REP 103): `enu` is the world (x east, y north, z up), `imu`, `autopilot` and `best` are the body by
the IMU alone, the autopilot and the best estimate (FLU: x forward, y left, z up). Readings are in `imu`.

CDR (OMG DDS-XTypes 1.3, 7.4.3, version 1), little-endian: a number stands at a multiple of its size, counted from after
the four bytes of the encapsulation; a string is its length with the zero, its bytes and the zero. So every field of a
topic's messages has the same place. Definitions: ROS 2's common_interfaces.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import numpy.typing as npt

from companion.comparison import Replay
from companion.estimation import ATTITUDE, POSITION, VELOCITY, BestEstimate
from companion.export.mcap import FLU_IN_FRD, NED_IN_ENU, Channel, Schema, Stamps, clock_of, stamps_of, write_channels
from companion.export.paths import offset
from companion.export.table import Contents, Format, table_name
from companion.model import Array, Flight, GpsTrack, interpolated
from companion.strapdown import quaternion
from companion.verdict import Assessment

_XYZ = "float64 x\nfloat64 y\nfloat64 z"
_PARTS = {
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
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


_STAMPED = 12  # bytes of the encapsulation and the stamp


def _string(text: str) -> bytes:
    raw = text.encode() + b"\0"
    return struct.pack("<I", len(raw)) + raw


_FRAME = _string("imu")  # of all readings


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


_FLU = np.array([1.0, -1.0, -1.0])
_NO_FIX, _FIX, _SBAS, _GBAS = -1, 0, 1, 2
_STATUS = np.array([_NO_FIX, _NO_FIX, _FIX, _FIX, _SBAS, _GBAS, _GBAS, _FIX, _GBAS], np.int8)
"""GPS_FIX_TYPE 0 no GPS, 1 no fix, 2 2D, 3 3D, 4 DGPS, 5 RTK float, 6 RTK fixed, 7 static, 8 PPP → NavSatStatus."""


def write_rosbag2(folder: Path, one: Contents) -> list[Path]:
    """The bag's two files. Raises InputError when mcap is not installed."""
    bag, metadata, flight = folder / "flight_0.mcap", folder / "metadata.yaml", one.flight
    channels = list(_readings(flight))
    if one.shown.has_position:
        channels += _trajectories(flight, one.shown, one.assessment)
    about = {
        **clock_of(flight),
        "frames": "world enu; bodies imu, autopilot, best: FLU; readings in imu",
        "altitude": "NavSatFix.altitude is above mean sea level, as the receiver gives it, not above the ellipsoid",
        "covariances": "best: of the estimate; NavSatFix: the receiver's; all others unknown (0)",
    }
    write_channels(bag, channels, about, profile="ros2")
    metadata.write_bytes(_metadata(bag.name, channels))
    return [bag, metadata]


def _readings(flight: Flight) -> Iterator[Channel]:
    """IMUs without an orientation, compasses, GPS: covariances that are not known are 0."""
    for name, track in flight.imus.items():
        stamps, unknown = stamps_of(flight, track.t), np.zeros((len(track), 9))
        no_orientation = np.tile([0.0, 0.0, 0.0, 1.0, -1.0, *[0.0] * 8], (len(track), 1))
        numbers = np.hstack([no_orientation, track.gyro * _FLU, unknown, track.accel * _FLU, unknown])
        yield _channel(f"/imu/{table_name(name)}", IMU, stamps, _FRAME, numbers)
    for compass in flight.compasses:
        topic, numbers = f"/magnetic_field/{table_name(compass.source)}", np.pad(compass.field * _FLU, ((0, 0), (0, 9)))
        yield _channel(topic, MAGNETIC_FIELD, stamps_of(flight, compass.t), _FRAME, numbers)
    for gps in flight.gps:
        yield _fixes(flight, gps)


def _fixes(flight: Flight, gps: GpsTrack) -> Channel:
    place = np.column_stack([np.degrees(gps.latitude), np.degrees(gps.longitude), gps.height])
    sigma = np.column_stack([gps.horizontal_sigma / np.sqrt(2.0)] * 2 + [gps.vertical_sigma])  # east, north, up
    known = np.asarray(np.isfinite(sigma).all(axis=1))
    covariance = np.zeros((len(place), 9))
    covariance[:, ::4] = np.where(known[:, None], sigma**2, 0.0)
    kind = np.nan_to_num(gps.fix_type).clip(0, len(_STATUS) - 1).astype(np.intp)
    status = np.where(np.isfinite(gps.latitude), _STATUS[kind], np.int8(_NO_FIX)).astype(np.int8)
    prefix = _FRAME + struct.pack("<b", 0)  # the status, which is put in below
    prefix += _padding(prefix, 2) + struct.pack("<H", 1)  # SERVICE_GPS
    stamps, diagonal_known = stamps_of(flight, gps.t), np.where(known, 2, 0).astype(np.uint8)
    block = _block(stamps, prefix, np.hstack([place, covariance]), diagonal_known[:, None])
    block[:, len(_FRAME) + _STAMPED] = status.view(np.uint8)
    return Channel(f"/gps/{table_name(gps.source)}", NAV_SAT_FIX, "cdr", stamps, _rows(block))


def _trajectories(flight: Flight, shown: Replay, assessed: Assessment) -> Iterator[Channel]:
    t, track, attitude = shown.t, assessed.comparison.track, flight.require_attitude()
    unknown = np.zeros((len(t), 36))

    def body(
        name: str, q: Array, velocity: Array, position: Array, rates: Array, known: npt.NDArray[np.bool_]
    ) -> Channel:
        whole = np.hstack([_pose(q, position), unknown, _twist(q, velocity, rates), unknown])
        return _odometry(name, stamps_of(flight, t[known]), whole[known])

    gyro, rates = interpolated(t, track.t, track.gyro), interpolated(t, attitude.t, attitude.rates)
    yield body("imu", shown.q_imu, shown.velocity_imu, shown.position_imu, gyro, np.ones(len(t), bool))
    yield body("autopilot", shown.q_ref, shown.velocity_ref, shown.position_ref, rates, shown.reference_valid)
    if (best := assessed.best) is not None and "gps_position" in best.residuals:
        yield _best(flight, best)


def _best(flight: Flight, best: BestEstimate) -> Channel:
    """At its keyframes, with its covariance: there it is exact."""
    q, turn = best.q_ned_frd, quaternion.to_matrix(NED_IN_ENU)
    rates = interpolated(best.t, best.imu.t, best.imu.gyro) - best.states.gyro_bias
    of_both = np.r_[POSITION, ATTITUDE]
    both = np.kron(np.eye(2), turn)
    of_pose = both @ best.covariance[:, of_both[:, None], of_both] @ both.T
    to_body = np.swapaxes(quaternion.to_matrix(q), -1, -2) * _FLU[:, None]
    of_twist = np.zeros_like(of_pose)
    of_twist[:, :3, :3] = to_body @ best.covariance[:, VELOCITY, VELOCITY] @ np.swapaxes(to_body, -1, -2)
    of_twist[:, np.arange(3, 6), np.arange(3, 6)] = best.gyro_bias_sigma**2
    flat = (len(best.t), 36)
    pose, twist = _pose(q, best.position + offset(flight, best)), _twist(q, best.velocity, rates)
    numbers = np.hstack([pose, of_pose.reshape(flat), twist, of_twist.reshape(flat)])
    return _odometry("best", stamps_of(flight, best.t), numbers)


def _odometry(body: str, stamps: Stamps, numbers: Array) -> Channel:
    """numbers: (N, 85) pose and its covariance (6, 6) in enu, twist and its covariance in the body."""
    world = _string("enu")
    return _channel(f"/{body}/odometry", ODOMETRY, stamps, world + _padding(world, 4) + _string(body), numbers)


def _pose(q_ned_frd: Array, position: Array) -> Array:
    """(N, 7) position in ENU, and the quaternion xyzw from FLU to ENU."""
    q = quaternion.multiply(quaternion.multiply(NED_IN_ENU, q_ned_frd), FLU_IN_FRD)
    return np.hstack([quaternion.rotate(NED_IN_ENU, position), np.roll(q, -1, axis=1)])


def _twist(q_ned_frd: Array, velocity: Array, rates: Array) -> Array:
    """(N, 6) velocity and rates in FLU; velocity: (N, 3) NED, rates: (N, 3) FRD."""
    return np.hstack([quaternion.rotate(quaternion.conjugate(q_ned_frd), velocity) * _FLU, rates * _FLU])


def _metadata(bag: str, channels: list[Channel]) -> bytes:
    """metadata.yaml, version 5, as ROS 2 reads it since Galactic. JSON, which is YAML."""
    counts = Counter[tuple[str, str]]()
    for channel in channels:
        counts[channel.topic, channel.schema.name] += len(channel.stamps)
    stamps = [int(end) for channel in channels if len(channel.stamps) for end in channel.stamps[[0, -1]]] or [0]
    span = {
        "duration": {"nanoseconds": max(stamps) - min(stamps)},
        "starting_time": {"nanoseconds_since_epoch": min(stamps)},
        "message_count": counts.total(),
    }
    topics = [
        {
            "topic_metadata": {"name": name, "type": kind, "serialization_format": "cdr", "offered_qos_profiles": ""},
            "message_count": count,
        }
        for (name, kind), count in counts.items()
    ]
    information = {
        "version": 5,
        "storage_identifier": "mcap",
        **span,
        "topics_with_message_count": topics,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [bag],
        "files": [{"path": bag, **span}],
    }
    text = msgspec.json.format(msgspec.json.encode({"rosbag2_bagfile_information": information}), indent=2)
    return text + b"\n"


FORMATS = (Format("rosbag2", "a ROS 2 bag", write_rosbag2, is_folder=True),)
