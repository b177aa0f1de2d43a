"""The aiding sensors of a PX4 ULog equal what pyulog gives, in SI."""

from __future__ import annotations

import io
import lzma
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from pyulog import ULog

import companion as c
from companion.model import Array
from companion.strapdown import preintegrate, quaternion
from tests.recordings import SHARED, recording

pytestmark = pytest.mark.slow

CUT = Path(__file__).parent / "logs" / "px4_two_imus.ulg.xz"
"""Six seconds of px4_faults/q_two_imu: two IMUs, the second one selected."""

STEP = CUT.with_name("px4_accel_step.ulg.xz")
"""Three seconds of px4_faults/q_accel_step, with the step, and the topics that are compared here."""

DEFAULT = Path(__file__).parent.parent / "data" / "px4__px4_gcs_default.ulg.xz"

_OTHERS = (p for p in SHARED.rglob("*") if p.name.endswith((".ulg", ".ulg.xz")) and p.parent.name != "strangers")
LOGS = [CUT, STEP, DEFAULT, *sorted(_OTHERS)]  # strangers' have topics of other releases, and vibration without end

Topics = dict[str, dict[str, Any]]


@pytest.fixture(scope="module", params=LOGS, ids=lambda path: path.name)
def log(request: pytest.FixtureRequest) -> tuple[c.Flight, Topics]:
    path: Path = request.param
    (flight,) = c.open_log(path)
    contents = path.read_bytes()
    found = ULog(io.BytesIO(lzma.decompress(contents) if path.suffix == ".xz" else contents)).data_list
    topics = {f"{one.name}_{one.multi_id}" if one.multi_id else one.name: one.data for one in found}
    return flight, topics


def rows(t: Array, topic: dict[str, Any]) -> npt.NDArray[np.intp]:
    """The rows of a topic at times t, by either of its stamps."""
    sample = np.asarray(topic.get("timestamp_sample", topic["timestamp"]), np.float64) * 1e-6
    published = np.asarray(topic["timestamp"], np.float64) * 1e-6
    stamp = np.where(np.abs(sample - published) < 1.0, sample, published)
    index = np.asarray(np.searchsorted(stamp, t - 1e-7))
    np.testing.assert_allclose(stamp[index], t, atol=1e-7)
    return index


def test_gps_is_that_of_pyulog(log: tuple[c.Flight, Topics]) -> None:
    flight, topics = log
    assert bool(flight.gps) == ("vehicle_gps_position" in topics)
    for track in flight.gps:
        topic = topics[track.source]
        i = rows(track.t, topic)
        fixed = track.fix_type >= 3
        assert fixed.any()
        new = "latitude_deg" in topic
        latitude, height = (topic["latitude_deg"], topic["altitude_msl_m"]) if new else (
            topic["lat"] * 1e-7, topic["alt"] * 1e-3,
        )  # fmt: skip
        np.testing.assert_allclose(np.degrees(track.latitude[fixed]), latitude[i][fixed], rtol=0, atol=1e-11)
        np.testing.assert_allclose(track.height[fixed], height[i][fixed], rtol=1e-12)
        for axis, name in enumerate("ned"):
            np.testing.assert_array_equal(track.velocity[fixed, axis], topic[f"vel_{name}_m_s"][i][fixed])
        np.testing.assert_array_equal(track.horizontal_sigma[fixed], topic["eph"][i][fixed])
        np.testing.assert_array_equal(track.vertical_sigma[fixed], topic["epv"][i][fixed])
        np.testing.assert_array_equal(track.speed_sigma[fixed], topic["s_variance_m_s"][i][fixed])
        np.testing.assert_array_equal(track.satellites, topic["satellites_used"][i])


def test_compasses_and_barometers_are_those_of_pyulog(log: tuple[c.Flight, Topics]) -> None:
    flight, topics = log
    assert flight.compasses
    assert flight.barometers
    for compass in flight.compasses:
        if compass.source == "sensor_combined":
            continue  # whose times are offsets
        topic = topics[compass.source]
        i = rows(compass.t, topic)
        names = [f"magnetometer_ga[{axis}]" for axis in range(3)] if compass.calibrated else ["x", "y", "z"]
        for axis, name in enumerate(names):
            np.testing.assert_allclose(compass.field[:, axis], topic[name][i] * 1e-4, rtol=1e-6)
    for barometer in flight.barometers:
        topic = topics[barometer.source]
        i = rows(barometer.t, topic)
        if "baro_pressure_pa" in topic:
            np.testing.assert_array_equal(barometer.pressure, topic["baro_pressure_pa"][i])
            np.testing.assert_array_equal(barometer.altitude, topic["baro_alt_meter"][i])
        assert 8e4 < np.median(barometer.pressure) < 1.1e5


def test_biases_are_those_of_pyulog(log: tuple[c.Flight, Topics]) -> None:
    flight, topics = log
    assert flight.biases
    for track in flight.biases:
        topic = topics[track.source]
        i = rows(track.t, topic)
        for axis in range(3):
            if "gyro_bias[0]" in topic:
                np.testing.assert_array_equal(track.gyro[:, axis], topic[f"gyro_bias[{axis}]"][i])
                np.testing.assert_array_equal(track.accel[:, axis], topic[f"accel_bias[{axis}]"][i])
                np.testing.assert_allclose(track.gyro_sigma[:, axis] ** 2, topic[f"gyro_bias_variance[{axis}]"][i])
            else:
                dt = {"1.6": 0.012, "1.8": 0.008}[flight.vehicle.firmware[:3]]
                np.testing.assert_allclose(track.gyro[:, axis] * dt, topic[f"states[{10 + axis}]"][i], atol=1e-12)
                np.testing.assert_allclose(track.accel[:, axis] * dt, topic[f"states[{13 + axis}]"][i], atol=1e-12)
        assert np.isfinite(track.gyro_sigma[-1]).all()


def test_the_imu_in_use_is_that_of_pyulog(log: tuple[c.Flight, Topics]) -> None:
    flight, topics = log
    assert (flight.imu_in_use is None) == ("sensor_selection" not in topics)
    if flight.imu_in_use is None:
        return
    used = topics["sensor_selection"]["gyro_device_id"][-1]
    name = f"vehicle_imu_{flight.imu_in_use.instance[-1]}".removesuffix("_0")
    assert topics[name]["gyro_device_id"][0] == used


def test_a_bias_belongs_to_the_imu_that_it_was_learned_of() -> None:
    (flight,) = c.open_log(CUT)
    assert flight.imu_in_use
    assert flight.imu_in_use.at(np.array([45.0])) == 1
    assert [track.imu_instance for track in flight.biases] == [1]
    assert flight.imus["sensor_combined"].instance == 1


def test_the_truth_is_near_the_estimate_and_about_the_same_origin() -> None:
    (flight,) = c.open_log(CUT)
    truth, estimate = flight.truth, flight.position
    assert truth
    assert estimate
    told = np.isfinite(truth.position).all(axis=1)
    assert told.mean() > 0.99
    t = truth.t[told]
    inside = (t > estimate.t[0]) & (t < estimate.t[-1])
    for axis in range(3):
        own = np.interp(t[inside], estimate.t, estimate.position[:, axis])
        np.testing.assert_allclose(truth.position[told, axis][inside], own, atol=2.5)
        own = np.interp(t[inside], estimate.t, estimate.velocity[:, axis])
        np.testing.assert_allclose(truth.velocity[told, axis][inside], own, atol=0.5)


def test_imus_are_those_of_pyulog(log: tuple[c.Flight, Topics]) -> None:
    flight, topics = log
    for name, track in flight.imus.items():
        topic = topics[name]
        assert track.interval is not None
        end = np.asarray(topic.get("timestamp_sample", topic["timestamp"]), np.float64) * 1e-6
        i = np.asarray(np.searchsorted(end, track.t + track.interval / 2 - 1e-7))
        np.testing.assert_allclose(end[i], track.t + track.interval / 2, atol=1e-7)
        for axis in range(3):
            if name == "sensor_combined":
                np.testing.assert_array_equal(track.gyro[:, axis], topic[f"gyro_rad[{axis}]"][i])
                np.testing.assert_array_equal(track.accel[:, axis], topic[f"accelerometer_m_s2[{axis}]"][i])
                continue
            turned, sped = (track.gyro[:, axis] * track.interval, topic[f"delta_velocity[{axis}]"][i])
            np.testing.assert_allclose(turned, topic[f"delta_angle[{axis}]"][i], rtol=1e-12, atol=1e-15)
            np.testing.assert_allclose(track.accel[:, axis] * topic["delta_velocity_dt"][i] * 1e-6, sped, rtol=1e-12)
            assert track.device_id in topic["gyro_device_id"]


def test_resets_are_counted_as_the_log_counts_them(log: tuple[c.Flight, Topics]) -> None:
    flight, topics = log
    counter = topics["vehicle_attitude"]["quat_reset_counter"].astype(int)
    announced = [reset for reset in flight.resets if reset.kind in ("attitude", "heading")]
    assert len(announced) == np.count_nonzero(np.diff(counter))


@pytest.mark.parametrize("name", ["px4/px4_gcs_default.ulg", "px4/px4_square_lownoise.ulg"])
def test_increments_of_vehicle_imu_and_sensor_combined_turn_alike(name: str) -> None:
    """Logged at the full rate both are the same integrals: after minutes the attitudes are within rounding."""
    (flight,) = c.open_log(recording(name))
    own, combined = (preintegrate(flight.imus[of]) for of in ("vehicle_imu", "sensor_combined"))
    np.testing.assert_array_equal(own.t, combined.t)
    apart = quaternion.log(quaternion.multiply(quaternion.conjugate(own.q), combined.q))
    assert np.degrees(np.linalg.norm(apart, axis=1)).max() < 1e-5
    np.testing.assert_allclose(own.v, combined.v, atol=1e-3)


def test_a_log_of_every_hundredth_integral_is_not_the_one_to_integrate() -> None:
    (flight,) = c.open_log(CUT)
    assert flight.imus["vehicle_imu"].rate_hz == pytest.approx(2.0, rel=0.01)
    assert flight.imus["vehicle_imu"].covered < 0.02
    assert flight.imus["sensor_combined"].covered > 0.99
    assert flight.default_imu == "sensor_combined"


def test_the_estimators_rates_are_the_gyro_without_its_bias(log: tuple[c.Flight, Topics]) -> None:
    """Whatever the firmware calls them. Over a flight low-pass and motion average out."""
    flight, _ = log
    track = flight.imu()
    assert flight.attitude
    first = next((one for one in flight.biases if one.imu_instance == track.instance), None)
    assert first
    inside = (track.t > max(flight.attitude.t[0], first.t[0])) & (track.t < flight.attitude.t[-1])
    mean = [np.mean(track.gyro[inside, axis]) for axis in range(3)]
    rates = [np.mean(np.interp(track.t[inside], flight.attitude.t, axis)) for axis in flight.attitude.rates.T]
    held = [np.mean(np.interp(track.t[inside], first.t, axis)) for axis in first.gyro.T]
    np.testing.assert_allclose(np.subtract(mean, rates), held, atol=4e-3)
