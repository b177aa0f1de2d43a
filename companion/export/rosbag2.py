"""A flight as a ROS 2 bag: a folder with an MCAP file of CDR messages and its metadata. No ROS is needed.

Frames as in ROS (REP 103): `enu` is the world (x east, y north, z up), `imu`, `autopilot` and `best` are the body by
the IMU alone, the autopilot and the best estimate (FLU: x forward, y left, z up). Readings are in `imu`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import numpy.typing as npt

from companion.analysis import Assessment, Replay
from companion.estimation import ATTITUDE, POSITION, VELOCITY, BestEstimate
from companion.export import cdr
from companion.export.channels import Channel, clock_of, stamps_of, write_channels
from companion.export.table import Contents, Format, table_name
from companion.model import Array, Flight, GpsTrack, interpolated
from companion.strapdown import quaternion

NED_IN_ENU = np.array([0.0, np.sqrt(0.5), np.sqrt(0.5), 0.0])  # half a turn about north-east: swaps and flips
FLU_IN_FRD = np.array([0.0, 1.0, 0.0, 0.0])  # half a turn about forward

_FLU = np.array([1.0, -1.0, -1.0])
_NO_FIX, _FIX, _SBAS, _GBAS = -1, 0, 1, 2
_STATUS = np.array([_NO_FIX, _NO_FIX, _FIX, _FIX, _SBAS, _GBAS, _GBAS, _FIX, _GBAS], np.int8)
"""GPS_FIX_TYPE 0 no GPS, 1 no fix, 2 2D, 3 3D, 4 DGPS, 5 RTK float, 6 RTK fixed, 7 static, 8 PPP → NavSatStatus."""


def write_rosbag2(folder: Path, flight: Flight, shown: Replay, assessed: Assessment) -> list[Path]:
    """The bag's two files. Raises InputError when mcap is not installed."""
    bag, metadata = folder / "flight_0.mcap", folder / "metadata.yaml"
    channels = [*_readings(flight), *(_trajectories(flight, shown, assessed) if shown.has_position else ())]
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
    for name, track in flight.imus.items():
        topic, stamps = f"/imu/{table_name(name)}", stamps_of(flight, track.t)
        yield cdr.imu(topic, stamps, "imu", track.gyro * _FLU, track.accel * _FLU)
    for compass in flight.compasses:
        topic, stamps = f"/magnetic_field/{table_name(compass.source)}", stamps_of(flight, compass.t)
        yield cdr.magnetic_field(topic, stamps, "imu", compass.field * _FLU)
    for gps in flight.gps:
        yield _fixes(flight, gps)


def _fixes(flight: Flight, gps: GpsTrack) -> Channel:
    place = np.column_stack([np.degrees(gps.latitude), np.degrees(gps.longitude), gps.height])
    sigma = np.column_stack([gps.horizontal_sigma / np.sqrt(2.0)] * 2 + [gps.vertical_sigma])
    kind = np.nan_to_num(gps.fix_type).clip(0, len(_STATUS) - 1).astype(np.intp)
    status = np.where(np.isfinite(gps.latitude), _STATUS[kind], np.int8(_NO_FIX)).astype(np.int8)
    return cdr.nav_sat_fix(f"/gps/{table_name(gps.source)}", stamps_of(flight, gps.t), "imu", place, sigma, status)


def _trajectories(flight: Flight, shown: Replay, assessed: Assessment) -> Iterator[Channel]:
    t, track, attitude = shown.t, assessed.comparison.track, flight.require_attitude()
    unknown = np.zeros((len(t), 36))

    def body(
        name: str, q: Array, velocity: Array, position: Array, rates: Array, known: npt.NDArray[np.bool_]
    ) -> Channel:
        pose, twist = _pose(q, position), _twist(q, velocity, rates)
        whole = np.hstack([pose, unknown]), np.hstack([twist, unknown])
        stamps = stamps_of(flight, t[known])
        return cdr.odometry(f"/{name}/odometry", stamps, ("enu", name), *(part[known] for part in whole))

    gyro, rates = interpolated(t, track.t, track.gyro), interpolated(t, attitude.t, attitude.rates)
    yield body("imu", shown.q_imu, shown.velocity_imu, shown.position_imu, gyro, np.ones(len(t), bool))
    yield body("autopilot", shown.q_ref, shown.velocity_ref, shown.position_ref, rates, shown.reference_valid)
    if (best := assessed.best) is not None and "gps_position" in best.residuals:
        yield _best(flight, best)


def _best(flight: Flight, best: BestEstimate) -> Channel:
    """At its keyframes, with its covariance: there it is exact."""
    q, turn = best.q_ned_frd, quaternion.to_matrix(NED_IN_ENU)
    rates = interpolated(best.t, best.imu.t, best.imu.gyro) - best.states.gyro_bias
    pose = np.r_[POSITION, ATTITUDE]
    both = np.kron(np.eye(2), turn)
    of_pose = both @ best.covariance[:, pose[:, None], pose] @ both.T
    to_body = np.swapaxes(quaternion.to_matrix(q), -1, -2) * _FLU[:, None]
    of_twist = np.zeros_like(of_pose)
    of_twist[:, :3, :3] = to_body @ best.covariance[:, VELOCITY, VELOCITY] @ np.swapaxes(to_body, -1, -2)
    of_twist[:, np.arange(3, 6), np.arange(3, 6)] = best.gyro_bias_sigma**2
    flat = (len(best.t), 36)
    return cdr.odometry(
        "/best/odometry",
        stamps_of(flight, best.t),
        ("enu", "best"),
        np.hstack([_pose(q, best.position), of_pose.reshape(flat)]),
        np.hstack([_twist(q, best.velocity, rates), of_twist.reshape(flat)]),
    )


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
    stamps = [int(end) for channel in channels for end in channel.stamps[[0, -1]] if len(channel.stamps)] or [0]
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


def _write(folder: Path, one: Contents) -> list[Path]:
    return write_rosbag2(folder, one.flight, one.shown, one.assessment)


FORMATS = (Format("rosbag2", "a ROS 2 bag", _write, is_folder=True),)
