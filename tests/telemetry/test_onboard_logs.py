"""On-board logs hold the same flight as the telemetry log of it, at a higher rate."""

from __future__ import annotations

import gzip
import re
from pathlib import Path

import numpy as np
import pytest

import companion as c
from companion.comparison.reference import attitude_error, length
from companion.logs import read_dataflash
from companion.model import Array, AttitudeTrack, DataError, InputError, PositionTrack, SettingsError
from companion.strapdown import quaternion
from tests.recordings import BUNDLED, recording, shared

pytestmark = pytest.mark.slow

SMALL = "dataflash/sitl__copter-imu1-fail.BIN"

PAIRS = [
    ("dataflash/sitl__copter-demo.BIN", "sitl/copter-demo-100hz.tlog", "IMU[0]", "RAW_IMU"),
    ("dataflash/sitl__copter-hover-nodrift.BIN", "sitl/copter-hover-nodrift-100hz.tlog", "IMU[0]", "HIGHRES_IMU"),
    ("px4/px4_square_lownoise.ulg", "px4/px4_square_lownoise.tlog", "vehicle_imu", "SCALED_IMU"),
]


def flights(board: str, link: str) -> tuple[c.Flight, c.Flight]:
    """Of PX4 there is no cut of both."""
    read = shared if board.startswith("px4/") else recording
    return c.open_log(read(board))[0], c.open_log(read(link))[0]


def whole_flights(board: str, link: str) -> tuple[c.Flight, c.Flight]:
    return c.open_log(shared(board))[0], c.open_log(shared(link))[0]


def common(a: Array, b: Array) -> Array:
    """Times of a that lie well inside b."""
    return np.asarray(a[(a > b[0] + 1) & (a < b[-1] - 1)])


def attitude_at(track: AttitudeTrack, t: Array) -> Array:
    i = np.clip(np.searchsorted(track.t, t) - 1, 0, len(track) - 2)
    u = (t - track.t[i]) / (track.t[i + 1] - track.t[i])
    return np.asarray(quaternion.slerp(track.q_ned_frd[i], track.q_ned_frd[i + 1], u))


def position_at(track: PositionTrack, t: Array) -> Array:
    return np.column_stack([np.interp(t, track.t, column) for column in track.position.T])


@pytest.mark.parametrize(("board", "link"), [pair[:2] for pair in PAIRS])
def test_attitude_and_position_are_those_of_the_telemetry_log(board: str, link: str) -> None:
    """Both clocks are the boot clock. In fast turns, an interval of 0.1 s between records is what remains."""
    onboard, telemetry = flights(board, link)
    assert onboard.attitude
    assert telemetry.attitude
    t = common(onboard.attitude.t, telemetry.attitude.t)
    error = np.degrees(length(attitude_error(attitude_at(telemetry.attitude, t), attitude_at(onboard.attitude, t))))
    assert np.median(error) < 0.1
    assert onboard.position
    assert telemetry.position
    t = common(onboard.position.t, telemetry.position.t)
    assert np.median(length(position_at(telemetry.position, t) - position_at(onboard.position, t))) < 0.05


@pytest.mark.parametrize(("board", "link", "imu", "message"), PAIRS)
def test_drift_is_that_of_the_telemetry_log(board: str, link: str, imu: str, message: str) -> None:
    """The same sensor and the same estimate: what differs is the rate, and the truncation of RAW_IMU and SCALED_IMU.

    One step for 5 s is 0.29° and, leaning gravity over, 0.2 m.
    """
    onboard, telemetry = whole_flights(board, link)
    assert onboard.default_imu == imu
    mine, theirs = (c.drift(f, imu=n, horizons=(5,)).rows[0] for f, n in ((onboard, imu), (telemetry, message)))
    assert mine.attitude_deg
    assert theirs.attitude_deg
    assert mine.attitude_deg.median == pytest.approx(theirs.attitude_deg.median, abs=0.29)
    assert mine.position_m
    assert theirs.position_m
    assert mine.position_m.median == pytest.approx(theirs.position_m.median, abs=0.25)


def test_what_a_dataflash_log_says_of_its_flight() -> None:
    (flight,) = c.open_log(recording("dataflash/sitl__copter-demo.BIN"))
    assert (flight.vehicle.autopilot, flight.vehicle.type, flight.vehicle.firmware) == (
        "ARDUPILOTMEGA", "QUADROTOR", "4.7.0-dev",
    )  # fmt: skip
    assert {name: len(track) for name, track in flight.imus.items()} == {"IMU[0]": 4799, "IMU[1]": 4799}
    assert flight.imu("imu[1]").instance == 1
    assert flight.imu().rate_hz == pytest.approx(400, rel=0.01)
    assert flight.parameters["SIM_WIND_SPD"] == 4
    assert any("ArduCopter" in text.text for text in flight.texts)
    assert flight.origin
    assert np.degrees(flight.origin.latitude) == pytest.approx(-35.3633, abs=1e-3)


def test_a_position_that_the_filter_does_not_vouch_for_is_left_out() -> None:
    """A sub under water: XKF1 says zero throughout, and XKF4 that it does not know."""
    (flight,) = c.open_log(recording("dataflash/public__clydemcqueen__ardusub_log_tools__small.BIN"))
    assert flight.position is None
    assert flight.vehicle.type == "SUBMARINE"


def test_a_compressed_log_is_the_same_flight(tmp_path: Path) -> None:
    plain = recording(SMALL)
    packed = tmp_path / "small.bin.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    ours, theirs = (c.open_log(path)[0].imu() for path in (packed, plain))
    np.testing.assert_array_equal(ours.gyro, theirs.gyro)


@pytest.mark.parametrize(
    ("said", "damaged", "note"),
    [
        (
            b"TimeUS,I,GyrX",
            b"TimeUS,I,OyrX",
            r"IMU: [\d,]+ records left out: the log declares their columns as TimeUS, I, O",
        ),
        (b"TimeUS,Name,Va", b"TimeUS,N!me,Va", r"PARM: [\d,]+ records left out"),
        (b"TimeUS,C,Q1", b"TimeUS,C,P1", r"XKQ: [\d,]+ records left out"),
        (b"TimeUS,C,Roll", b"TimeUS,C\0Roll", None),  # rather a declaration that contradicts itself
        (b"QBffffffII", b"QBff?fffII", r"IMU: [\d,]+ records left out: .* contradicts itself"),
        (b"TimeUS,Id\0", b"TimeUS,Ie\0", None),  # of events, which are left out
    ],
)
def test_a_damaged_declaration_costs_its_records_and_is_told(
    tmp_path: Path, said: bytes, damaged: bytes, note: str | None
) -> None:
    data = recording("dataflash/sitl__copter-demo.BIN").read_bytes()
    assert said in data
    (tmp_path / "damaged.bin").write_bytes(data.replace(said, damaged))
    (flight,) = c.open_log(tmp_path / "damaged.bin")
    assert 0 < flight.duration < 1000
    assert note is None or any(re.match(note, told) for told in flight.notes)


def test_a_ulog_that_was_cut_off_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    whole = recording("px4/px4_gcs_default.ulg")
    cut = tmp_path / "cut.ulg"
    cut.write_bytes(whole.read_bytes()[:1_200_000])
    read, all_of_it = c.open_log(cut)[0], c.open_log(whole)[0]
    assert 0 < len(read.imu()) < len(all_of_it.imu())
    assert any("it was cut off" in note for note in read.notes)
    assert not any("it was cut off" in note for note in all_of_it.notes)


def test_a_ulog_that_is_only_a_head_says_so(tmp_path: Path) -> None:
    cut = tmp_path / "head.ulg"
    cut.write_bytes(recording("px4/px4_gcs_default.ulg").read_bytes()[:12])
    with pytest.raises(InputError, match="head.ulg"):
        c.open_log(cut)


@pytest.mark.parametrize(
    ("said", "damaged", "told"),
    [
        (b"int32_t MAV_SYS_ID", b"int33_t MAV_SYS_ID", r"\d+ parameters? of a damaged type left out"),
        (b"delta_angle;", b"delta_bngle;", r"vehicle_imu is left out: the log declares it without delta_angle\[0\], "),
        (b"float[4] q;", b"float[4] p;", r"vehicle_attitude is left out: .* without q\[0\], "),
        (b"bool xy_valid;", b"bool xz_valid;", r"vehicle_local_position is left out: .* without xy_valid$"),
    ],
)
def test_a_damaged_definition_of_a_ulog_costs_what_it_defines(
    tmp_path: Path, said: bytes, damaged: bytes, told: str
) -> None:
    data = recording("px4/px4_gcs_default.ulg").read_bytes()[:1_000_000]
    assert said in data
    (tmp_path / "damaged.ulg").write_bytes(data.replace(said, damaged))
    (flight,) = c.open_log(tmp_path / "damaged.ulg")
    assert flight.imus
    assert any(re.match(told, note) for note in flight.notes)


def test_an_attitude_that_knows_only_when_it_was_published_is_read(tmp_path: Path) -> None:
    """As PX4 wrote it before 1.11."""
    data = recording("px4/px4_gcs_default.ulg").read_bytes()[:1_000_000]
    (tmp_path / "new.ulg").write_bytes(data)
    (tmp_path / "old.ulg").write_bytes(data.replace(b"uint64_t timestamp_sample;", b"uint64_t timestamp_zample;"))
    new, old = (c.open_log(tmp_path / name)[0].attitude for name in ("new.ulg", "old.ulg"))
    assert new
    assert old
    np.testing.assert_allclose(old.t, new.t, atol=0.01)


def test_a_ulog_whose_definitions_lead_beyond_its_end_is_no_endless_task(tmp_path: Path) -> None:
    head = recording("px4/px4_gcs_default.ulg").read_bytes()[:16]
    (tmp_path / "damaged.ulg").write_bytes(head + b"\x00\x10\x00" + bytes(50))
    with pytest.raises(InputError, match="its definitions are damaged"):
        c.open_log(tmp_path / "damaged.ulg")


def test_the_core_of_the_ekf_can_be_chosen() -> None:
    """In this log the estimator changed over from core 0 to core 1, whose states stand beside one another."""
    log = recording("dataflash/sitl__copter-imu1-fail.BIN")
    by_default, zero, one = (c.open_log(log, core=core)[0] for core in (None, 0, 1))
    assert by_default.position
    assert zero.position
    assert one.position
    np.testing.assert_array_equal(by_default.position.velocity, one.position.velocity)
    assert not np.array_equal(zero.position.velocity, one.position.velocity)
    assert any("core 0 is the reference, as asked; the one that flew is 1" in note for note in zero.notes)
    with pytest.raises(DataError, match=r"no EKF core 5. It has: 0, 1; the one that flew is 1"):
        c.open_log(log, core=5)


def test_a_telemetry_log_has_no_cores_to_choose_from() -> None:
    with pytest.raises(SettingsError, match="Leave --core out"):
        c.open_log(BUNDLED / "copter-demo-100hz.tlog", core=0)


def test_the_statistics_are_those_of_every_record() -> None:
    """Of records that make no track only the times are read."""
    flight, log = c.open_log(recording(SMALL))[0], read_dataflash(recording(SMALL))
    timed = {name: records for name, records in log.messages.items() if "TimeUS" in records.layout.fields}
    assert {name: stats.count for name, stats in flight.messages.items()} == {n: len(r) for n, r in timed.items()}
    t = timed["RCIN"].in_unit("TimeUS")
    assert flight.messages["RCIN"].longest_gap_s == pytest.approx(np.diff(t).max())


@pytest.mark.parametrize(
    ("name", "advice"),
    [
        ("dataflash/sitl__copter-demo.BIN", "LOG_BITMASK"),
        ("px4/px4_gcs_default.ulg", "SDLOG_PROFILE"),
        ("px4/px4_gcs_default.tlog", "MAV_x_MODE 2.*on-board log"),
        ("sitl/copter-mission-default-rates.tlog", "SRx_RAW_SENS.*on-board log"),
    ],
)
def test_advice_to_record_more_fits_the_log(name: str, advice: str) -> None:
    """Whoever reads the on-board log is not told to use it."""
    flight = c.open_log(recording(name))[0]
    assert re.search(advice, flight.how_to_record)
    assert flight.on_board != ("on-board log" in flight.how_to_record)


@pytest.mark.parametrize("name", ["dataflash/sitl__copter-demo.BIN", "sitl/copter-demo-100hz.tlog"])
def test_the_declination_is_what_the_vehicle_has_looked_up(name: str) -> None:
    """12.8° east at SITL's home near Canberra, by the world magnetic model."""
    flight = c.open_log(recording(name))[0]
    assert np.degrees(flight.declination) == pytest.approx(12.8, abs=0.5)


def test_rates_that_are_reckoned_from_the_imu_are_no_second_opinion_on_it() -> None:
    for name, told in (("dataflash/sitl__copter-demo.BIN", False), ("sitl/copter-demo-100hz.tlog", True)):
        assert c.open_log(recording(name))[0].require_attitude().rates_reported == told
