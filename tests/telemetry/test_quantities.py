"""What a flight says beside its tracks: the same from every format, and the same that pymavlink reads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

import companion as c
from companion.mavlink import Decoder, load_dialect, mode_name, px4_nav_state_name
from companion.telemetry import Stream
from tests.recordings import BUNDLED, shared
from tests.tlogs import Writer

DEMO = BUNDLED / "copter-demo-100hz.tlog"


def read(path: Path, name: str) -> list[Any]:
    """All messages of a type that the vehicle sent, by pymavlink."""
    log: Any = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    found = []
    while (message := log.recv_match(type=name)) is not None:
        if message.get_srcSystem() == 1:
            found.append(message)
    log.close()
    return found


@pytest.fixture(scope="module")
def demo() -> c.Flight:
    return c.open_log(DEMO)[0]


def test_gps_is_what_pymavlink_reads(demo: c.Flight) -> None:
    theirs, gps = read(DEMO, "GPS_RAW_INT"), demo.series["gps"]
    assert len(gps) == len(theirs)
    np.testing.assert_allclose(np.degrees(gps["lat_rad"]), [m.lat * 1e-7 for m in theirs], rtol=1e-12)
    np.testing.assert_allclose(np.degrees(gps["lon_rad"]), [m.lon * 1e-7 for m in theirs], rtol=1e-12)
    np.testing.assert_allclose(gps["height_m"], [m.alt * 1e-3 for m in theirs])
    np.testing.assert_allclose(gps["speed_mps"], [m.vel * 1e-2 for m in theirs])
    np.testing.assert_allclose(gps["hdop"], [m.eph * 1e-2 for m in theirs])
    np.testing.assert_array_equal(gps["satellites"], [m.satellites_visible for m in theirs])
    np.testing.assert_array_equal(gps["fix_type"], [m.fix_type for m in theirs])


def test_vibration_magnetometer_temperature_and_estimator_are_what_pymavlink_reads(demo: c.Flight) -> None:
    vibration = read(DEMO, "VIBRATION")
    np.testing.assert_allclose(demo.series["vibration"]["z_mps2"], [m.vibration_z for m in vibration])
    np.testing.assert_array_equal(demo.series["vibration"]["clips_0"], [m.clipping_0 for m in vibration])
    raw = read(DEMO, "RAW_IMU")
    np.testing.assert_allclose(demo.series["magnetometer"]["y_tesla"], [m.ymag * 1e-7 for m in raw])
    np.testing.assert_allclose(
        demo.series["temperature:RAW_IMU"]["temperature_degc"], [m.temperature / 100 for m in raw]
    )
    np.testing.assert_array_equal(demo.series["magnetometer"].t, demo.imus["RAW_IMU"].t)
    assert demo.series["magnetometer:SCALED_IMU2"].source == "SCALED_IMU2"
    status = read(DEMO, "EKF_STATUS_REPORT")
    np.testing.assert_allclose(demo.series["estimator"]["compass_ratio"], [m.compass_variance for m in status])
    np.testing.assert_array_equal(demo.series["estimator"]["flags"], [m.flags for m in status])


def test_home_is_the_last_that_was_sent(demo: c.Flight) -> None:
    last = read(DEMO, "HOME_POSITION")[-1]
    assert demo.home
    assert np.degrees(demo.home.latitude) == pytest.approx(last.latitude * 1e-7)
    assert demo.home.height == pytest.approx(last.altitude * 1e-3)


def test_a_stream_gives_the_series_and_events_of_the_log(demo: c.Flight) -> None:
    stream = Stream()
    data = DEMO.read_bytes()
    pieces = (data[begin : begin + 50_000] for begin in range(0, len(data), 50_000))
    for frames in Decoder(load_dialect(), stamped=True).decode(pieces):
        stream.add(frames)
    (live,) = stream.flights()
    assert live.events == demo.events
    assert live.home == demo.home
    assert live.series.keys() == demo.series.keys()
    for key, series in demo.series.items():
        np.testing.assert_array_equal(live.series[key].t, series.t)
        np.testing.assert_array_equal(live.series[key].values, series.values)


def test_modes_have_the_names_that_pymavlink_has() -> None:
    dialect = load_dialect()
    types = dialect.enum_names("MAV_TYPE")
    # The enum has one sub mode that mavutil lacks, and mavutil a few that have gone; where both have one, they agree.
    for number, kind in types.items():
        for mode, theirs in (mavutil.mode_mapping_bynumber(number) or {}).items():
            ours = mode_name(dialect, "ARDUPILOTMEGA", kind, mode)
            assert ours in (theirs, f"mode {mode}"), (kind, mode)
    assert mode_name(dialect, "ARDUPILOTMEGA", "QUADROTOR", 5) == "LOITER"
    assert mode_name(dialect, "ARDUPILOTMEGA", "FIXED_WING", 5) == "FBWA"
    assert mode_name(dialect, "ARDUPILOTMEGA", "QUADROTOR", 99) == "mode 99"
    for main in range(12):
        for sub in range(12):
            theirs = mavutil.interpret_px4_mode(0, main << 16 | sub << 24)
            ours = mode_name(dialect, "PX4", "QUADROTOR", main << 16 | sub << 24)
            assert theirs in (ours, "UNKNOWN"), (main, sub)
    assert mode_name(load_dialect("minimal"), "ARDUPILOTMEGA", "QUADROTOR", 5) == "mode 5"
    assert px4_nav_state_name(99) == "mode 99"


def written(path: Path, fill: Any) -> c.Flight:
    log = Writer(path / "a.tlog")
    log.rest(4.0)
    fill(log)
    log.rest(4.0, begin=10.0, boot=30.0)
    log.close()
    return c.open_log(log.path)[0]


def test_changes_of_arming_and_mode_are_events_and_a_foreign_heartbeat_is_none(tmp_path: Path) -> None:
    def fly(log: Writer) -> None:
        beat = {"type": 2, "system_status": 4, "mavlink_version": 3}
        log.send(5.0, "heartbeat", autopilot=3, base_mode=1, custom_mode=4, **beat)
        log.send(6.0, "heartbeat", autopilot=3, base_mode=129, custom_mode=4, **beat)
        log.send(6.5, "heartbeat", autopilot=8, base_mode=0, custom_mode=99, **beat)  # somebody with the same ids

    flight = written(tmp_path, fly)
    told = [(event.kind, event.text) for event in flight.events]
    assert [told[i] for i in (0, 1, 3)] == [("mode", "STABILIZE"), ("mode", "GUIDED"), ("disarmed", "disarmed")]
    assert [told[i] for i in (2, 4)] == [("armed", "armed"), ("mode", "STABILIZE")]
    assert len(told) == 5
    times = [event.t for event in flight.events]
    assert times == sorted(times)
    assert times[0] == pytest.approx(20.0, abs=0.1)


def test_what_a_gps_does_not_know_is_no_number(tmp_path: Path) -> None:
    def fly(log: Writer) -> None:
        fix = {"cog": 0, "epv": 0, "eph": 65535, "vel": 65535, "satellites_visible": 255}
        log.send(5.0, "gps_raw_int", time_usec=25_000_000, fix_type=1, lat=0, lon=0, alt=0, **fix)
        log.send(6.0, "gps_raw_int", time_usec=26_000_000, fix_type=3, lat=470000000, lon=80000000, alt=500000, **fix)

    gps = written(tmp_path, fly).series["gps"]
    assert np.isnan(gps["lat_rad"]).tolist() == np.isnan(gps["height_m"]).tolist() == [True, False]
    for column in ("hdop", "speed_mps", "satellites"):
        assert np.isnan(gps[column]).all(), column
    assert gps["fix_type"].tolist() == [1, 3]
    with pytest.raises(KeyError, match="GPS_RAW_INT has no column 'height'; it has lat_rad"):
        gps["height"]


def test_pressure_altitude_is_the_standard_atmospheres(tmp_path: Path) -> None:
    table = {1013.25: 0.0, 898.746: 1000.0, 540.199: 5000.0, 226.321: 11000.0}  # hPa → m, ICAO Doc 7488

    def fly(log: Writer) -> None:
        for i, pressure in enumerate(table):
            ms = 25_000 + 1000 * i
            log.send(5.0 + i, "scaled_pressure", time_boot_ms=ms, press_abs=pressure, press_diff=0, temperature=1500)

    barometer = written(tmp_path, fly).series["barometer"]
    np.testing.assert_allclose(barometer["altitude_m"], list(table.values()), atol=2.0)
    np.testing.assert_allclose(barometer["pressure_pa"], [100 * p for p in table], rtol=1e-6)
    assert set(barometer["temperature_degc"].tolist()) == {15.0}


def test_variances_stand_on_the_diagonal_of_what_is_sent(tmp_path: Path) -> None:
    """MAVLink sends the upper triangle row by row, or all nine of a 3 x 3: the k-th diagonal element is 100 + k."""

    def triangle(size: int) -> list[float]:
        return [100.0 + row if row == column else 0.0 for row in range(size) for column in range(row, size)]

    def fly(log: Writer) -> None:
        for i in range(3):
            t = 5.0 + i
            stamp = {"time_usec": round(25e6 + 1e6 * i), "x": 0, "y": 0, "z": 0, "vx": 0, "vy": 0, "vz": 0}
            speed = [200.0 + value - 100.0 if value else 0.0 for value in triangle(6)]
            log.send(t, "odometry", **stamp, frame_id=1, child_frame_id=12, q=[1, 0, 0, 0], rollspeed=0, pitchspeed=0,
                     yawspeed=0, pose_covariance=triangle(6), velocity_covariance=speed)  # fmt: skip
            log.send(t, "local_position_ned_cov", **stamp, estimator_type=3, ax=0, ay=0, az=0,
                     covariance=triangle(9))  # fmt: skip
            log.send(t, "attitude_quaternion_cov", time_usec=stamp["time_usec"], q=[1, 0, 0, 0], rollspeed=0,
                     pitchspeed=0, yawspeed=0, covariance=np.diag([100.0, 101.0, 102.0]).ravel().tolist())  # fmt: skip

    found = written(tmp_path, fly).series
    told = {one.source: one for name, one in found.items() if name.partition(":")[0] == "variance"}
    expected = {
        "ODOMETRY": [100.0, 101.0, 102.0, 103.0, 104.0, 105.0, 200.0, 201.0, 202.0],
        "LOCAL_POSITION_NED_COV": [100.0, 101.0, 102.0, 103.0, 104.0, 105.0],
        "ATTITUDE_QUATERNION_COV": [100.0, 101.0, 102.0],
    }
    assert {name: one.values[0][np.isfinite(one.values[0])].tolist() for name, one in told.items()} == expected


def test_a_sensor_that_is_not_there_has_no_series(tmp_path: Path) -> None:
    """RAW_IMU carries a magnetometer and a thermometer even where there are none: zeros throughout."""
    assert not written(tmp_path, lambda _: None).series


def test_the_log_on_board_says_the_same_as_the_telemetry() -> None:
    board, link = (c.open_log(shared(p))[0] for p in ("dataflash/sitl__copter-demo.BIN", "sitl/copter-demo-100hz.tlog"))
    ours, theirs = board.series["gps"], link.series["gps"]
    t = ours.t[(ours.t > theirs.t[0] + 1) & (ours.t < theirs.t[-1] - 1)]
    for column, near in (("lat_rad", 2e-7), ("lon_rad", 2e-7), ("height_m", 2.0), ("satellites", 0.0)):
        a, b = (np.interp(t, s.t, s[column]) for s in (ours, theirs))
        assert np.median(np.abs(a - b)) <= near, column
    a, b = (f.series["magnetometer"] for f in (board, link))
    np.testing.assert_allclose(np.median(a.values[a.t > t[0]], axis=0), np.median(b.values, axis=0), atol=2e-6)
    assert [e.text for e in board.events if e.kind == "mode"] == ["GUIDED", "RTL"]
    assert [e.text for e in link.events if e.kind == "mode"] == ["STABILIZE", "GUIDED", "RTL"]
    assert {"disarmed"} <= {e.kind for e in board.events}
    assert "EKF yaw reset" in {e.text for e in board.events}
    assert board.home
    assert link.home
    assert board.home.latitude == pytest.approx(link.home.latitude, abs=1e-8)
    assert {"vibration:VIBE[1]", "barometer:BARO[1]", "temperature:IMU[1]", "estimator:XKF4[1]"} <= board.series.keys()


def test_px4s_log_says_the_same_as_its_telemetry() -> None:
    board, link = (c.open_log(shared(f"px4/px4_square_lownoise.{kind}"))[0] for kind in ("ulg", "tlog"))
    modes = ["LOITER", "MISSION", "LOITER", "LAND", "LOITER"]
    for flight in (board, link):
        assert [e.text for e in flight.events if e.kind == "mode"] == modes
        assert [e.kind for e in flight.events if e.kind not in ("mode", "event")] == ["armed", "disarmed"]
        assert flight.home
        assert np.degrees(flight.home.latitude) == pytest.approx(47.397743, abs=1e-6)
    for kind, column in (("gps", "lat_rad"), ("barometer", "pressure_pa"), ("estimator", "flags")):
        ours, theirs = (np.nanmedian(f.series[kind][column]) for f in (board, link))
        assert ours == pytest.approx(theirs, rel=1e-4), kind
    for column in ("coning_rad2", "gyro_radps", "accel_mps2"):  # PX4's VIBRATION is not what the message says
        ours, theirs = (np.median(f.series["vibration"][column]) for f in (board, link))
        assert ours == pytest.approx(theirs, rel=0.3), column


def test_mavlinks_enums_name_the_flags() -> None:
    """The first ten bits of `flags` mean the same in EKF_STATUS_REPORT, ESTIMATOR_STATUS and the logs on board."""
    names = ["ATTITUDE", "VELOCITY_HORIZ", "VELOCITY_VERT", "POS_HORIZ_REL", "POS_HORIZ_ABS", "POS_VERT_ABS"]
    names += ["POS_VERT_AGL", "CONST_POS_MODE", "PRED_POS_HORIZ_REL", "PRED_POS_HORIZ_ABS"]
    for bit, name in enumerate(names):
        assert getattr(mavlink, f"EKF_{name}") == getattr(mavlink, f"ESTIMATOR_{name}") == 1 << bit
