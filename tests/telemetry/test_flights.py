"""From packets to flights: vehicles, boots, clocks, units, frames."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import companion as c
from companion.mavlink import Decoder, load_dialect
from companion.model import DataError, ImuTrack
from companion.telemetry.flights import arrival
from tests.recordings import BUNDLED, recording
from tests.tlogs import EPOCH, Writer


@pytest.fixture
def log(tmp_path: Path) -> Writer:
    return Writer(tmp_path / "flight.tlog")


def test_units_and_signs(log: Writer) -> None:
    """1 mG = 9.80665e-3 m/s², 1 mrad/s = 1e-3 rad/s; level at rest the specific force points up, which is -z in FRD."""
    log.rest(2.0)
    flight = c.open_log(log.close())[0]
    imu = flight.imu("RAW_IMU")
    assert imu.accel[0].tolist() == pytest.approx([0, 0, -9.80665])
    assert imu.gyro[0].tolist() == pytest.approx([0, 0, 1e-3])
    assert (imu.gyro_step, imu.accel_step) == pytest.approx((1e-3, 9.80665e-3))
    assert imu.t == pytest.approx(20.0 + np.arange(101) / 50, abs=1e-6)
    assert imu.rate_hz == pytest.approx(50)
    assert flight.position
    assert flight.position.position[0].tolist() == [1, 2, -3]
    assert (flight.start, flight.duration) == pytest.approx((20.0, 2.0))
    assert (flight.vehicle.autopilot, flight.vehicle.type) == ("ARDUPILOTMEGA", "QUADROTOR")


def test_euler_angles_are_aerospace(log: Writer) -> None:
    angles = np.random.default_rng(1).uniform([-3, -1.5, -3], [3, 1.5, 3], (50, 3))
    for i, (roll, pitch, yaw) in enumerate(angles):
        log.attitude(i, 10 + i, roll=roll, pitch=pitch, yaw=yaw)
    attitude = c.open_log(log.close())[0].attitude
    assert attitude
    theirs = Rotation.from_euler("ZYX", angles[:, ::-1].astype(np.float32)).as_quat(scalar_first=True)
    assert np.abs((attitude.q_ned_frd * theirs).sum(axis=1)) == pytest.approx(1, abs=1e-9)
    assert (attitude.q_ned_frd[1:] * attitude.q_ned_frd[:-1]).sum(axis=1).min() >= 0, "the sign is continuous"


def test_dequantise_adds_half_a_step_away_from_zero(log: Writer) -> None:
    for i, x in enumerate((-2, -1, 0, 1, 2)):
        log.raw_imu(i, 10 + i, accel_mg=(x, 0, -1000))
    imu = c.open_log(log.close(), dequantise=True)[0].imu()
    assert imu.accel[:, 0] / imu.accel_step == pytest.approx([-2.5, -1.5, 0, 1.5, 2.5])


def test_a_reboot_makes_a_second_flight_that_knows_the_parameters(log: Writer) -> None:
    log.send(0.0, "param_value", param_id=b"AHRS_TRIM_X", param_value=0.05, param_type=9, param_count=1, param_index=0)
    log.rest(20.0, boot=300.0)
    log.rest(30.0, begin=60.0, boot=2.0)
    first, second = c.open_log(log.close())
    assert (first.boot, first.start, first.duration) == pytest.approx((1, 300, 20))
    assert (second.boot, second.start, second.duration) == pytest.approx((2, 2, 30))
    assert second.parameters["AHRS_TRIM_X"] == pytest.approx(0.05)
    assert "boot 2 begins" in second.notes[0]
    assert "320.0 s to 2.0 s" in second.notes[0]


def test_the_trim_turns_the_imu_into_the_frame_of_the_attitude(log: Writer) -> None:
    trim = (0.05, -0.06)
    for name, value in zip((b"AHRS_TRIM_X", b"AHRS_TRIM_Y"), trim, strict=True):
        log.send(0.0, "param_value", param_id=name, param_value=value, param_type=9, param_count=2, param_index=0)
    log.rest(1.0)
    flight = c.open_log(log.close())[0]
    turn = Rotation.from_euler("ZYX", [0, trim[1], trim[0]])
    assert flight.imu().accel[0] == pytest.approx(turn.apply([0, 0, -9.80665]), abs=1e-7)
    assert any("AHRS_TRIM" in note for note in flight.notes)


def test_who_is_a_vehicle(log: Writer) -> None:
    """A ground station with an autopilot's heartbeat, a radio and a lone spoofed heartbeat are none."""
    log.rest(5.0, sysid=2)
    for i in range(6):
        log.heartbeat(i, sysid=255, compid=190, autopilot=8, kind=6)
        log.heartbeat(i, sysid=7)
        log.send(
            i, "radio_status", sysid=51, compid=68, rssi=1, remrssi=1, txbuf=1, noise=1, remnoise=1, rxerrors=0, fixed=0
        )
    log.heartbeat(3.0, sysid=2, autopilot=12, kind=1)
    (flight,) = c.open_log(log.close())
    assert (str(flight.vehicle), flight.vehicle.autopilot, flight.vehicle.type) == ("2:1", "ARDUPILOTMEGA", "QUADROTOR")


def test_two_vehicles_are_two_flights(log: Writer) -> None:
    for i in range(101):
        for sysid, boot in ((1, 20.0), (2, 500.0)):
            log.raw_imu(i / 50, boot + i / 50, sysid=sysid)
            log.attitude(i / 50, boot + i / 50, sysid=sysid)
    flights = c.open_log(log.close())
    assert [(f.vehicle.sysid, f.start, len(f.imu())) for f in flights] == [(1, 20, 101), (2, 500, 101)]


def test_echoes_out_of_order_are_dropped_and_counted(log: Writer) -> None:
    log.rest(10.0)
    path = log.close()
    packets = [p for p in path.read_bytes().split(struct_stamp()) if p]
    echoed = struct_stamp().join([b"", *packets[:500], *packets[480:500][::-1], *packets[500:]])
    path.write_bytes(echoed)
    flight = c.open_log(path)[0]
    assert len(flight.imu()) == 501
    assert flight.messages["RAW_IMU"].duplicates in {6, 7}
    assert (np.diff(flight.imu().t) > 0).all()


def struct_stamp() -> bytes:
    """The first bytes that every stamp of the first minutes shares: where packets can be cut apart in a test."""
    return int(EPOCH * 1e6).to_bytes(8, "big")[:4]


def test_a_clock_that_runs_ahead_is_known_between_the_packets_on_either_side(log: Writer) -> None:
    """What comes in the beginning of a gap between two ATTITUDE says little of it; the others bound it to some ms."""
    for i in range(1000):
        t, place = i / 50, i % 100
        gap = 50 < place < 95
        if i % 50 == 0:
            log.heartbeat(t)
        if i % 5 == 0 and not gap:
            log.attitude(t, 20.0 + t)
        if not gap or place < 65:
            log.raw_imu(t + 1e-3, 20.0 + t + 2.5)
    assert c.open_log(log.close())[0].imu().t[0] == pytest.approx(20.0, abs=0.03)


def test_unix_time_in_time_usec_becomes_boot_time(log: Writer) -> None:
    for i in range(201):
        log.attitude(i / 50, 30 + i / 50)
        log.raw_imu(i / 50, EPOCH + 30 + i / 50)
    flight = c.open_log(log.close())[0]
    assert flight.imu().t[0] == pytest.approx(30, abs=0.02)
    assert any("time_usec runs" in note for note in flight.notes)


def test_a_constant_between_two_clocks_is_told_by_the_packets_between_which_each_was_sent(log: Writer) -> None:
    """Most of them just behind one of the other clock: the few before the next say how far it may be."""
    log.heartbeat(0.0)
    sent = list[float]()
    for i in range(80):
        log.attitude(0.25 * i, 30.0 + 0.25 * i)
        for late in (0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.24):
            sent.append(30.0 + 0.25 * i + late)
            log.raw_imu(0.25 * i + late, sent[-1] + 3.0)
    (flight,) = c.open_log(log.close())
    assert flight.imu().t[: len(sent) - 8] == pytest.approx(sent[: len(flight.imu())][: len(sent) - 8], abs=0.02)


def test_stale_packets_at_the_start_are_left_out(log: Writer) -> None:
    for i in range(5):
        log.attitude(i * 0.02, 3 + i * 0.02)
    log.rest(5.0, begin=0.1, boot=120.0)
    (flight,) = c.open_log(log.close())
    assert (flight.start, flight.duration) == pytest.approx((120, 5))
    assert any("5 stale packets at the start" in note for note in flight.notes)


def test_a_clock_that_is_set_back_is_no_reboot(log: Writer) -> None:
    """One device stepped back by 1.4 s shortly after its start, and flew on: seen in a public log."""
    log.rest(3.0, boot=60.0)
    log.rest(20.0, begin=3.02, boot=61.6)
    (flight,) = c.open_log(log.close())
    imu = flight.imu()
    assert (flight.start, flight.duration) == pytest.approx((60.0, 21.6))
    assert len(imu) == 80 + 1001, "50 Hz from 60.00 to 61.58 s, and from 61.60 s on"
    assert np.diff(imu.t) == pytest.approx(0.02, abs=1e-5)
    assert any("set back from 63.00 s to 61.60 s" in note for note in flight.notes)


@pytest.mark.parametrize(("rate", "fall"), [(10.0, 0.8), (5.0, 1.6), (4.0, 3.0)])
def test_a_clock_of_few_packets_that_is_set_back_is_read_once(log: Writer, rate: float, fall: float) -> None:
    """As long as more than three packets lie in the time that it lives through twice."""
    log.heartbeat(0.0)
    for i in range(200):
        t = i / rate
        log.attitude(t, 60.0 + t - (fall if i >= 100 else 0.0))
    (flight,) = c.open_log(log.close())
    assert flight.attitude is not None
    assert np.diff(flight.attitude.t) == pytest.approx(1.0 / rate, abs=1e-3)
    assert flight.duration == pytest.approx(199 / rate - fall, abs=1e-3)
    assert any("set back" in note for note in flight.notes)


def test_a_clock_that_is_set_back_again_and_again_is_told_in_a_few_notes(log: Writer) -> None:
    """And what a later step passes again goes too, however many steps lie between."""
    for number in range(6):
        log.rest(3.0, begin=3.02 * number, boot=60.0 + 2.0 * number)
    (flight,) = c.open_log(log.close())
    notes = [note for note in flight.notes if "set back" in note]
    assert len(notes) == 4
    assert "2 times more" in notes[-1]
    assert len(flight.imu()) == 5 * 100 + 151, "of each but the last the first two seconds stay"


def test_a_gap_in_a_replay_is_no_stale_start(log: Writer) -> None:
    """Played 30 times too fast, a gap of 15 s after the first packets is half a second of log time."""
    for i in range(10):
        log.attitude(i * 0.02 / 30, 3 + i * 0.02)
    for i in range(2000):
        log.attitude(0.5 + i * 0.02 / 30, 18.2 + i * 0.02)
    (flight,) = c.open_log(log.close())
    assert flight.start == pytest.approx(3.0)
    assert not flight.notes


def test_the_clock_wraps_after_49_days(log: Writer) -> None:
    wrap = 2**32 / 1e3
    for i in range(400):
        t = wrap - 4 + i * 0.02
        log.attitude(i * 0.02, t % wrap)
    (flight,) = c.open_log(log.close())
    assert flight.duration == pytest.approx(399 * 0.02, abs=1e-3)


def test_a_heartbeat_that_contradicts_the_others_is_said(log: Writer) -> None:
    log.rest(5.0)
    log.heartbeat(3.0, autopilot=12, kind=1)
    (flight,) = c.open_log(log.close())
    assert flight.vehicle.autopilot == "ARDUPILOTMEGA"
    assert flight.notes[0].startswith("1 of 7 heartbeats contradict")


@pytest.mark.parametrize("begin", [0, 60])
def test_an_attitude_over_part_of_the_log_moves_no_clock(begin: int, log: Writer) -> None:
    """time_usec is right; that there is nothing to compare it with for most of the log says nothing against it."""
    for i in range(5001):
        log.raw_imu(i / 50, 10 + i / 50)
        if begin <= i / 50 < begin + 40:
            log.attitude(i / 50, 10 + i / 50)
    flight = c.open_log(log.close())[0]
    assert flight.imu().t[[0, -1]] == pytest.approx([10, 110], abs=1e-6)
    assert not any("time_usec runs" in note for note in flight.notes)


def test_one_sample_of_the_attitude_is_none(log: Writer) -> None:
    log.attitude(0.0, 10.0)
    for i in range(100):
        log.raw_imu(i / 50, 10 + i / 50)
    (flight,) = c.open_log(log.close())
    with pytest.raises(DataError, match="fewer than two usable samples of the attitude.*use the on-board log"):
        flight.require_attitude()


def test_the_constant_between_two_clocks_is_found_closely(log: Writer) -> None:
    for i in range(300):
        log.attitude(i / 4, 10 + i / 4)
        log.raw_imu(i / 4, 10 + i / 4 + 2.567)
    imu = c.open_log(log.close())[0].imu()
    assert imu.t[5] == pytest.approx(11.25, abs=0.13), "half of what lies between two messages of 4 Hz"


def test_a_boot_begins_with_its_own_first_packet(log: Writer) -> None:
    """After a reboot the IMU streams 4 s before the attitude does."""
    for i in range(2000):
        log.raw_imu(i / 50, 50 + i / 50)
        log.attitude(i / 50, 50 + i / 50)
    for i in range(2000):
        log.raw_imu(45 + i / 50, 1 + i / 50)
        if i >= 200:
            log.attitude(45 + i / 50, 1 + i / 50)
    log.send(44.9, "statustext", severity=6, text=b"booting", id=0, chunk_seq=0)
    first, second = c.open_log(log.close())
    assert (len(first.imu()), len(second.imu())) == (2000, 2000)
    assert first.imu().t[[0, -1]] == pytest.approx([50, 89.98])
    assert second.imu().t[[0, -1]] == pytest.approx([1, 40.98])


def test_a_wrap_that_messages_cross_out_of_order(log: Writer) -> None:
    wrap = 2**32 / 1e3
    for i in range(800):
        t = wrap - 8 + i * 0.02
        log.attitude(i * 0.02, t % wrap)
        log.local_position(i * 0.02, (t - 0.08) % wrap)
    (flight,) = c.open_log(log.close())
    assert flight.duration == pytest.approx(800 * 0.02 + 0.06, abs=1e-3)
    assert flight.position
    assert len(flight.position) == 800


def test_a_short_first_boot_is_a_flight(log: Writer) -> None:
    log.rest(3.0, boot=1.0)
    log.rest(20.0, begin=63.0, boot=1.0)
    assert [f.boot for f in c.open_log(log.close())] == [1, 2]


def test_a_few_local_positions_do_not_hide_the_global_ones(log: Writer) -> None:
    for i in range(600):
        log.attitude(i / 10, 10 + i / 10)
        if i < 3:
            log.local_position(i / 10, 10 + i / 10)
        log.send(
            i / 10, "global_position_int", time_boot_ms=round((10 + i / 10) * 1e3), lat=450000000, lon=80000000,
            alt=100_000, relative_alt=0, vx=0, vy=0, vz=0, hdg=0,
        )  # fmt: skip
    position = c.open_log(log.close())[0].position
    assert position
    assert position.source == "GLOBAL_POSITION_INT"


def test_readings_that_cannot_be_are_left_out(log: Writer) -> None:
    for i in range(200):
        broken = 1e20 if i % 10 == 0 else float("nan") if i % 10 == 1 else 0.0
        log.send(
            i / 50, "highres_imu", time_usec=round((10 + i / 50) * 1e6), xacc=0, yacc=0, zacc=-9.8, xgyro=broken,
            ygyro=0, zgyro=0, xmag=0, ymag=0, zmag=0, abs_pressure=0, diff_pressure=0, pressure_alt=0, temperature=0,
            fields_updated=63, id=0,
        )  # fmt: skip
    flight = c.open_log(log.close())[0]
    assert len(flight.imu()) == 160
    assert any("40 samples left out" in note for note in flight.notes)


def test_an_all_zero_imu_is_no_imu(log: Writer) -> None:
    log.rest(1.0)
    for i in range(10):
        log.send(
            i, "scaled_imu3", time_boot_ms=i, xacc=0, yacc=0, zacc=0, xgyro=0, ygyro=0, zgyro=0, xmag=5, ymag=6, zmag=7
        )
    flight = c.open_log(log.close())[0]
    assert set(flight.imus) == {"RAW_IMU"}
    assert any("SCALED_IMU3 is zero throughout" in note for note in flight.notes)


def test_global_position_serves_where_there_is_no_local_one(log: Writer) -> None:
    """One second of latitude is 30.8 m, of longitude 30.9 m cos(latitude): WGS-84 about the first fix."""
    second = 1e7 / 3600
    for i in range(3):
        log.attitude(i, 10 + i)
        log.send(
            i, "global_position_int", time_boot_ms=round((10 + i) * 1e3), lat=round(45e7 + i * second),
            lon=round(8e7 + i * second), alt=100_000 + 5000 * i, relative_alt=0, vx=100, vy=-200, vz=50, hdg=0,
        )  # fmt: skip
    position = c.open_log(log.close())[0].position
    assert position
    assert position.source == "GLOBAL_POSITION_INT"
    assert position.position[2] == pytest.approx([2 * 30.87, 2 * 21.90, -10], abs=0.05)
    assert position.velocity[0] == pytest.approx([1, -2, 0.5])


def test_statustext_chunks_are_put_together(log: Writer) -> None:
    log.rest(1.0)
    log.send(0.5, "statustext", severity=4, text=b"a" * 50, id=7, chunk_seq=0)
    log.send(0.5, "statustext", severity=4, text=b"bc", id=7, chunk_seq=1)
    log.send(0.6, "statustext", severity=6, text=b"short", id=0, chunk_seq=0)
    texts = c.open_log(log.close())[0].texts
    assert [(t.severity, t.text) for t in texts] == [(4, "a" * 50 + "bc"), (6, "short")]


def test_a_chunk_whose_beginning_was_lost_belongs_to_no_other_text(log: Writer) -> None:
    log.rest(1.0)
    log.send(0.5, "statustext", severity=6, text=b"EKF3 IMU0 is using GPS", id=0, chunk_seq=0)
    log.send(0.6, "statustext", severity=4, text=b"the end of 7", id=7, chunk_seq=1)
    log.send(0.7, "statustext", severity=4, text=b"b" * 50, id=8, chunk_seq=0)
    log.send(0.7, "statustext", severity=4, text=b"third", id=8, chunk_seq=2)
    texts = c.open_log(log.close())[0].texts
    assert [t.text for t in texts] == ["EKF3 IMU0 is using GPS", "the end of 7", "b" * 50, "third"]


def test_a_parameter_keeps_its_value_where_the_next_is_none(log: Writer) -> None:
    log.rest(1.0)
    for t, value in ((0.5, np.nan), (0.6, 3.0), (0.7, np.inf)):
        log.send(t, "param_value", param_id=b"A", param_value=value, param_type=9, param_count=1, param_index=0)
    (flight,) = c.open_log(log.close())
    assert flight.parameters == {"A": 3.0}
    assert not flight.parameter_changes


def test_what_a_vehicle_writes_commands_no_terminal_and_begins_no_line(log: Writer) -> None:
    log.rest(1.0)
    log.send(0.5, "statustext", severity=6, text=b"\x1b[2J\x1b]0;mine\x07\nboot 9 begins\t", id=0, chunk_seq=0)
    log.send(0.6, "statustext", severity=6, text="Höhe \x9b31m 5 m".encode(), id=0, chunk_seq=0)
    log.send(0.7, "param_value", param_id=b"A\x1b[1m\nB", param_value=1, param_type=9, param_count=1, param_index=0)
    (flight,) = c.open_log(log.close())
    assert [t.text for t in flight.texts] == ["\ufffd[2J\ufffd]0;mine\ufffd boot 9 begins ", "Höhe \ufffd31m 5 m"]
    assert list(flight.parameters) == ["A B"]  # colours go without a trace: PX4 writes them


def test_a_stream_without_any_time_has_no_duration_but_a_note(tmp_path: Path) -> None:
    log = Writer(tmp_path / "flight.tlog")
    for i in range(20):
        log.heartbeat(i)
        log.send(i, "vfr_hud", airspeed=i, groundspeed=0, heading=0, throttle=0, alt=0, climb=0)
    stamped, plain = log.close(), tmp_path / "link.raw"
    decoder = Decoder(load_dialect(), stamped=True)
    frames = decoder.push(stamped.read_bytes())
    spans = zip(frames.start.tolist(), frames.size.tolist(), strict=True)
    plain.write_bytes(b"".join(frames.data[begin : begin + size].tobytes() for begin, size in spans))
    assert c.open_log(stamped)[0].duration == pytest.approx(19.0)
    (flight,) = c.open_log(plain)
    assert flight.duration == 0.0
    assert any("no device time" in note for note in flight.notes)


def test_px4_integer_parameters_are_bytes(log: Writer) -> None:
    log.rest(1.0)
    for i in range(3):
        log.heartbeat(i, autopilot=12)
    value = np.int32(4001).view(np.float32)
    log.send(
        1.0, "param_value", param_id=b"SYS_AUTOSTART", param_value=value, param_type=6, param_count=1, param_index=0
    )
    assert c.open_log(log.close())[0].parameters["SYS_AUTOSTART"] == 4001


def test_a_rate_is_a_count_and_no_interval() -> None:
    """PX4 sends at 8 and 12 ms in turn: 100 Hz, not 125. Texts come in bursts, seconds apart."""
    uneven = np.cumsum(np.tile([0.008, 0.008, 0.014], 500))
    assert arrival(uneven, 0).rate_hz == pytest.approx(100.0, rel=0.01)
    bursts = np.concatenate([t + 4e-4 * np.arange(10) for t in (1.0, 31.0, 61.0)])
    assert arrival(bursts, 0).rate_hz == pytest.approx(29 / 60, rel=0.01)
    assert arrival(np.array([np.nan, 3.0]), 0).rate_hz is None


@pytest.mark.parametrize("intervals", [[0.008, 0.008, 0.014], [0.008, 0.012], [0.012, 0.008, 0.012, 0.008, 0.01]])
def test_the_rate_of_an_imu_is_that_of_its_usual_intervals(intervals: list[float]) -> None:
    t = np.cumsum(np.tile(intervals, 500))
    kept = np.delete(t, np.arange(7, len(t), 40))  # lost on the way
    for one in (t, kept):
        track = ImuTrack(one, np.zeros((len(one), 3)), np.zeros((len(one), 3)))
        assert track.rate_hz == pytest.approx(100.0, rel=0.03)


def test_an_imu_without_usual_intervals_has_the_rate_of_their_median() -> None:
    assert ImuTrack(np.array([0.0, 1.0, 11.0]), np.zeros((3, 3)), np.zeros((3, 3))).rate_hz == pytest.approx(1 / 5.5)


def test_the_bundled_demo_flight() -> None:
    (flight,) = c.open_log(BUNDLED / "copter-demo-100hz.tlog")
    assert (str(flight.vehicle), flight.vehicle.type, flight.vehicle.firmware) == ("1:1", "QUADROTOR", "4.7.0-dev")
    assert len(flight.imu("RAW_IMU")) == flight.messages["RAW_IMU"].count == 10121
    assert flight.messages["RAW_IMU"].rate_hz == pytest.approx(10_120 / 101.501, abs=0.01)
    assert flight.messages["RAW_IMU"].longest_gap_s == pytest.approx(0.0408, abs=1e-4)
    assert flight.messages["LOCAL_POSITION_NED"].count == 2026
    assert len(flight.texts) == 8
    assert flight.default_imu == "RAW_IMU"


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("sitl/copter-reboot-midlog.tlog", [("1:1", 1), ("1:1", 2)]),
        ("sitl/two-vehicles.tlog", [("1:1", 1), ("2:1", 1)]),
        ("public/4belito__uav-cyber-sim__537f370f_mav.tlog", [("1:1", 1), ("2:1", 1)]),
        ("public/squilter__gridlines__kresge_02.tlog", [("1:1", 1), ("1:1", 2)]),
        ("public/ArduPilot__UAVLogViewer__vtol.tlog", [("1:1", 1)]),
        ("public/MARSLab-UTRGV__drone-pi__mav.tlog", []),
        ("public/langrind__Mavometer__test.tlog", [("1:1", 1)]),
        ("px4/px4_hover.tlog", [("1:1", 1)]),
    ],
)
def test_flights_of_real_recordings(name: str, expected: list[tuple[str, int]]) -> None:
    assert [(str(f.vehicle), f.boot) for f in c.open_log(recording(name))] == expected


@pytest.mark.parametrize(
    ("name", "imu"),
    [("px4/px4_hover.tlog", "SCALED_IMU"), ("sitl/copter-hover-nodrift-100hz.tlog", "HIGHRES_IMU")],
)
def test_the_default_imu_depends_on_the_autopilot(name: str, imu: str) -> None:
    assert c.open_log(recording(name))[0].default_imu == imu


def test_floats_of_another_imu_are_not_taken_for_those_of_the_first() -> None:
    flight = c.open_log(recording("sitl/copter-hover-nodrift-100hz.tlog"))[0]
    other = replace(flight.imus["HIGHRES_IMU"], instance=1)
    assert replace(flight, imus={**flight.imus, "HIGHRES_IMU": other}).default_imu == "RAW_IMU"


def test_an_imu_is_compared_by_the_message_that_no_estimator_has_changed() -> None:
    """PX4's HIGHRES_IMU goes on with another sensor when the selector changes; SCALED_IMU2 stays what it is."""
    flight = c.open_log(recording("px4/px4_hover.tlog"))[0]
    own, floats = flight.imus["SCALED_IMU"], flight.imus["HIGHRES_IMU"]
    slower = replace(own, source="SCALED_IMU2", instance=floats.instance)[::2]
    both = replace(flight, imus={"HIGHRES_IMU": floats, "SCALED_IMU2": slower})
    assert [one.source for one in both.each_imu()] == ["SCALED_IMU2"]
    assert [one.source for one in replace(flight, imus={"HIGHRES_IMU": floats}).each_imu()] == ["HIGHRES_IMU"]
