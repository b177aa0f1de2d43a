"""Injected faults: an untouched flight stays untouched, what is put in is in, and nothing else changes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import pytest

from benchmarks.accuracy.cutting import cut, field_ned, gps_ned, thinned
from benchmarks.accuracy.faults import FAULTS, Fault
from benchmarks.accuracy.injected import Case, cases, flown, judged
from benchmarks.accuracy.power import share, smallest_found, table
from companion.app.recording import read_recording
from companion.model import Flight
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


def test_a_log_that_is_too_short_or_lacks_a_position_has_no_rows(demo: Flight) -> None:
    assert flown(replace(demo, position=None)) is None
    assert flown(cut(demo, 100.0, 110.0)) is None
