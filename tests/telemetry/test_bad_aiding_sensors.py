"""An aiding sensor that is none: left out with a note, never an exception, never silently used; in every format."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import companion as c
from companion.model import Flight, from_euler
from tests.dataflash_writer import write_dataflash
from tests.tlogs import Writer
from tests.ulogs import ulog

N, HZ = 100, 5.0
T = 20.0 + np.arange(N) / HZ  # s, boot clock
UNIX = 1_795_290_136.0  # s
Values = dict[str, npt.NDArray[Any]]

HEALTHY: Values = {
    "t": T,
    "fix": np.full(N, 3.0),
    "lat": 47.3977418 + 1e-7 * np.arange(N),  # degrees
    "lon": 8.5455938 + 1e-7 * np.arange(N),
    "alt": 488.0 + 0.01 * np.arange(N),
    "mag": 0.2 + 0.001 * np.arange(N),  # gauss, every axis
    "pressure": 95_000.0 + np.arange(N),  # Pa
}


STILL: Values = {"gyro": np.full(4 * N, 2e-3), "force": np.full(4 * N, -9.8), "roll": np.zeros(4 * N)}
"""About and along which axis the vehicle turns and is pushed: rad/s, m/s², rad, four times as often."""


def tlog(folder: Path, values: Values) -> Flight:
    log = Writer(folder / "log.tlog")
    log.heartbeat(0.0)
    for i, t in enumerate(T):
        at = t - 20.0
        for k in range(4):
            log.raw_imu(at + 0.05 * k, t + 0.05 * k)
            if "roll" in values:
                moved(log, values, 4 * i + k)
            else:
                log.attitude(at + 0.05 * k, t + 0.05 * k)
        now = {name: column[i] for name, column in values.items()}
        if "fix" in now:
            log.send(
                at, "gps_raw_int", time_usec=round(now["t"] * 1e6), fix_type=int(now["fix"]),
                lat=round(now["lat"] * 1e7), lon=round(now["lon"] * 1e7), alt=round(now["alt"] * 1e3), eph=100, epv=100,
                vel=100, cog=0, satellites_visible=10,
            )  # fmt: skip
        if "mag" in now:
            field = round(now["mag"] * 1e3)
            log.send(
                at, "scaled_imu2", time_boot_ms=round(t * 1e3), xacc=0, yacc=0, zacc=-1000, xgyro=0, ygyro=0, zgyro=1,
                xmag=field, ymag=field, zmag=field,
            )  # fmt: skip
        if "pressure" in now:
            pressure = now["pressure"] / 100
            log.send(
                at, "scaled_pressure", time_boot_ms=round(t * 1e3), press_abs=pressure, press_diff=0.0, temperature=2150
            )
    return c.open_log(log.close())[0]


def moved(log: Writer, values: Values, i: int) -> None:
    """One sample of an IMU that sends floats, and of an attitude with rates."""
    at, us = 0.05 * i, round((20.0 + 0.05 * i) * 1e6)
    gyro, force, roll = (float(values[name][i]) for name in ("gyro", "force", "roll"))
    log.send(
        at, "highres_imu", time_usec=us, xacc=0, yacc=0, zacc=force, xgyro=gyro, ygyro=0, zgyro=0, xmag=0, ymag=0,
        zmag=0, abs_pressure=0, diff_pressure=0, pressure_alt=0, temperature=0, fields_updated=0,
    )  # fmt: skip
    log.send(
        at, "attitude", time_boot_ms=us // 1000, roll=roll, pitch=0, yaw=0, rollspeed=gyro if abs(gyro) < 9 else 0,
        pitchspeed=0, yawspeed=0,
    )  # fmt: skip


TYPES = {
    "IMU": ("QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "ATT": ("Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
    "GPS": ("QBBBLLefff", "TimeUS,I,Status,NSats,Lat,Lng,Alt,Spd,GCrs,VZ"),
    "MAG": ("QBhhh", "TimeUS,I,MagX,MagY,MagZ"),
    "BARO": ("QBfff", "TimeUS,I,Alt,Press,Temp"),
}


def dataflash(folder: Path, values: Values) -> Flight:
    def rows() -> Iterator[tuple[str, tuple[object, ...]]]:
        for i, t in enumerate(T):
            us = round(t * 1e6)
            for k in range(4):
                gyro, force, roll = (float((STILL | values)[name][4 * i + k]) for name in STILL)
                yield "IMU", (us + 50_000 * k, 0, gyro, 0.0, 1e-3 * (k % 2), 0.0, 0.0, force)
                yield "ATT", (us + 50_000 * k, 0.0, np.degrees(roll), 0.0, 0.0, 0.0, 0.0)
            now = {name: column[i] for name, column in values.items()}
            if "fix" in now:
                place = round(now["lat"] * 1e7), round(now["lon"] * 1e7), round(now["alt"] * 100)
                yield "GPS", (round(now["t"] * 1e6), 0, int(now["fix"]), 10, *place, 1.0, 0.0, 0.0)
            if "mag" in now:
                yield "MAG", (us, 0, *3 * (round(now["mag"] * 1e3),))
            if "pressure" in now:
                yield "BARO", (us, 0, 0.0, now["pressure"], 21.5)

    return c.open_log(write_dataflash(folder / "log.bin", TYPES, rows()))[0]


def px4(folder: Path, values: Values) -> Flight:
    stamp = np.round(T * 1e6).astype(np.uint64)
    fine = np.round(np.arange(20.0, 20.0 + N / HZ, 0.05) * 1e6).astype(np.uint64)
    gyro, force, roll = ((STILL | values)[name] for name in STILL)
    rates = np.column_stack([gyro, np.full(len(fine), 1e-3), np.zeros(len(fine))]).astype(np.float32)
    still = np.column_stack([np.zeros((len(fine), 2)), force]).astype(np.float32)
    topics: dict[str, dict[str, npt.NDArray[Any]]] = {
        "sensor_combined": {
            "timestamp": fine,
            "gyro_rad": rates,
            "gyro_integral_dt": np.full(len(fine), 5000, np.uint32),
            "accelerometer_m_s2": still,
        },
        "vehicle_attitude": {"timestamp": fine, "q": from_euler(roll, 0.0, 0.0).astype(np.float32)},
        "vehicle_angular_velocity": {"timestamp": fine, "xyz": np.where(np.abs(rates) < 9, rates, 0)},
    }
    if "fix" in values:
        topics["vehicle_gps_position"] = {
            "timestamp": np.round(values["t"] * 1e6).astype(np.uint64),
            "latitude_deg": values["lat"],
            "longitude_deg": values["lon"],
            "altitude_msl_m": values["alt"],
            "fix_type": values["fix"].astype(np.uint8),
            "vel_n_m_s": np.ones(N, np.float32),
            "vel_e_m_s": np.zeros(N, np.float32),
            "vel_d_m_s": np.zeros(N, np.float32),
        }
    if "mag" in values:
        field = np.tile(values["mag"].astype(np.float32)[:, None], (1, 3))
        topics["vehicle_magnetometer"] = {"timestamp": stamp, "magnetometer_ga": field}
    if "pressure" in values:
        topics["sensor_baro"] = {"timestamp": stamp, "pressure": values["pressure"].astype(np.float32)}
    path = folder / "log.ulg"
    path.write_bytes(ulog(topics))
    return c.open_log(path)[0]


FORMATS = pytest.mark.parametrize("made", [tlog, dataflash, px4], ids=["tlog", "bin", "ulg"])
Make = Callable[[Path, Values], Flight]


@FORMATS
def test_healthy_sensors_are_read(tmp_path: Path, made: Make) -> None:
    flight = made(tmp_path, HEALTHY)
    (gps,), (compass,), (barometer,) = flight.gps, flight.compasses, flight.barometers
    np.testing.assert_allclose(gps.t, T, atol=1e-6)
    np.testing.assert_allclose(np.degrees(gps.latitude), HEALTHY["lat"], atol=1e-7)
    np.testing.assert_allclose(compass.field, np.tile(HEALTHY["mag"][:, None] * 1e-4, (1, 3)), atol=1e-7)
    np.testing.assert_allclose(barometer.pressure, HEALTHY["pressure"], rtol=1e-6)
    assert not [note for note in flight.notes if "left out" in note and "RAW_IMU" not in note]


@FORMATS
def test_absent_sensors_are_none(tmp_path: Path, made: Make) -> None:
    flight = made(tmp_path, {})
    assert flight.imus
    assert not any((len(flight.gps), len(flight.compasses), len(flight.barometers)))


WRONG = {
    "all zero": dict.fromkeys(("fix", "lat", "lon", "alt", "mag", "pressure"), 0.0),
    "zero place with a fix": {"lat": 0.0, "lon": 0.0},
    "constant": {"lat": 47.0, "lon": 8.0, "alt": 400.0, "mag": 0.25, "pressure": 95_000.0},
    "no fix": {"fix": 1.0},
    "at the pole": {"lat": 90.0, "lon": 0.0},
    "beyond the pole": {"lat": 190.0},
}
NOTED = {"lat": "gps", "fix": "gps", "mag": "compasses", "pressure": "barometers"}


@FORMATS
@pytest.mark.parametrize("name", WRONG)
def test_what_is_no_sensor_is_left_out_with_a_note(tmp_path: Path, made: Make, name: str) -> None:
    flight = made(tmp_path, HEALTHY | {key: np.full(N, value) for key, value in WRONG[name].items()})
    wrong = {NOTED[key] for key in WRONG[name] if key in NOTED}
    for kind in ("gps", "compasses", "barometers"):
        assert bool(len(getattr(flight, kind))) == (kind not in wrong), kind
    told = [note for note in flight.notes if "left out" in note and "RAW_IMU" not in note]
    assert len(told) == len(wrong)


@FORMATS
def test_nothing_is_known_before_the_first_fix(tmp_path: Path, made: Make) -> None:
    """The receiver's last place from before it was switched off, at 20 km from here."""
    early = np.arange(N) < 30
    before = {"fix": np.where(early, 1.0, 3.0), "lat": np.where(early, 47.2, HEALTHY["lat"])}
    (gps,) = made(tmp_path, HEALTHY | before).gps
    known = gps.t >= T[30] - 1e-6
    assert np.isnan(gps.latitude[~known]).all()
    assert np.isnan(gps.velocity[~known]).all()
    assert np.isfinite(gps.latitude[known]).all()
    assert known.sum() == N - 30


@FORMATS
def test_unix_time_is_no_time_since_boot(tmp_path: Path, made: Make) -> None:
    """Left out, or where a message's neighbours tell the time, put there; the flight is as long as it was."""
    flight = made(tmp_path, HEALTHY | {"t": UNIX + T})
    assert flight.duration == pytest.approx(20.0, abs=0.3)
    for gps in flight.gps:
        np.testing.assert_allclose(gps.t, T, atol=0.1)
    if not len(flight.gps):
        assert any(note.startswith(("GPS", "vehicle_gps_position")) and "left out" in note for note in flight.notes)


@FORMATS
def test_a_single_fix_that_its_neighbours_contradict_is_dropped_and_counted(tmp_path: Path, made: Make) -> None:
    lat = HEALTHY["lat"].copy()
    lat[50] += 508.0 / 111_000
    flight = made(tmp_path, HEALTHY | {"lat": lat})
    assert len(flight.gps[0]) == N - 1
    assert any("1 fix left out that those before and after contradict" in note for note in flight.notes)


@FORMATS
@pytest.mark.parametrize(("name", "wrong"), [("mag", 30.0), ("pressure", 40_000.0), ("pressure", 110_000.0)])
def test_a_single_reading_that_its_neighbours_contradict_is_dropped_and_counted(
    tmp_path: Path, made: Make, name: str, wrong: float
) -> None:
    values = HEALTHY[name].copy()
    values[50] = wrong
    flight = made(tmp_path, HEALTHY | {name: values})
    track = flight.compasses[0] if name == "mag" else flight.barometers[0]
    assert len(track) == N - 1
    assert T[50] not in np.round(track.t, 3)
    assert any("1 sample left out that those before and after contradict" in note for note in flight.notes)


@FORMATS
def test_an_attitude_that_turns_away_and_back_between_two_samples_is_dropped_and_counted(
    tmp_path: Path, made: Make
) -> None:
    """By 150 degrees in 50 ms, where the vehicle turns by 2 mrad/s."""
    roll = STILL["roll"].copy()
    roll[200] = np.radians(150.0)
    flight = made(tmp_path, HEALTHY | STILL | {"roll": roll})
    assert flight.attitude is not None
    assert len(flight.attitude) == 4 * N - 1
    np.testing.assert_allclose(np.abs(flight.attitude.q_ned_frd[:, 0]), 1.0, atol=1e-6)
    assert any("1 sample left out that those before and after contradict" in note for note in flight.notes)


@FORMATS
@pytest.mark.parametrize("sensor", ["gyro", "force"])
@pytest.mark.parametrize("wrong", [np.nan, np.inf, -3e38, 1e4])
def test_what_no_imu_can_read_is_dropped_and_counted(tmp_path: Path, made: Make, sensor: str, wrong: float) -> None:
    values = STILL[sensor].copy()
    values[200] = wrong
    flight = made(tmp_path, HEALTHY | STILL | {sensor: values})
    track = flight.imu()
    assert len(track) == 4 * N - 1
    assert np.abs(track.gyro).max() < 9.0
    assert any("1 sample left out as no reading" in note for note in flight.notes)


@FORMATS
def test_shocks_spikes_flips_and_steps_are_no_damage(tmp_path: Path, made: Make) -> None:
    """The verdict has to see them: an IMU at the end of its range for one sample, a flip, a wave of pressure, a magnet,
    a reset of the heading."""
    shocked = {name: values.copy() for name, values in (HEALTHY | STILL).items()}
    shocked["force"][100] = -150.0
    shocked["gyro"][120] = 34.0
    flip = np.arange(140, 161)
    shocked["roll"][flip] = 2 * np.pi * (flip - 140) / 20  # in a second, at 6.3 rad/s
    shocked["gyro"][flip] = 2 * np.pi
    shocked["roll"][300:] += np.radians(40.0)
    shocked["pressure"][30] += 250.0
    shocked["pressure"][60:] += 2000.0
    shocked["mag"][40] += 0.2
    shocked["mag"][70:] *= -1.0
    flight = made(tmp_path, shocked)
    assert flight.attitude is not None
    assert len(flight.imu()) == len(flight.attitude) == 4 * N
    assert len(flight.barometers[0]) == len(flight.compasses[0]) == N
    assert np.abs(flight.imu().accel).max() == pytest.approx(150.0, rel=1e-3)
    assert not [note for note in flight.notes if "contradict" in note or "no reading" in note]


def test_a_receiver_tells_of_interference(tmp_path: Path) -> None:
    """u-blox's indicator of continuous waves, 0 to 255."""
    types = {"UBX1": ("QBHBBH", "TimeUS,Instance,noisePerMS,jamInd,aPower,agcCnt")}
    rows = [("UBX1", (10_000_000 + 200_000 * i, 0, 90, 10 * i, 1, 3000)) for i in range(20)]
    (flight,) = c.open_log(write_dataflash(tmp_path / "jammed.bin", types, rows))
    told = flight.series["interference"]
    assert told.t[-1] - told.t[0] == pytest.approx(3.8)
    assert told["jamming_indicator"].tolist() == [10.0 * i for i in range(20)]


@pytest.mark.parametrize(("kind", "said"), [(3.0, ""), (10.0, "the simulator"), (0.0, "DCM")])
def test_an_estimator_that_did_not_fly_is_noted(kind: float, said: str, tmp_path: Path) -> None:
    state = "PN,PE,PD,VN,VE,VD,GX,GY,GZ"
    types = {"PARM": ("QNf", "TimeUS,Name,Value"), "XKF1": ("QB" + 9 * "f", f"TimeUS,C,{state}")}
    rows: list[tuple[str, tuple[object, ...]]] = [("PARM", (10_000_000, "AHRS_EKF_TYPE", kind))]
    rows += [("XKF1", (10_000_000 + 100_000 * i, 0, 0.1 * i, *(0.0,) * 8)) for i in range(20)]
    (flight,) = c.open_log(write_dataflash(tmp_path / "log.bin", types, rows))
    notes = [note for note in flight.notes if "DCM" in note or "AHRS_EKF_TYPE" in note]
    assert [said in note for note in notes] == [True] * bool(said)
