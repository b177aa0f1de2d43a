"""The IMUs of ArduPilot's logs: the full rate, what is known of each sensor, old firmware."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import companion as c
from companion.model import STANDARD_GRAVITY
from tests.dataflash_writer import write_dataflash
from tests.recordings import shared

TYPES = {
    "PARM": ("QNf", "TimeUS,Name,Value"),
    "IMU": ("QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "GYR": ("QBQfff", "TimeUS,I,SampleUS,GyrX,GyrY,GyrZ"),
    "ACC": ("QBQfff", "TimeUS,I,SampleUS,AccX,AccY,AccZ"),
    "ISBH": ("QHBBHHQf", "TimeUS,N,type,instance,mul,smp_cnt,SampleUS,smp_rate"),
    "ATT": ("Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
}
Rows = Iterator[tuple[str, tuple[object, ...]]]
PARAMETERS = {"INS_GYRO_FILTER": 42.0, "INS_GYR_ID": 0x3B0012, "INS_ACC_ID": 0x3B0012, "INS_GYR2_ID": 0x340032}


def rate(t: float) -> float:
    return float(np.sin(2 * np.pi * t))


def rows(seconds: float, *, bunch: int = 8, of_gyro: tuple[int, ...] = (0,), of_accel: tuple[int, ...] = (0,)) -> Rows:
    """IMU at 50 Hz, and samples of 1 kHz which a FIFO hands out in bunches, 10 µs apart."""
    for name, value in PARAMETERS.items():
        yield "PARM", (1_000_000, name, value)
    for k in range(round(seconds * 1000)):
        t, last = k * 1e-3, (k // bunch + 1) * bunch * 1e-3
        stamp = round(1e6 + last * 1e6) + 10 * (k % bunch)
        for i in of_gyro:
            yield "GYR", (stamp, i, stamp, rate(t), 0.0, 0.1 * i)
        for i in of_accel:
            yield "ACC", (stamp + 2, i, stamp + 2, 0.0, t, -9.8)
        if k % 20 == 0:
            yield "IMU", (round(1e6 + t * 1e6), 0, rate(t), 0.0, 0.0, 0.0, t, -9.8)
            yield "ATT", (round(1e6 + t * 1e6), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_every_sample_of_a_fifo_has_its_own_time(tmp_path: Path) -> None:
    """Bunches of 8 ms are read at their end, 3.5 ms behind their samples in the mean; the sensor samples evenly."""
    (flight,) = c.open_log(write_dataflash(tmp_path / "fast.bin", TYPES, rows(3.0)))
    assert flight.default_imu == "GYR[0]"
    track = flight.imu()
    assert track.rate_hz == pytest.approx(1000, rel=0.01)
    inner = slice(100, -100)
    np.testing.assert_allclose(np.diff(track.t)[inner], 1e-3, atol=2e-5)
    true = 1e-3 * np.arange(3000 - len(track), 3000)  # the first lies before the accelerometer's first
    late = track.t - 1.0 - true
    np.testing.assert_allclose(late[inner], 4.5e-3, atol=1e-4)
    np.testing.assert_allclose(track.gyro[inner, 0], np.sin(2 * np.pi * true)[inner], atol=1e-6)
    np.testing.assert_allclose(track.accel[inner, 1], true[inner], atol=1e-4)


def test_a_sample_time_far_from_that_of_its_record_is_left_out(tmp_path: Path) -> None:
    samples = [
        (name, (values[0], values[1], int(str(values[2])) | 1 << 60, *values[3:]) if k in (900, 905) else values)
        for k, (name, values) in enumerate(rows(1.0))
    ]
    assert {samples[k][0] for k in (900, 905)} == {"GYR", "ACC"}
    (flight,) = c.open_log(write_dataflash(tmp_path / "odd.bin", TYPES, iter(samples)))
    t = flight.imus["GYR[0]"].t
    assert len(t) == pytest.approx(1000, abs=12)
    assert t[-1] - t[0] == pytest.approx(1.0, abs=0.02)
    notes = [note for note in flight.notes if "the time of the sample is 1 s and more off" in note]
    assert [note.partition(" left out")[0] for note in notes] == ["GYR[0]: 1 of 1000", "ACC[0]: 1 of 1000"]


def test_the_desired_attitude_is_that_of_the_imu_whose_readings_the_trim_turns_into_the_vehicle(tmp_path: Path) -> None:
    """ATT speaks of the vehicle, XKQ of the IMU."""
    trim, wanted = (0.2, -0.1, 0.0), (10.0, -5.0, 70.0)

    def said() -> Rows:
        for name, value in zip(("AHRS_TRIM_X", "AHRS_TRIM_Y"), trim, strict=False):
            yield "PARM", (1_000_000, name, value)
        for k in range(50):
            at = 1_000_000 + 20_000 * k
            yield "IMU", (at, 0, 0.01 * k, 0.0, 0.0, 0.0, 0.0, -9.8)
            yield "ATT", (at, wanted[0], 0.0, wanted[1], 0.0, wanted[2], 0.0)
            yield "XKQ", (at, 0, 1.0, 0.0, 0.0, 0.0)

    types = TYPES | {"XKQ": ("QBffff", "TimeUS,C,Q1,Q2,Q3,Q4")}
    (flight,) = c.open_log(write_dataflash(tmp_path / "trimmed.bin", types, said()))
    assert flight.control is not None
    turn, vehicle = Rotation.from_euler("xyz", trim), Rotation.from_euler("xyz", wanted, degrees=True)
    felt = np.array([0.3, -0.5, 0.8])
    world = Rotation.from_quat(np.roll(flight.control.q_ned_frd[10], -1)).apply(felt)
    np.testing.assert_allclose(world, vehicle.apply(turn.apply(felt)), atol=1e-6)


def test_the_desired_attitude_of_a_tail_sitter_that_hovers_is_that_of_its_body(tmp_path: Path) -> None:
    """ATT calls it level where its nose points up, XKQ does not; in forward flight both tell the same."""

    def said() -> Rows:
        for k in range(100):
            at, hovers = 1_000_000 + 20_000 * k, k < 50
            q = Rotation.from_euler("ZYX", (30.0, 87.0 if hovers else 8.0, 0.0), degrees=True).as_quat()
            yield "IMU", (at, 0, 0.01 * k, 0.0, 0.0, 9.8, 0.0, 0.0)
            pitch = -3.0 if hovers else 8.0
            yield "ATT", (at, 0.0, 0.0, pitch + 2.0, pitch, 30.0, 30.0)
            yield "XKQ", (at, 0, q[3], *q[:3])

    types = TYPES | {"XKQ": ("QBffff", "TimeUS,C,Q1,Q2,Q3,Q4")}
    (flight,) = c.open_log(write_dataflash(tmp_path / "tail.bin", types, said()))
    assert flight.control is not None
    actual = flight.require_attitude().q_ned_frd
    apart = 2.0 * np.arccos(np.abs(np.sum(actual * flight.control.q_ned_frd, axis=1)))
    np.testing.assert_allclose(np.degrees(apart), 2.0, atol=0.05)


def test_what_is_known_of_a_sensor(tmp_path: Path) -> None:
    (flight,) = c.open_log(write_dataflash(tmp_path / "fast.bin", TYPES, rows(1.0)))
    filtered, raw = flight.imus["IMU[0]"], flight.imus["GYR[0]"]
    assert (filtered.low_pass_hz, raw.low_pass_hz) == (42.0, None)
    assert filtered.device_id == raw.device_id == 0x3B0012  # an ICM-45686
    assert filtered.gyro_range == pytest.approx(np.radians(4000))
    assert filtered.accel_range == pytest.approx(32 * STANDARD_GRAVITY)
    assert filtered.interval is None
    assert not filtered.bias_removed


def test_half_an_imu_is_none_and_batches_are_counted(tmp_path: Path) -> None:
    batches: Rows = iter([("ISBH", (2_000_000, n, n % 2, 0, 16, 1024, 1_900_000, 1000.0)) for n in range(5)])
    samples = [*rows(1.0, of_gyro=(0, 1), of_accel=()), *batches]
    (flight,) = c.open_log(write_dataflash(tmp_path / "half.bin", TYPES, samples))
    assert list(flight.imus) == ["IMU[0]"]
    assert any(note.startswith("GYR[0] left out: the accelerometer") for note in flight.notes)
    assert any(note.startswith("GYR[1] left out: it is another gyro once more") for note in flight.notes)
    assert any("1024 samples at 1000 Hz (3 of accelerometer 0, 2 of gyro 0)" in note for note in flight.notes)


def test_batches_are_series_of_every_sample(tmp_path: Path) -> None:
    """40 samples at 1 kHz in two records, of which the second is filled up; x / mul is in rad/s (`mavfft_isb.py`)."""
    types = TYPES | {"ISBD": ("QHHaaa", "TimeUS,N,seqno,x,y,z")}
    ramp, zero = np.arange(64, dtype="<i2"), bytes(64)
    batch: Rows = iter([
        ("ISBH", (1_500_000, 7, 1, 1, 938, 40, 1_400_000, 1000.0)),
        ("ISBD", (1_500_100, 7, 0, ramp[:32].tobytes(), zero, zero)),
        ("ISBD", (1_500_200, 7, 1, ramp[32:].tobytes(), zero, zero)),
        ("ISBD", (1_500_300, 8, 0, zero, zero, zero)),
    ])  # fmt: skip
    (flight,) = c.open_log(write_dataflash(tmp_path / "batch.bin", types, [*rows(1.0), *batch]))
    series = flight.series["gyro_batch"]
    np.testing.assert_allclose(series.t, 1.4 + 1e-3 * np.arange(40))
    np.testing.assert_allclose(series["x_radps"], np.arange(40) / 938)
    assert (series.source, series.instance) == ("ISBD[gyro 1]", 1)
    assert "ISBD: 1 of 3 left out: the head of their batch is not in the log" in flight.notes


def test_batches_in_text_are_those_of_the_binary(tmp_path: Path) -> None:
    """As Mission Planner writes them out: the 32 samples in brackets, parted by spaces."""
    fmt = {"ISBH": (20, "QHBBHHQf"), "ISBD": (21, "QHHaaa")}
    names = {"ISBH": "TimeUS,N,type,instance,mul,smp_cnt,SampleUS,smp_rate", "ISBD": "TimeUS,N,seqno,x,y,z"}
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    lines += [f"FMT, {number}, 99, {name}, {letters}, {names[name]}" for name, (number, letters) in fmt.items()]
    lines += ["ISBH, 1500000, 7, 1, 1, 938, 40, 1400000, 1000.0"]

    def samples(*values: int) -> str:
        return "[" + " ".join(map(str, values)) + "]"

    zero = samples(*32 * [0])
    lines += [f"ISBD, 1500100, 7, 0, {samples(*range(-5, 27))}, {zero}, {zero}"]
    lines += [f"ISBD, 1500200, 7, 1, {samples(*range(27, 59))}, {zero}, {zero}"]
    lines += [f"ISBD, 1500300, 7, 1, {samples(1, 2)}, {zero}, {zero}", f"ISBD, 1500400, 7, 1, [x], {zero}, {zero}"]
    lines += [f"ISBD, 1500500, 7, 1, {samples(99999, *31 * [0])}, {zero}, {zero}"]
    text = tmp_path / "batch.log"
    text.write_text("\r\n".join(lines), encoding="ascii")
    (flight,) = c.open_log(text)
    series = flight.series["gyro_batch"]
    np.testing.assert_allclose(series.t, 1.4 + 1e-3 * np.arange(40))
    np.testing.assert_allclose(series["x_radps"], np.arange(-5, 35) / 938)


def test_outputs_go_on_counting_in_records_of_their_own(tmp_path: Path) -> None:
    """RCOU has 1 to 14, RCO2 15 to 18, RCO3 19 to 32; RCO2 is written 20 µs after RCOU, and then no more."""
    types = TYPES | {
        "RCOU": ("Q" + 14 * "H", "TimeUS," + ",".join(f"C{i}" for i in range(1, 15))),
        "RCO2": ("QHHHH", "TimeUS,C15,C16,C17,C18"),
        "RCO3": ("Q" + 14 * "H", "TimeUS," + ",".join(f"C{i}" for i in range(19, 33))),
    }
    outputs: list[tuple[str, tuple[object, ...]]] = []
    for i in range(40):
        us = 1_000_000 + 100_000 * i
        outputs.append(("RCOU", (us, 1000 + 10 * i, *13 * (1500,))))
        if i < 20:
            outputs.append(("RCO2", (us + 20, *4 * (1100 + 10 * i,))))
            outputs.append(("RCO3", (us + 40, *13 * (1200,), 2000)))
    (flight,) = c.open_log(write_dataflash(tmp_path / "out.bin", types, [*rows(1.0), *outputs]))
    motors = flight.actuators
    assert motors
    assert motors.output.shape == (40, 32)
    np.testing.assert_allclose(motors.output[:, 0], 0.01 * np.arange(40))
    np.testing.assert_allclose(motors.output[:20, 14:18], np.repeat(0.1 + 0.01 * np.arange(20)[:, None], 4, axis=1))
    np.testing.assert_allclose(motors.output[:20, 31], 1.0)
    assert np.isfinite(motors.output[20:29, 14]).all(), "held for a second"
    assert np.isnan(motors.output[31:, 14:]).all()


def test_impossible_readings_are_left_out_and_counted(tmp_path: Path) -> None:
    bad = (
        ("IMU", (1_500_001, 0, 1.2e19, 0.0, 0.0, 0.0, 0.0, -9.8)),
        ("IMU", (1_500_002, 0, 0.0, 0.0, 0.0, np.inf, 0.0, 0.0)),
    )
    samples = sorted([*rows(1.0, of_gyro=(), of_accel=()), *bad], key=lambda row: int(str(row[1][0])))
    (flight,) = c.open_log(write_dataflash(tmp_path / "odd.bin", TYPES, samples))
    assert len(flight.imu()) == 50
    assert "IMU[0]: 2 samples left out as no reading of an IMU" in flight.notes


OLD = {
    "PARM": ("Nf", "Name,Value"),
    "MSG": ("Z", "Message"),
    "EV": ("B", "Id"),
    "GPS": ("BIHBcLLeeEefI", "Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,VZ,T"),
    "IMU": ("Iffffff", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "IMU2": ("Iffffff", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "ATT": ("IccccCCCC", "TimeMS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw"),
    "EKF1": ("IccCffffffccc", "TimeMS,Roll,Pitch,Yaw,VN,VE,VD,PN,PE,PD,GX,GY,GZ"),
    "EKF2": ("Ibbbcchhhhhh", "TimeMS,AX,AY,AZ,VWN,VWE,MN,ME,MD,MX,MY,MZ"),
}


def of_2014() -> Rows:
    yield "PARM", ("SYSID_THISMAV", 7.0)
    yield "MSG", ("ArduCopter V3.2.1 (36b405fb)",)
    for k in range(200):
        t = 5000 + 20 * k
        yield "IMU", (t, 0.1, 0.0, 0.0, 0.0, 0.0, -9.8)
        yield "IMU2", (t, 0.2, 0.0, 0.0, 0.0, 0.0, -9.8)
        yield "ATT", (t, 100, 0, 0, 0, 0, 9000, 0, 0)
        yield "EKF1", (t, 0, 0, 9000, 1.0, 0.0, 0.0, 0.02 * k, 0.0, -1.0, 573, 0, 0)
        yield "EKF2", (t, 50, 0, 7, *([0] * 8))
        if k % 10 == 0:
            yield (
                "GPS",
                (3, 302_400_000 + 20 * k, 1800, 9, 120, -350_000_000 + k, 1_490_000_000, 0, 58_400, 300, 9000, 0.5, t),
            )
        if k == 100:
            yield "PARM", ("SYSID_THISMAV", 8.0)
            yield "EV", (10,)


def test_old_firmware_stamps_milliseconds(tmp_path: Path) -> None:
    """ArduCopter 3.2: GPS.TimeMS is the receiver's time of the week, T the board's; PARM, MSG and EV have no time."""
    (flight,) = c.open_log(write_dataflash(tmp_path / "old.bin", OLD, of_2014()))
    assert (flight.vehicle.type, flight.vehicle.firmware) == ("QUADROTOR", "3.2.1")
    assert flight.start == 5.0
    assert flight.duration == pytest.approx(3.98)
    assert flight.imus["IMU[1]"].gyro[0, 0] == pytest.approx(0.2)
    (gps,) = flight.gps
    np.testing.assert_allclose(gps.t, 5.0 + 0.2 * np.arange(20))
    np.testing.assert_allclose(gps.velocity, [[0.0, 3.0, 0.5]] * 20, atol=1e-6)
    assert flight.epoch
    assert flight.epoch.unix_s + 5.0 == pytest.approx(315_964_800 + 1800 * 604_800 + 302_400 - 16)
    (bias,) = flight.biases
    assert bias.imu_instance is None  # it mixes both
    assert bias.gyro[0, 0] == pytest.approx(np.radians(5.73))
    assert np.isnan(bias.accel).all()  # EKF2.AX is the share of the first IMU, in %
    np.testing.assert_allclose(flight.require_attitude().rates[10:-10, 0], 0.1, atol=1e-6)  # its bias is no IMU's
    (change,) = flight.parameter_changes
    assert change.t == pytest.approx(7.0, abs=0.03)
    assert (change.name, change.value) == ("SYSID_THISMAV", 8.0)
    assert any(event.kind == "armed" and abs(event.t - 7.0) < 0.03 for event in flight.events)


@pytest.mark.parametrize("columns", ["TimeUS,Subsys,ECodX", "TimeUS,Subsyx,ECode"])
def test_errors_whose_declaration_is_damaged_tell_nothing(tmp_path: Path, columns: str) -> None:
    types = {**TYPES, "ERR": ("QBB", columns)}
    (flight,) = c.open_log(write_dataflash(tmp_path / "damaged.bin", types, [*rows(1.0), ("ERR", (500_000, 5, 1))]))
    assert not flight.events


def test_a_real_log_of_old_firmware_is_what_pymavlink_reads() -> None:
    from pymavlink.DFReader import DFReader_binary  # noqa: PLC0415

    path = shared("real/peterbarker__dataflash-logs__1.BIN")
    (flight,) = c.open_log(path)
    reader = DFReader_binary(str(path))
    theirs: dict[str, list[list[float]]] = {"IMU": [], "IMU2": [], "GPS": [], "MAG2": [], "BARO": [], "EKF1": []}
    fields = {
        "GPS": ("T", "Lat", "VZ"), "MAG2": ("TimeMS", "MagX", "MagY", "MagZ"), "BARO": ("TimeMS", "Press", "Alt"),
        "EKF1": ("TimeMS", "GX", "GY", "GZ", "PN"),
    }  # fmt: skip
    while (message := reader.recv_match(type=list(theirs))) is not None:
        kind = message.get_type()
        names = fields.get(kind, ("TimeMS", "GyrX", "GyrY", "GyrZ", "AccX", "AccY", "AccZ"))
        theirs[kind].append([getattr(message, name) for name in names])
    reader.close()
    read = {kind: np.array(values) for kind, values in theirs.items()}
    for name, kind in (("IMU[0]", "IMU"), ("IMU[1]", "IMU2")):
        track = flight.imus[name]
        turn = np.linalg.lstsq(read[kind][:, 4:7], track.accel)[0]  # AHRS_TRIM, as ATT is the reference
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-6)
        np.testing.assert_allclose(track.t, read[kind][:, 0] * 1e-3)
        np.testing.assert_allclose(track.gyro, read[kind][:, 1:4] @ turn, atol=1e-6)
    (gps,) = flight.gps
    np.testing.assert_allclose(np.degrees(gps.latitude), read["GPS"][:, 1])
    np.testing.assert_allclose(gps.t, read["GPS"][:, 0] * 1e-3)
    np.testing.assert_allclose(gps.velocity[:, 2], read["GPS"][:, 2])
    np.testing.assert_allclose(
        np.linalg.norm(flight.compasses[1].field, axis=1), np.linalg.norm(read["MAG2"][:, 1:], axis=1) * 1e-7
    )
    np.testing.assert_allclose(flight.barometers[0].pressure, read["BARO"][:, 1])
    np.testing.assert_allclose(
        np.linalg.norm(flight.biases[0].gyro, axis=1), np.radians(np.linalg.norm(read["EKF1"][:, 1:4], axis=1))
    )
    assert flight.position is None  # AHRS_EKF_USE is 0: the EKF only ran along
    assert any("did not fly" in note for note in flight.notes)
    assert flight.parameters["INS_ACCSCAL_X"] == pytest.approx(0.9962359)
    assert sum(event.kind == "mode" for event in flight.events) > 5


def test_logs_that_are_joined_are_a_flight_each(tmp_path: Path) -> None:
    """By time alone the samples of two boots would lie between one another."""
    types = {
        "PARM": ("QNf", "TimeUS,Name,Value"),
        "IMU": ("QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
        "ATT": ("QccC", "TimeUS,Roll,Pitch,Yaw"),
    }
    joined = b""
    for rate in (0.1, -0.3, 0.2):
        rows: list[tuple[str, tuple[object, ...]]] = [("PARM", (900_000, "INS_GYRO_FILTER", 10.0 + rate))]
        for i in range(800):
            rows.append(("IMU", (1_000_000 + 10_000 * i, 0, rate, 0.0, 0.0, 0.0, 0.0, -9.8)))
            rows += [("ATT", (1_000_000 + 10_000 * i, 0, 0, 0))] if i % 10 == 0 else []
        joined += write_dataflash(tmp_path / "one.bin", types, rows).read_bytes()
    log = tmp_path / "joined.bin"
    log.write_bytes(joined)
    flights = c.open_log(log)
    assert [flight.boot for flight in flights] == [1, 2, 3]
    for flight, rate in zip(flights, (0.1, -0.3, 0.2), strict=True):
        imu = flight.imus["IMU[0]"]
        assert len(imu) == 800
        np.testing.assert_allclose(imu.gyro[:, 0], rate, rtol=1e-6)
        assert imu.gyro_low_pass_hz == pytest.approx(10.0 + rate)
        assert flight.attitude is not None
        assert len(flight.attitude) == 80
    assert [any("joined" in note for note in flight.notes) for flight in flights] == [False, True, True]
