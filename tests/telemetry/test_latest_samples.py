"""The newest samples of a flight on a link are those that the whole of it has, or nothing is said of them."""

from __future__ import annotations

import numpy as np
import pytest

from companion.simulate import Faults, SimulatedVehicle, fly
from companion.telemetry import Stream
from tests.simulated import bursts

STREAMS = {"RAW_IMU": 100.0, "ATTITUDE": 50.0, "LOCAL_POSITION_NED": 20.0}


def heard(until: float, streams: dict[str, float] = STREAMS, **changes: object) -> tuple[Stream, SimulatedVehicle]:
    vehicle = SimulatedVehicle(fly(12.0), streams=streams, send_parameters=True, **changes)  # type: ignore[arg-type]
    stream = Stream()
    hear(stream, vehicle, until)
    return stream, vehicle


def hear(stream: Stream, vehicle: SimulatedVehicle, until: float) -> None:
    for t, data in bursts(vehicle, until):
        stream.push(data, 1e9 + t)


def test_they_are_those_of_the_whole_flight() -> None:
    stream, vehicle = heard(8.0)
    (flight,) = stream.recent(5.0)
    begun = stream.newest
    hear(stream, vehicle, 8.7)
    newest = stream.extend(flight, "RAW_IMU", begun - 0.6)
    (now,) = stream.recent(5.0)
    assert newest is not None
    assert newest.position is not None
    assert now.attitude is not None
    assert now.position is not None
    for found, whole in ((newest.imu, now.imu()), (newest.attitude, now.attitude), (newest.position, now.position)):
        assert found.t[-1] == whole.t[-1] > 8.6
        np.testing.assert_array_equal(found.t, whole.t[-len(found.t) :])
    count = len(newest.imu)
    np.testing.assert_array_equal(newest.imu.gyro, now.imu().gyro[-count:])
    np.testing.assert_array_equal(newest.imu.accel, now.imu().accel[-count:])
    assert newest.imu.low_pass_hz == now.imu().low_pass_hz
    q = newest.attitude.q_ned_frd
    np.testing.assert_allclose(np.abs(np.einsum("ij,ij->i", q, now.attitude.q_ned_frd[-len(q) :])), 1.0)


def test_after_a_reboot_the_whole_has_to_be_looked_at() -> None:
    stream, vehicle = heard(8.0)
    (flight,) = stream.recent(5.0)
    begun = stream.newest
    vehicle.reboot()
    hear(stream, vehicle, 8.7)
    assert stream.extend(flight, "RAW_IMU", begun - 0.6) is None


def test_a_position_on_the_globe_is_seen_from_its_beginning_alone() -> None:
    stream, _ = heard(8.0, {"RAW_IMU": 100.0, "ATTITUDE": 50.0, "GLOBAL_POSITION_INT": 10.0})
    (flight,) = stream.recent(5.0)
    assert flight.position is not None
    assert stream.extend(flight, "RAW_IMU", stream.newest - 1.0) is None


@pytest.mark.parametrize("silent", ["RAW_IMU", "ATTITUDE"])
def test_a_message_that_says_nothing_ends_it(silent: str) -> None:
    stream, _ = heard(8.0)
    (flight,) = stream.recent(5.0)
    since = stream.newest - 1.0
    other, _ = heard(8.0, {name: rate for name, rate in STREAMS.items() if name != silent}, faults=Faults())
    assert other.extend(flight, "RAW_IMU", since) is None
