"""GPS, compass, barometer and truth as tracks: values, frames, times, and what is left out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink import mavutil

from companion.app.recording import open_log
from companion.model import Flight
from tests.recordings import recording
from tests.tlogs import Writer

GPS: dict[str, Any] = {
    "fix_type": 3, "lat": -353632620, "lon": 1491652370, "alt": 584_090, "eph": 121, "epv": 200, "vel": 500,
    "cog": 9000, "satellites_visible": 10, "alt_ellipsoid": 0, "h_acc": 300, "v_acc": 450, "vel_acc": 40, "hdg_acc": 0,
}  # fmt: skip


def flown(path: Path, *sent: tuple[float, str, dict[str, Any]]) -> Flight:
    """A vehicle that rests for 20 s from boot time 20 s on, and what it sends beside that at s after boot."""
    log = Writer(path / "log.tlog")
    log.heartbeat(0.0)
    for step in range(1001):
        t = step / 50
        log.raw_imu(t, 20.0 + t)
        log.attitude(t, 20.0 + t)
        log.local_position(t, 20.0 + t)
        for boot, name, fields in sent:
            if t <= boot - 20.0 < t + 1 / 50:
                log.send(boot - 20.0, name, **fields)
    (flight,) = open_log(log.close())
    return flight


def gps_at(t: float, name: str = "gps_raw_int", **changes: Any) -> tuple[float, str, dict[str, Any]]:
    return t, name, GPS | {"time_usec": round(t * 1e6)} | changes


def test_a_gps_fix_in_si(tmp_path: Path) -> None:
    (gps,) = flown(tmp_path, gps_at(25.0), gps_at(26.0)).gps
    assert gps.t == pytest.approx([25.0, 26.0])
    assert np.degrees(gps.latitude[0]) == pytest.approx(-35.363262)
    assert np.degrees(gps.longitude[0]) == pytest.approx(149.165237)
    assert gps.height[0] == pytest.approx(584.09)
    assert gps.velocity[0] == pytest.approx([0.0, 5.0, np.nan], nan_ok=True)
    sigmas = gps.horizontal_sigma[0], gps.vertical_sigma[0], gps.speed_sigma[0]
    assert sigmas == pytest.approx((0.3, 0.45, 0.04))
    assert (gps.fix_type[0], gps.satellites[0], gps.source, gps.instance) == (3, 10, "GPS_RAW_INT", 0)


def test_what_a_receiver_does_not_know_is_nan(tmp_path: Path) -> None:
    unknown: dict[str, Any] = {
        "vel": 65535,
        "cog": 65535,
        "h_acc": 0,
        "v_acc": 0,
        "vel_acc": 0,
        "satellites_visible": 255,
    }
    (gps,) = flown(tmp_path, gps_at(25.0, **unknown), gps_at(26.0, fix_type=2), gps_at(27.0, fix_type=1)).gps
    assert np.isnan(gps.velocity[0]).all()
    assert np.isnan([gps.horizontal_sigma[0], gps.vertical_sigma[0], gps.speed_sigma[0], gps.satellites[0]]).all()
    assert np.isnan(gps.height).tolist() == [False, True, True]
    assert np.isnan(gps.latitude).tolist() == [False, False, True]


@pytest.mark.parametrize("latitude", [0.0, 60.0, -75.0, 85.0])
@pytest.mark.parametrize(("aside_m", "kept"), [(8.0, True), (14.0, False)])
def test_a_fix_is_as_far_aside_at_every_latitude(tmp_path: Path, latitude: float, aside_m: float, kept: bool) -> None:
    """A degree of longitude is shorter by the cosine of the latitude: 8 m of east are 8 m at the pole too."""
    degree_m = np.radians(1.0) * 6.4e6 * np.cos(np.radians(latitude))
    lon = [8.0 + (aside_m / degree_m if i == 3 else 0.0) for i in range(7)]
    fixes = [
        gps_at(25.0 + i, lat=round(latitude * 1e7), lon=round(east * 1e7), alt=584_090 + i)
        for i, east in enumerate(lon)
    ]
    (gps,) = flown(tmp_path, *fixes).gps
    assert (28.0 in gps.t.round(3)) is kept


@pytest.mark.parametrize("wrong", [{"fix_type": 1}, {"lat": 0, "lon": 0}, {"lat": 900_000_000}])
def test_a_receiver_that_never_had_a_fix_is_none(tmp_path: Path, wrong: dict[str, Any]) -> None:
    assert len(flown(tmp_path, gps_at(25.0, **wrong), gps_at(26.0, **wrong)).gps) == 0


def test_two_receivers(tmp_path: Path) -> None:
    second = {"dgps_age": 0, "dgps_numch": 0, "yaw": 0}
    flight = flown(tmp_path, gps_at(25.0), gps_at(25.1, "gps2_raw", **second))
    assert [(gps.source, gps.instance) for gps in flight.gps] == [("GPS_RAW_INT", 0), ("GPS2_RAW", 1)]


def test_a_barometer(tmp_path: Path) -> None:
    pressure = {"time_boot_ms": 25_000, "press_abs": 1013.25, "press_diff": 0.0, "temperature": 2150}
    (barometer,) = flown(tmp_path, (25.0, "scaled_pressure", pressure)).barometers
    assert barometer.pressure == pytest.approx([101_325.0])
    assert barometer.altitude == pytest.approx([0.0], abs=0.01)
    assert barometer.temperature == pytest.approx([21.5])


def imu_at(t: float, name: str, mag: tuple[int, int, int]) -> tuple[float, str, dict[str, Any]]:
    still = dict.fromkeys(("xacc", "yacc", "xgyro", "ygyro"), 0) | {"zacc": -1000, "zgyro": 1}
    x, y, z = mag
    return t, name, still | {"time_boot_ms": round(t * 1e3), "xmag": x, "ymag": y, "zmag": z}


def test_a_compass_is_turned_by_the_trim_as_the_imu_is(tmp_path: Path) -> None:
    trim = {"param_type": 9, "param_count": 2}
    flight = flown(
        tmp_path,
        *(imu_at(t, "scaled_imu2", (200, -30, 500)) for t in (25.0, 25.1)),
        (26.0, "param_value", trim | {"param_id": b"AHRS_TRIM_X", "param_value": 0.05, "param_index": 0}),
        (26.1, "param_value", trim | {"param_id": b"AHRS_TRIM_Y", "param_value": -0.06, "param_index": 1}),
    )
    (compass,) = flight.compasses  # RAW_IMU has none: it is zero throughout
    assert (compass.source, compass.instance) == ("SCALED_IMU2", 1)
    # Rz(0) Ry(pitch) Rx(roll), written out
    cr, sr, cp, sp = np.cos(0.05), np.sin(0.05), np.cos(-0.06), np.sin(-0.06)
    x, y, z = 200e-7, -30e-7, 500e-7
    turned = [cp * x + sp * (sr * y + cr * z), cr * y - sr * z, -sp * x + cp * (sr * y + cr * z)]
    assert compass.field[0] == pytest.approx(turned, abs=1e-12)
    assert flight.imus["SCALED_IMU2"].accel[0] == pytest.approx(np.array([sp * cr, -sr, cp * cr]) * -9.80665, abs=1e-6)


def test_truth_has_the_time_of_its_neighbours_and_the_flight_s_zero(tmp_path: Path) -> None:
    place = {"lat": -35.3632620e7, "lon": 149.1652370e7, "alt": 590.0, "lat_int": -353632620, "lon_int": 1491652370}
    axes = ("xacc", "yacc", "zacc", "xgyro", "ygyro", "zgyro", "std_dev_horz", "std_dev_vert", "roll", "pitch")
    pose = dict.fromkeys((*axes, "q2", "q3", "q4"), 0.0) | {"yaw": 1.0, "q1": 1.0, "vn": 1.0, "ve": 2.0, "vd": 3.0}
    origin = {"time_boot_ms": 25_000, "lat": -353632620, "lon": 1491652370, "alt": 584_000, "relative_alt": 0}
    flight = flown(
        tmp_path,
        (25.0, "global_position_int", origin | {"vx": 0, "vy": 0, "vz": 0, "hdg": 0}),
        *((t, "sim_state", pose | place) for t in (25.0, 26.0)),
    )
    truth = flight.truth
    assert truth is not None
    assert truth.source == "SIM_STATE"
    assert truth.t == pytest.approx([25.0, 26.0], abs=0.02)
    assert truth.q_ned_frd[0] == pytest.approx([np.cos(0.5), 0.0, 0.0, np.sin(0.5)])
    assert truth.velocity[0] == pytest.approx([1.0, 2.0, 3.0])
    assert truth.position[0] == pytest.approx([1.0, 2.0, -9.0])  # LOCAL_POSITION_NED was (1, 2, -3) there


def test_a_fix_that_its_neighbours_contradict_is_left_out(tmp_path: Path) -> None:
    astray: dict[str, Any] = {"lat": GPS["lat"] + 45_700}  # 508 m
    flight = flown(tmp_path, *(gps_at(21.0 + i, **(astray if i == 7 else {})) for i in range(15)))
    (gps,) = flight.gps
    assert len(gps) == 14
    assert "GPS_RAW_INT: 1 fix left out that those before and after contradict" in flight.notes


def test_a_jump_that_stays_is_not_left_out(tmp_path: Path) -> None:
    away: dict[str, Any] = {"lat": GPS["lat"] + 45_700}
    (gps,) = flown(tmp_path, *(gps_at(21.0 + i, **(away if 7 <= i < 9 else {})) for i in range(15))).gps
    assert len(gps) == 15


def test_a_receiver_that_counts_from_1970_has_the_time_of_its_neighbours(tmp_path: Path) -> None:
    """Stamps that do not even run at the speed of the boot clock: nothing can be taken out of them."""
    flight = flown(tmp_path, *(gps_at(21.0 + i, time_usec=round((1.7e9 + 3.0 * i) * 1e6)) for i in range(15)))
    assert flight.gps[0].t == pytest.approx(21.0 + np.arange(15), abs=0.03)


def test_readings_that_never_change_are_no_sensor(tmp_path: Path) -> None:
    stuck = {"press_abs": 1013.25, "press_diff": 0.0, "temperature": 2150}
    flight = flown(
        tmp_path,
        *((t, "scaled_pressure", stuck | {"time_boot_ms": round(t * 1e3)}) for t in np.arange(21.0, 39.0, 0.5)),
        *(imu_at(t, "scaled_imu2", (200, -30, 500)) for t in np.arange(21.0, 39.0, 0.5)),
    )
    assert len(flight.compasses) == len(flight.barometers) == 0
    assert "SCALED_PRESSURE left out: all of its 36 readings are the same" in flight.notes
    assert "SCALED_IMU2 left out: all of its 36 readings are the same" in flight.notes


def test_another_vehicle_s_receiver_is_not_mine(tmp_path: Path) -> None:
    log = Writer(tmp_path / "log.tlog")
    log.rest(5.0)
    log.rest(5.0, begin=6.0, boot=100.0, sysid=2)
    log.send(11.5, "gps_raw_int", sysid=2, time_usec=105_000_000, **GPS)
    first, second = open_log(log.close())
    assert len(first.gps) == 0
    assert len(second.gps) == 1


@pytest.mark.parametrize("name", ["sitl/copter-demo-100hz.tlog", "px4/px4_hover.tlog"])
def test_the_tracks_are_what_pymavlink_reads(name: str) -> None:
    path = recording(name)
    flight = open_log(path)[0]
    link = mavutil.mavlink_connection(str(path))
    sent: dict[int, Any] = {}
    while (fix := link.recv_match(type="GPS_RAW_INT")) is not None:
        sent.setdefault(fix.time_usec, fix)
    link.close()
    (gps,) = flight.gps
    theirs = [sent[stamp] for stamp in sorted(sent)]
    assert gps.t == pytest.approx([fix.time_usec * 1e-6 for fix in theirs], abs=1e-6)
    fixed = [i for i, fix in enumerate(theirs) if fix.fix_type >= 3]
    assert np.degrees(gps.latitude[fixed]) == pytest.approx([theirs[i].lat * 1e-7 for i in fixed], abs=1e-12)
    assert gps.height[fixed] == pytest.approx([theirs[i].alt * 1e-3 for i in fixed])
    speed = np.hypot(gps.velocity[fixed, 0], gps.velocity[fixed, 1])
    assert speed == pytest.approx([theirs[i].vel * 1e-2 for i in fixed])
    assert gps.horizontal_sigma[fixed] == pytest.approx([theirs[i].h_acc * 1e-3 for i in fixed])
