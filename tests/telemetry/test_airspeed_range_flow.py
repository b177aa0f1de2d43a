"""Airspeed sensors, range finders and optical flow: the same tracks from every format of log."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import companion as c
from companion.model import Flight, inventory
from tests.dataflash_writer import write_dataflash
from tests.tlogs import Writer
from tests.ulogs import ulog

N, HZ = 60, 10.0
T = 20.0 + np.arange(N) / HZ  # s, boot clock
Values = dict[str, npt.NDArray[Any]]
TRUE: Values = {
    "speed": 15.0 + np.sin(np.arange(N)),  # m/s
    "range": np.round(4.0 + np.sin(0.3 * np.arange(N)), 2),  # m
    "flow": 0.1 * np.sin(0.5 * np.arange(N)),  # rad/s about x, and twice that about y
    "gyro": 0.05 * np.cos(0.5 * np.arange(N)),
}
DT = 0.02  # s, the interval of the flow where it is told


def tlog(folder: Path, values: Values) -> Flight:
    log = Writer(folder / "log.tlog")
    log.heartbeat(0.0)
    for i, t in enumerate(T):
        at, ms = t - 20.0, round(t * 1e3)
        log.raw_imu(at, t)
        log.attitude(at, t)
        speed, distance, flow, gyro = (float(values[name][i]) for name in TRUE)
        log.send(at, "airspeed", id=0, airspeed=speed, temperature=2150, raw_press=1.4, flags=0)
        for number, orientation in enumerate((25, 0)):
            log.send(
                at, "distance_sensor", time_boot_ms=ms, min_distance=20, max_distance=700, type=0, id=number,
                current_distance=round((distance + number) * 100), orientation=orientation, covariance=255,
                signal_quality=int(values.get("quality", np.zeros(N))[i]),
            )  # fmt: skip
        log.send(
            at, "optical_flow_rad", time_usec=ms * 1000, sensor_id=0, integration_time_us=round(DT * 1e6),
            integrated_x=flow * DT, integrated_y=2 * flow * DT, integrated_xgyro=gyro * DT, integrated_ygyro=0,
            integrated_zgyro=0, temperature=0, quality=200, time_delta_distance_us=0, distance=-1,
        )  # fmt: skip
    return c.open_log(log.close())[0]


TYPES = {
    "IMU": ("QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "ATT": ("Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
    "ARSP": ("QBfffcffB", "TimeUS,I,Airspeed,DiffPress,Temp,RawPress,Offset,U,H"),
    "RFND": ("QBCBBb", "TimeUS,Instance,Dist,Stat,Orient,Quality"),
    "OF": ("QBffff", "TimeUS,Qual,flowX,flowY,bodyX,bodyY"),
}


def dataflash(folder: Path, values: Values) -> Flight:
    def rows() -> Iterator[tuple[str, tuple[object, ...]]]:
        for i, t in enumerate(T):
            us = round(t * 1e6)
            speed, distance, flow, gyro = (float(values[name][i]) for name in TRUE)
            yield "IMU", (us, 0, 0.0, 0.0, 1e-3 * (i % 2), 0.0, 0.0, -9.8)
            yield "ATT", (us, *6 * (0.0,))
            yield "ARSP", (us, 0, speed, 140.0, 21.5, 0, 0.0, 0.0, 1)
            for number, orientation in enumerate((25, 0)):
                yield "RFND", (us, number, round((distance + number) * 100), 4, orientation, -1)
            yield "OF", (us, 200, flow, 2 * flow, gyro, 0.0)

    return c.open_log(write_dataflash(folder / "log.bin", TYPES, rows()))[0]


def px4(folder: Path, values: Values) -> Flight:
    stamp = np.round(T * 1e6).astype(np.uint64)
    speed, distance, flow, gyro = (values[name].astype(np.float32) for name in TRUE)
    zero = np.zeros(N, np.float32)

    def finder(number: int, orientation: int) -> Values:
        return {
            "timestamp": stamp, "min_distance": zero + 0.2, "max_distance": zero + 7, "variance": zero,
            "current_distance": distance + np.float32(number), "orientation": np.full(N, orientation, np.uint8),
            "signal_quality": np.full(N, -1, np.int8),
        }  # fmt: skip

    topics: dict[str, Values] = {
        "airspeed": {"timestamp": stamp, "indicated_airspeed_m_s": speed, "true_airspeed_m_s": speed * 1.1},
        "distance_sensor": finder(0, 25),
        "distance_sensor_1": finder(1, 0),
        "vehicle_optical_flow": {
            "timestamp": stamp,
            "pixel_flow": np.column_stack([flow, 2 * flow]) * np.float32(DT),
            "delta_angle": np.column_stack([gyro, zero, zero]) * np.float32(DT),
            "integration_timespan_us": np.full(N, round(DT * 1e6), np.uint32),
            "quality": np.full(N, 200, np.uint8),
            "distance_m": np.full(N, np.nan, np.float32),
        },
    }
    path = folder / "log.ulg"
    path.write_bytes(ulog(topics))
    return c.open_log(path)[0]


Make = Callable[[Path, Values], Flight]
FORMATS = pytest.mark.parametrize("made", [tlog, dataflash, px4], ids=["tlog", "bin", "ulg"])


@FORMATS
def test_every_sensor_has_a_track(tmp_path: Path, made: Make) -> None:
    flight = made(tmp_path, TRUE)
    (speed,), (down, ahead), (flow,) = flight.airspeeds, flight.ranges, flight.flows
    np.testing.assert_allclose(speed.t, T, atol=0.051)  # AIRSPEED has no time: that of its neighbours
    np.testing.assert_allclose(speed.airspeed, TRUE["speed"], rtol=1e-6)
    for number, (finder, orientation) in enumerate(((down, 25), (ahead, 0))):
        np.testing.assert_allclose(finder.t, T, atol=1e-9)
        np.testing.assert_allclose(finder.distance, TRUE["range"] + number, atol=1e-6)
        assert (finder.orientation, finder.instance) == (orientation, number)
        assert np.isnan(finder.sigma).all()
        assert np.isnan(finder.quality).all()
    assert (down.least, down.most) == ((None, None) if made is dataflash else pytest.approx((0.2, 7.0)))
    np.testing.assert_allclose(flow.flow, np.outer(TRUE["flow"], (1, 2)), atol=1e-7)
    np.testing.assert_allclose(flow.gyro[:, 0], TRUE["gyro"], atol=1e-7)
    assert np.isnan(flow.gyro[:, 2]).all() == (made is dataflash)
    np.testing.assert_allclose(flow.interval, np.nan if made is dataflash else DT)
    assert (flow.quality == 200).all()
    assert np.isnan(flow.distance).all()
    kinds = [item.kind for item in inventory(flight)]
    assert [kinds.count(kind) for kind in ("airspeed", "range finder", "optical flow")] == [1, 2, 1]


@FORMATS
@pytest.mark.parametrize("value", [0.0, 3.0])
def test_a_sensor_that_is_zero_or_constant_is_left_out_with_a_note(tmp_path: Path, made: Make, value: float) -> None:
    flight = made(tmp_path, dict.fromkeys(TRUE, np.full(N, value)))
    assert [len(of) for of in (flight.airspeeds, flight.ranges, flight.flows)] == [0, 0, 0]
    notes = [note for note in flight.notes if "left out" in note and "RAW_IMU" not in note]
    assert len(notes) == 4
    assert sum("the same" in note or "zero" in note or "within its range" in note for note in notes) == 4


@FORMATS
def test_without_such_sensors_there_is_none_and_no_note(tmp_path: Path, made: Make) -> None:
    nothing = dict.fromkeys(TRUE, np.full(N, np.nan))
    if made is px4:
        flight = made(tmp_path, nothing)
        assert [len(of) for of in (flight.airspeeds, flight.ranges, flight.flows)] == [0, 0, 0]


@FORMATS
def test_readings_out_of_range_are_none(tmp_path: Path, made: Make) -> None:
    """A range finder that sees nothing says so by a distance of zero or beyond its range."""
    far = TRUE["range"].copy()
    far[10:20] = -1.0 if made is dataflash else 7.5
    if made is dataflash:
        far[10:20] = 0.0
    down = made(tmp_path, TRUE | {"range": far}).ranges[0]
    assert np.isnan(down.distance[10:20]).all()
    assert np.isfinite(down.distance).sum() == N - 10
    assert len(down) == N


def test_a_distance_that_its_sensor_calls_invalid_is_none(tmp_path: Path) -> None:
    """MAVLink: 1 is an invalid signal, 0 is unknown."""
    quality = np.where(np.arange(N) < 20, 1.0, np.where(np.arange(N) < 40, 0.0, 80.0))
    down = tlog(tmp_path, TRUE | {"quality": quality}).ranges[0]
    assert (np.isnan(down.distance) == (quality == 1.0)).all()
    np.testing.assert_allclose(down.quality, np.repeat([0.0, np.nan, 0.8], 20))


@FORMATS
def test_a_single_airspeed_that_its_neighbours_contradict_is_dropped_and_counted(tmp_path: Path, made: Make) -> None:
    speed = TRUE["speed"].copy()
    speed[30] = 300.0
    flight = made(tmp_path, TRUE | {"speed": speed})
    assert len(flight.airspeeds[0]) == N - 1
    assert any("1 airspeed left out that those before and after contradict" in note for note in flight.notes)


def test_a_message_with_the_speed_goes_before_one_with_the_pressure(tmp_path: Path) -> None:
    log = Writer(tmp_path / "log.tlog")
    log.heartbeat(0.0)
    for i in range(4 * N):
        at, boot = i / 40, 20.0 + i / 40
        log.raw_imu(at, boot)
        log.attitude(at, boot)
        log.send(at, "scaled_pressure", time_boot_ms=round(boot * 1e3), press_abs=950, press_diff=1 + i, temperature=1)
        if i % 4 == 0:
            log.send(at, "airspeed", id=0, airspeed=15.0 + i, temperature=2150, raw_press=1.4, flags=0)
    (speed,) = c.open_log(log.close())[0].airspeeds
    assert speed.source == "AIRSPEED"
    assert len(speed) == N


def test_what_ardupilot_marks_as_no_reading_is_none(tmp_path: Path) -> None:
    """RangeFinder::Status: 0 not connected, 1 no data, 2 and 3 out of range, 4 good. Quality in %, -1 not known."""
    marks = [(4, -1, True), (4, 100, True), (4, 0, False)] + [(status, -1, False) for status in (0, 1, 2, 3)]

    def rows() -> Iterator[tuple[str, tuple[object, ...]]]:
        for i, t in enumerate(T):
            status, quality, _ = marks[i % len(marks)]
            us = round(t * 1e6)
            yield "IMU", (us, 0, 0.0, 0.0, 1e-3 * (i % 2), 0.0, 0.0, -9.8)
            yield "ATT", (us, *6 * (0.0,))
            yield "RFND", (us, 0, round(float(TRUE["range"][i]) * 100), status, 25, quality)

    write_dataflash(tmp_path / "log.bin", TYPES, rows())
    ((finder,),) = (flight.ranges for flight in c.open_log(tmp_path / "log.bin"))
    expected = [TRUE["range"][i] if marks[i % len(marks)][2] else np.nan for i in range(N)]
    np.testing.assert_allclose(finder.distance, expected, atol=1e-6)


def test_of_sensors_without_number_those_are_read_that_say_the_most(tmp_path: Path) -> None:
    """Anybody on a link can make up 65,536 ids, and each would be looked for in all messages."""
    log = Writer(tmp_path / "log.tlog")
    log.rest(12.0)
    made_up = np.random.default_rng(1).integers(0, 200, (600, 2)).tolist()
    for i in range(600):
        common = {"time_boot_ms": 20_000 + 20 * i, "min_distance": 1, "max_distance": 700, "type": 0, "covariance": 0}
        for number, orientation in ((250, 25), made_up[i]):
            of = {"id": number, "orientation": orientation, "current_distance": 100 + i % 50}
            log.send(12.0 + i * 1e-3, "distance_sensor", **common, **of)
    (flight,) = c.open_log(log.close())
    assert sum(key.startswith("range") for key in flight.series) == 64
    assert max(flight.ranges, key=len).orientation == 25
    assert len(max(flight.ranges, key=len)) == 600
    assert any("DISTANCE_SENSOR speaks of" in note for note in flight.notes)
