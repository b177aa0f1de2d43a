"""Compasses and IMUs that are mounted otherwise than they are set: which, and what would mend it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.comparison import GENERIC
from companion.comparison.windows import compare
from companion.estimation import BestEstimate
from companion.model import Array, Flight, ImuTrack, orientations
from companion.strapdown import quaternion
from companion.verdict import Finding, Verdict, assess
from companion.verdict.findings.axes import meaning_findings, turned_others
from companion.verdict.findings.settings import board_orientation, compass_orientation, mended
from tests.flights import flown, turned

PX4 = {"CAL_MAG0_ROT": 4.0, "SENS_BOARD_ROT": 2.0}
ARDUPILOT = {"COMPASS_ORIENT": 4.0, "COMPASS_EXTERNAL": 1.0, "AHRS_ORIENTATION": 2.0}


def read(vectors: Array, number: int) -> Array:
    """What a sensor reads that is mounted so, and taken for one that is not turned."""
    return quaternion.rotate(quaternion.conjugate(orientations()[number]), vectors)


def with_compass(flight: Flight, number: int) -> Flight:
    return replace(flight, compasses=tuple(replace(one, field=read(one.field, number)) for one in flight.compasses))


def mounted(imu: ImuTrack, number: int) -> ImuTrack:
    return replace(imu, gyro=read(imu.gyro, number), accel=read(imu.accel, number))


def second(flight: Flight) -> ImuTrack:
    return replace(flight.imu(), source="SCALED_IMU2", instance=1)[::2]


def of_kind(verdict: Verdict, kind: str) -> Finding:
    (one,) = (f for f in verdict.findings if f.kind == kind)
    return one


@pytest.mark.parametrize(("number", "witness"), [(2, True), (8, False)])
def test_a_compass_is_named_with_the_value_to_set_where_a_third_sensor_tells(number: int, *, witness: bool) -> None:
    """Another IMU, which reads as the one that is judged, or gravity."""
    flight = with_compass(flown(parameters=ARDUPILOT), number)
    imus = {**flight.imus, "2": second(flight)} if witness else flight.imus
    verdict = assess(replace(flight, imus=imus), GENERIC).verdict
    found = of_kind(verdict, "compass_orientation")
    assert (found.side, found.severity, found.undecided) == ("data", "warning", False)
    assert verdict.status == "consistent", "the autopilot was not misled by it"
    wanted = {2: "COMPASS_ORIENT to 6 (yaw 270°; now 4)", 8: "COMPASS_ORIENT to 12 (pitch 180°; now 4)"}
    assert wanted[number] in found.advice
    assert "since the start of the log" in found.evidence


def test_an_imu_that_is_turned_against_another_and_the_compass_is_accused() -> None:
    """Though the autopilot follows it, as far as its compass lets it."""
    flight = with_compass(flown(parameters=ARDUPILOT), 2)
    other = mounted(second(flight), 2)
    verdict = assess(replace(flight, imus={**flight.imus, other.source: other}), GENERIC).verdict
    assert verdict.status == "imu_suspect"
    found = of_kind(verdict, "axes_wrong")
    assert "turned by yaw 270° against another IMU and the compass" in found.evidence
    assert not [f for f in verdict.findings if f.kind == "compass_orientation"]


def test_an_autopilot_that_follows_it_was_misled_by_it() -> None:
    flight = with_compass(flown(parameters=ARDUPILOT), 2)
    flight = replace(flight, imus={**flight.imus, "2": second(flight)})
    quarter = np.tile([0.0, 0.0, -np.pi / 2.0], (len(flight.require_attitude()), 1))
    verdict = assess(turned(flight, quarter), GENERIC).verdict
    assert verdict.status == "autopilot_suspect"
    assert verdict.cause is not None
    assert (verdict.cause.kind, verdict.cause.sensor) == ("compass_orientation", "compass")
    assert verdict.cause.size == pytest.approx(np.pi / 2.0)
    assert any("heading" in one for one in verdict.cause.consequences)


@pytest.mark.parametrize("vehicle", ["QUADROTOR", "GROUND_ROVER"])
def test_without_a_third_sensor_both_are_named(vehicle: str) -> None:
    flight = with_compass(flown(parameters=ARDUPILOT), 2)
    flight = replace(flight, vehicle=replace(flight.vehicle, type=vehicle))
    verdict = assess(flight, GENERIC).verdict
    found = of_kind(verdict, "compass_orientation")
    assert verdict.status == "insufficient_data"
    assert found.undecided
    assert ("rather the compass" in found.evidence) == (vehicle == "QUADROTOR")
    assert "COMPASS_ORIENT to 6 (yaw 270°; now 4)" in found.advice
    assert "AHRS_ORIENTATION to 0 (none; now 2)" in found.advice


@pytest.mark.parametrize(("number", "value"), [(2, 4), (8, 14), (24, 18)])
@pytest.mark.parametrize("healthy_second", [False, True])
def test_a_board_is_named_with_the_value_to_set_unless_another_imu_is_in_order(
    number: int, value: int, healthy_second: bool
) -> None:
    flight = flown(parameters=ARDUPILOT)
    imu = flight.imu()
    others = (second(flight),) if healthy_second else ()
    bad = replace(flight, imus={one.source: one for one in (mounted(imu, number), *others)})
    (found,) = meaning_findings(bad, compare(bad, imu=imu.source))
    assert (found.kind, found.side, found.severity) == ("axes_wrong", "imu", "error")
    assert (f"AHRS_ORIENTATION to {value} " in found.advice) is not healthy_second
    assert ("AHRS_ORIENTATION is right" in found.advice) is healthy_second
    assert turned_others(bad, bad.imu(imu.source), [found], None) == [], "the healthy one is accused of nothing"


@pytest.mark.parametrize("number", [1, 2, 8, 24])
def test_another_imu_that_is_turned_is_the_one_that_is_accused(number: int) -> None:
    flight = flown()
    other = mounted(second(flight), number)
    verdict = assess(replace(flight, imus={**flight.imus, other.source: other}), GENERIC).verdict
    assert verdict.status == "imu_suspect"
    assert {f.cause.imu for f in verdict.findings if f.severity == "error" and f.cause is not None} == {1}
    assert of_kind(verdict, "axes_wrong").evidence.startswith("IMU 1 (SCALED_IMU2), beside IMU 0")


def test_another_imu_of_other_units_is_the_one_that_is_accused() -> None:
    flight = flown()
    other = second(flight)
    other = replace(other, gyro=np.degrees(other.gyro))
    verdict = assess(replace(flight, imus={**flight.imus, other.source: other}), GENERIC).verdict
    (said,) = (f for f in verdict.findings if f.severity == "error")
    assert said.cause is not None
    assert (said.kind, said.cause.imu) == ("units_wrong", 1)
    assert "degrees, where radians are meant" in verdict.summary


def test_without_a_compass_neither_of_two_imus_is_accused(best: BestEstimate) -> None:
    flight = flown(compasses=())
    other = mounted(second(flight), 2)
    both = replace(flight, imus={**flight.imus, other.source: other})
    (one,) = turned_others(both, flight.imu(), [], None)
    assert (one.side, one.severity, one.undecided) == ("data", "warning", True)
    assert turned_others(replace(both, imus={**flight.imus, "2": second(flight)}), flight.imu(), [], best) == []


@pytest.mark.parametrize(("autopilot", "parameters"), [("ARDUPILOTMEGA", ARDUPILOT), ("PX4", PX4)])
def test_what_is_set_takes_the_sensor_into_the_body(autopilot: str, parameters: dict[str, float]) -> None:
    """For every orientation in which it may be mounted, whatever is set now."""
    flight = flown(parameters=parameters)
    flight = replace(flight, vehicle=replace(flight.vehicle, autopilot=autopilot))
    for name in (board_orientation(flight), compass_orientation(flight, 0)):
        now = orientations()[int(parameters[name])]
        for true in orientations():
            turn = quaternion.multiply(true, quaternion.conjugate(now))
            value = int(mended(flight, name, turn).removeprefix(f"{name} to ").split()[0])
            assert abs(orientations()[value] @ true) == pytest.approx(1.0)


def test_where_the_log_does_not_have_what_is_set_the_turn_alone_is_said() -> None:
    flight = flown(parameters={})
    assert mended(flight, "COMPASS_ORIENT", orientations()[8]) == "COMPASS_ORIENT (turned further by roll 180°)"
    custom = flown(parameters={"COMPASS_ORIENT": 100.0})
    assert mended(custom, "COMPASS_ORIENT", orientations()[2]) == "COMPASS_ORIENT (turned further by yaw 90°)"
    slightly = quaternion.exp(np.array([0.0, 0.0, 0.4]))
    assert mended(custom, "COMPASS_ORIENT", slightly) == "COMPASS_ORIENT", "none of the list"


def test_an_internal_compass_turns_with_the_board() -> None:
    parameters = ARDUPILOT | {"COMPASS_EXTERNAL": 0.0, "AHRS_ORIENTATION": 4.0, "COMPASS_ORIENT": 0.0}
    flight = with_compass(flown(parameters=parameters), 2)
    found = of_kind(assess(flight, GENERIC).verdict, "compass_orientation")
    assert found.undecided
    assert found.advice.endswith("if it is external, set COMPASS_ORIENT to 6 (yaw 270°).")
