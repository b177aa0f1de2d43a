"""Injected faults: an untouched flight stays untouched, what is put in is in, and nothing else changes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import pytest

from benchmarks.accuracy import ekf
from benchmarks.accuracy.cutting import cut, field_ned, gps_ned, thinned
from benchmarks.accuracy.faults import FAULTS, STATED, Fault
from benchmarks.accuracy.injected import Case, cases, flown, injected, is_misled, judged
from benchmarks.accuracy.power import detectable_table, share, smallest_found, table, wilson
from companion.app.recording import read_recording
from companion.model import Flight
from companion.strapdown import quaternion
from tests.recordings import BUNDLED

pytestmark = pytest.mark.slow

DEMO = BUNDLED / "copter-demo-100hz.tlog"
ONSET = 110.0


@pytest.fixture(scope="module")
def demo() -> Flight:
    (flight,) = read_recording(DEMO).flights
    return flight


def named(name: str) -> Fault:
    (found,) = [fault for fault in FAULTS if fault.name == name]
    return found


def arrays(flight: Flight) -> Iterator[tuple[str, Any, Any]]:
    """Every array of every track: its name, the times, the values."""
    tracks = [*flight.imus.values(), flight.attitude, flight.position, *flight.gps, *flight.compasses]
    for track in tracks:
        for f in fields(track):  # type: ignore[arg-type]
            values = getattr(track, f.name)
            if isinstance(values, np.ndarray):
                yield f"{type(track).__name__}.{track.source}.{f.name}", track.t, values  # type: ignore[union-attr]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_of_size_zero_changes_nothing_and_any_other_only_after_its_onset(fault: Fault, demo: Flight) -> None:
    nothing = fault.inject(demo, 0.0, ONSET)
    if not fault.throughout and "saturated" not in fault.name:
        for (name, _, before), (_, _, after) in zip(arrays(demo), arrays(nothing), strict=True):
            np.testing.assert_allclose(after, before, atol=1e-9, err_msg=name, equal_nan=True)
    wrong = fault.inject(demo, fault.sizes[-1] * fault.scale, ONSET)
    different = set()
    for (name, t, before), (_, _, after) in zip(arrays(demo), arrays(wrong), strict=True):
        early = t < ONSET
        if not fault.throughout:
            np.testing.assert_allclose(after[early], before[early], atol=1e-9, err_msg=name, equal_nan=True)
        if not np.allclose(after, before, rtol=0, atol=1e-9, equal_nan=True):
            different.add(name.split(".")[0])
    of_imu, of_estimate = {"ImuTrack"}, {"AttitudeTrack", "PositionTrack"}
    of_sensors = {"GpsTrack", "CompassTrack"}
    assert different
    assert different <= (of_imu if fault.side == "imu" else of_sensors if fault.sensed else of_estimate)


def test_an_injected_bias_reads_as_itself_and_the_second_imu_stays_healthy(demo: Flight) -> None:
    wrong = named("gyro bias, step (z)").inject(demo, 0.02, ONSET)
    after = demo.imus["RAW_IMU"].t >= ONSET
    added = wrong.imus["RAW_IMU"].gyro - demo.imus["RAW_IMU"].gyro
    np.testing.assert_allclose(added[after], np.tile([0, 0, 0.02], (after.sum(), 1)), atol=1e-15)
    assert not added[~after].any()
    assert wrong.imus["SCALED_IMU2"] is demo.imus["SCALED_IMU2"]


def test_what_is_wrong_from_the_start_is_so_at_the_first_sample_and_the_twin_stays_healthy(demo: Flight) -> None:
    together = "second IMU healthy"
    for fault in (one for one in FAULTS if one.imus != "its own"):
        before = fault.made_into(demo)
        wrong = fault.inject(before, fault.sizes[-1] * fault.scale, ONSET)
        assert len(before.imus) == (2 if together in fault.name else 1), fault.name
        if together in fault.name:
            assert wrong.imus["TWIN"] is before.imus["TWIN"]
    biased = named(f"gyro bias from the start (z), {together}").inject(demo, 0.05, ONSET).imu()
    np.testing.assert_allclose(biased.gyro - demo.imu().gyro, np.tile([0, 0, 0.05], (len(biased), 1)))
    board = named("board turned, one IMU").inject(demo, np.radians(90.0), ONSET).imu()
    np.testing.assert_allclose(board.gyro, demo.imu().gyro[:, [1, 0, 2]] * [1, -1, 1], atol=1e-12)
    heated = named(f"gyro drifts with heat (x), {together}").inject(demo, 0.03, ONSET).imu()
    grown = (heated.gyro - demo.imu().gyro)[:, 0]
    assert grown[0] == 0.0
    assert grown[-1] == pytest.approx(0.03)
    assert (np.diff(grown) > 0).all()


def test_a_compass_that_sits_turned_turns_where_the_ekf_begins(demo: Flight) -> None:
    flight = flown(demo)
    assert flight
    known = ekf.set_up(flight)
    turned = named("compass turned, one IMU").inject(flight, np.radians(90.0), ONSET)
    begun = [quaternion.to_euler(ekf.aligned(known, f).begin.q_ned_frd[None])[0] for f in (flight, turned)]
    np.testing.assert_allclose(begun[1][:2], begun[0][:2], atol=1e-9)
    assert begun[1][2] - begun[0][2] == pytest.approx(np.radians(90.0), abs=np.radians(5.0))


@pytest.mark.parametrize("name", STATED)
def test_a_fault_of_a_stated_size_has_that_size_and_its_draw_decides_where(name: str, demo: Flight) -> None:
    assert demo.attitude
    assert demo.position
    fault, size = STATED[name], 0.2
    sizes, drawn = [], set()
    for seed in range(8):
        wrong = fault.inject(demo, size, ONSET, np.random.default_rng(seed))
        assert wrong.attitude
        assert wrong.position
        turn = quaternion.log(
            quaternion.multiply(wrong.attitude.q_ned_frd, quaternion.conjugate(demo.attitude.q_ned_frd))
        )
        gps = [gps_ned(f.gps[0], demo.gps[0], demo.position) for f in (wrong, demo)]
        world = [field_ned(f.compasses[0], demo.attitude.t, demo.attitude.q_ned_frd)[-1] for f in (wrong, demo)]
        bearing = [np.arctan2(field[1], field[0]) for field in world]
        change = {
            "gyro_bias": wrong.imu().gyro[-1] - demo.imu().gyro[-1],
            "accel_bias": wrong.imu().accel[-1] - demo.imu().accel[-1],
            "tilt": turn[-1],
            "heading": turn[-1],
            "position": wrong.position.position[-1] - demo.position.position[-1],
            "gps": gps[0][-1] - gps[1][-1],
            "compass": np.array([bearing[0] - bearing[1]]),
        }[name]
        sizes.append(float(np.linalg.norm(change)))
        drawn.add(tuple(np.sign(np.round(change, 6)).tolist()))
    np.testing.assert_allclose(sizes, size, rtol=0.01)
    assert len(drawn) > 1


def test_a_gps_that_jumps_is_that_far_away_and_a_compass_that_turns_turns_so_much(demo: Flight) -> None:
    assert demo.position
    assert demo.attitude
    wrong = named("GPS jumps").inject(demo, 50.0, ONSET)
    before, after = (gps_ned(f.gps[0], demo.gps[0], demo.position) for f in (demo, wrong))
    late = demo.gps[0].t >= ONSET
    np.testing.assert_allclose((after - before)[late], np.tile([30, 40, 0], (late.sum(), 1)), atol=0.2)
    turned = named("compass turns within 10 s").inject(demo, np.radians(30), ONSET)
    worlds = [field_ned(f.compasses[0], demo.attitude.t, demo.attitude.q_ned_frd) for f in (demo, turned)]
    before, after = (np.unwrap(np.arctan2(world[:, 1], world[:, 0])) for world in worlds)
    np.testing.assert_allclose((after - before)[demo.compasses[0].t > ONSET + 10], np.radians(30), atol=1e-6)


def test_an_estimator_is_misled_by_what_it_is_off_by_where_both_estimates_are_known(demo: Flight) -> None:
    wrong = named("heading steps").inject(demo, 0.3, ONSET)
    assert is_misled(demo, cut(wrong, ONSET - 10.0, ONSET + 10.0))
    assert not is_misled(demo, cut(wrong, ONSET - 10.0, ONSET - 1.0))


def test_cutting_and_thinning_keep_what_there_is(demo: Flight) -> None:
    piece = cut(demo, 100.0, 120.0)
    for name, t, _ in arrays(piece):
        assert ((t >= 100) & (t < 120)).all(), name
    assert len(piece.imu()) == pytest.approx(2000, rel=0.01)
    slow = thinned(piece, 25.0)
    assert slow.imu().rate_hz == pytest.approx(25, rel=0.01)
    np.testing.assert_array_equal(slow.imu().gyro, piece.imu().gyro[::4], "ArduPilot's readings are filtered already")
    px4 = replace(piece, vehicle=replace(piece.vehicle, autopilot="PX4"))
    constant = replace(piece.imu(), gyro=np.full_like(piece.imu().gyro, 0.3))
    filtered = thinned(replace(px4, imus={"RAW_IMU": constant}), 25.0)
    np.testing.assert_allclose(filtered.imus["RAW_IMU"].gyro, 0.3, atol=1e-3)


def test_a_whole_flight_is_judged() -> None:
    numbers = {fault.name: i for i, fault in enumerate(FAULTS)}
    chosen = ((-1, 0, 0.0), (numbers["position jumps"], 2, 0.5), (numbers["GPS jumps"], 2, 0.5))
    rows = judged(Case(str(DEMO), 0, "simulator", False, chosen))
    assert [row.fault for row in rows] == [
        "none, recorded estimate", "none, the EKF's estimate", "position jumps", "GPS jumps",
    ]  # fmt: skip
    assert [row.result for row in rows] == ["clear", "clear", "found", "found"]
    assert "position jumps, m" in table(rows, {fault.name: fault.unit for fault in FAULTS})


def test_a_fault_that_shows_at_one_onset_alone_is_injected_there_and_one_that_shows_at_none_is_left_out(
    demo: Flight,
) -> None:
    flight = flown(demo)
    assert flight
    saturated = named("gyro saturated")
    onset, wrong = injected(saturated, 0.75, flight, 0.65)  # the vehicle has landed: it turned before
    assert wrong is not None
    assert onset == flight.start + 0.35 * flight.duration
    assert (wrong.imu().gyro != flight.imu().gyro).any()
    assert injected(named("estimate is late"), 1e-4, flight, 0.35)[1] is None


def test_cases_hold_every_fault_at_both_rates(demo: Flight) -> None:
    found = cases([DEMO], sizes="all")
    everything = {(i, k) for i, fault in enumerate(FAULTS) for k in range(len(fault.sizes))} | {(-1, 0)}
    for thin in (False, True):
        assert {(i, k) for case in found if case.thin == thin for i, k, _ in case.faults} == everything
    piece = flown(demo)
    assert piece
    assert piece.duration <= 100


@dataclass(frozen=True)
class _Row:
    vehicle: str
    result: str
    rate: str = "full"
    fault: str = "a"
    size: float = 1.0
    cause_right: bool = True
    delay_s: float | None = None


def test_vehicles_count_alike_however_many_flights_they_have() -> None:
    rows = [_Row("one", "found")] * 9 + [_Row("two", "missed")]
    assert share(rows, "found") == 0.5


def test_a_size_is_found_only_if_all_above_it_are() -> None:
    assert smallest_found([(1, 0.2), (3, 0.96), (10, 0.95), (30, 1.0)]) == 3
    assert smallest_found([(1, 1.0), (3, 0.5), (10, 1.0)]) == 10
    assert smallest_found([(1, 1.0), (3, 0.5)]) is None


def test_the_interval_of_a_share_is_wilsons() -> None:
    assert wilson(95, 100) == pytest.approx((0.888, 0.978), abs=1e-3)
    assert wilson(10, 10) == pytest.approx((0.722, 1.0), abs=1e-3)
    rows = [_Row("one", "found", fault="gyro_bias", size=4.0)] * 19 + [
        _Row("two", "missed", fault="gyro_bias", size=6.0)
    ]
    shown = detectable_table(rows, {"gyro_bias": "mrad/s", "tilt": "°"}).splitlines()
    assert shown[2:] == ["| gyro_bias | 20 | 4 mrad/s | 95% | 76% to 99% |  | 1 |  |  |  |  |"]


def test_a_log_that_is_too_short_or_lacks_a_position_has_no_rows(demo: Flight) -> None:
    assert flown(replace(demo, position=None)) is None
    assert flown(cut(demo, 100.0, 110.0)) is None
