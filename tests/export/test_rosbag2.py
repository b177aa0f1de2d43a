"""A ROS 2 bag as others read it: mcap-ros2-support by the schemas in it, rosbags by ROS's own definitions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

import companion as c
from companion.cli import main
from companion.estimation import ATTITUDE, POSITION, VELOCITY
from companion.strapdown import quaternion
from tests.recordings import BUNDLED

pytestmark = pytest.mark.slow

DEMO = BUNDLED / "copter-demo-100hz.tlog"


@pytest.fixture(scope="module")
def flight() -> c.Flight:
    return c.open_log(DEMO)[0]


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bag") / "bag"
    assert main(["export", str(DEMO), "--format", "rosbag2", "-o", str(folder)]) == 0
    return folder


Topics = Callable[..., list[Any]]


@pytest.fixture(scope="module")
def decoded(bag: Path) -> Topics:
    """Messages of a topic, every so many of them, decoded by the schemas in the file."""
    with (bag / "flight_0.mcap").open("rb") as file:
        kept: dict[str, list[tuple[Any, Any]]] = {}
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            kept.setdefault(channel.topic, []).append((schema, message))

    def of(topic: str, every: int) -> list[Any]:
        schema, _ = kept[topic][0]
        decode = DecoderFactory().decoder_for("cdr", schema)
        assert decode is not None
        several = []
        for _, message in kept[topic][::every]:
            one = decode(message.data)
            assert one.header.stamp.sec * 10**9 + one.header.stamp.nanosec == message.log_time
            several.append(one)
        return several

    return of


def xyz(vector: Any) -> list[float]:
    return [vector.x, vector.y, vector.z]


def test_ros_reads_the_folder_with_definitions_of_its_own(bag: Path, decoded: Topics) -> None:
    """What rosbags decodes by ROS's own definitions is, field by field, what the schemas in the file say."""
    with AnyReader([bag]) as reader:
        counts = {connection.topic: connection.msgcount for connection in reader.connections}
        seen = Counter[str]()
        for connection, _, raw in reader.messages():
            if seen[connection.topic] == 0:
                same(reader.deserialize(raw, connection.msgtype), decoded(connection.topic, 10**9)[0])
            seen[connection.topic] += 1
    assert counts == seen
    about = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert about["message_count"] == sum(counts.values())
    assert about["relative_file_paths"] == ["flight_0.mcap"]


def same(a: Any, b: Any) -> None:
    for name in (name for name in getattr(b, "__slots__", ()) if not name.startswith("_")):
        left, right = getattr(a, name), getattr(b, name)
        if isinstance(right, str):
            assert left == right, name
        elif isinstance(right, int | float | list | tuple):
            np.testing.assert_array_equal(left, right)
        else:
            same(left, right)


def test_readings_are_those_of_the_flight_in_axes_of_ros(flight: c.Flight, decoded: Topics) -> None:
    track, several = flight.imu("RAW_IMU"), decoded("/imu/raw_imu", 20)
    flu = np.array([1.0, -1.0, -1.0])
    np.testing.assert_array_equal([xyz(m.angular_velocity) for m in several], track.gyro[::20] * flu)
    accel = np.array([xyz(m.linear_acceleration) for m in several])
    np.testing.assert_array_equal(accel, track.accel[::20] * flu)
    assert accel[:5, 2].mean() == pytest.approx(9.8, abs=0.1), "z is up: at rest it reads +g"
    assert {m.header.frame_id for m in several} == {"imu"}
    assert all(m.orientation_covariance[0] == -1 for m in several), "an IMU has no orientation"
    compass = flight.compasses[0]
    fields = [xyz(m.magnetic_field) for m in decoded(f"/magnetic_field/{compass.source.lower()}", 20)]
    np.testing.assert_array_equal(fields, compass.field[::20] * flu)


def test_fixes_are_the_receivers(flight: c.Flight, decoded: Topics) -> None:
    (gps,) = flight.gps
    several = decoded("/gps/gps_raw_int", 1)
    place = np.array([[m.latitude, m.longitude, m.altitude] for m in several])
    np.testing.assert_allclose(place[:, 0], np.degrees(gps.latitude), atol=1e-12)
    np.testing.assert_array_equal(place[:, 2], gps.height)
    statuses = {(int(kind), m.status.status, m.status.service) for kind, m in zip(gps.fix_type, several, strict=True)}
    assert statuses <= {(3, 0, 1), (4, 1, 1), (6, 2, 1)}
    known = np.isfinite(gps.vertical_sigma) & np.isfinite(gps.horizontal_sigma)
    for k, m in zip(known, several, strict=True):
        assert (m.position_covariance_type == 2) == k
    i = int(np.flatnonzero(known)[0]) if known.any() else 0
    horizontal = several[i].position_covariance[0] + several[i].position_covariance[4]
    assert horizontal == pytest.approx(np.nan_to_num(gps.horizontal_sigma[i] * known[i]) ** 2)


def test_trajectories_are_in_enu_and_their_twist_in_the_body(flight: c.Flight, decoded: Topics) -> None:
    """Velocity turned back by the orientation is how the position moves; the heading counts from east."""
    several, shown = decoded("/imu/odometry", 20), c.replay(flight)
    q_imu = shown.q_imu[::20]
    pose = [m.pose.pose for m in several]
    position = np.array([xyz(p.position) for p in pose])
    np.testing.assert_allclose(position, shown.position_imu[::20, [1, 0, 2]] * [1, 1, -1], atol=1e-9)
    q = np.array([[p.orientation.w, *xyz(p.orientation)] for p in pose])
    twist = np.array([xyz(m.twist.twist.linear) for m in several])
    velocity = shown.velocity_imu[::20, [1, 0, 2]] * [1, 1, -1]
    np.testing.assert_allclose(quaternion.rotate(q, twist), velocity, atol=1e-9)
    forward = quaternion.rotate(q, np.array([1.0, 0.0, 0.0]))
    yaw = quaternion.to_euler(q_imu)[:, 2]
    level = np.abs(quaternion.to_euler(q_imu)[:, 1]) < 0.1
    heading = np.arctan2(forward[:, 1], forward[:, 0])[level]
    apart = np.angle(np.exp(1j * (heading - (np.pi / 2 - yaw[level]))))
    assert np.abs(apart).max() < 1e-9
    assert {(m.header.frame_id, m.child_frame_id) for m in several} == {("enu", "imu")}


def test_the_best_estimate_has_its_covariance(decoded: Topics) -> None:
    best = c.examine(c.open_log(DEMO)[0]).assessment.best
    assert best is not None
    several = decoded("/best/odometry", 1)
    diagonal = np.sqrt([m.pose.covariance[::7] for m in several])
    np.testing.assert_allclose(diagonal[:, :3], best.sigma(POSITION)[:, [1, 0, 2]], rtol=1e-6)
    np.testing.assert_allclose(diagonal[:, 3:], best.sigma(ATTITUDE)[:, [1, 0, 2]], rtol=1e-6)
    total = np.sum([m.twist.covariance[:15:7] for m in several], axis=1)
    np.testing.assert_allclose(total, (best.sigma(VELOCITY) ** 2).sum(axis=1), rtol=1e-6)
    for m in several[:: len(several) // 5]:
        covariance = np.reshape(m.pose.covariance, (6, 6))
        np.testing.assert_allclose(covariance, covariance.T, atol=1e-12)
        assert np.linalg.eigvalsh(covariance).min() > 0
