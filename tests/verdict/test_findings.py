"""What is no fault of the IMU: how it sits in the vehicle, what shakes it, what a link lost, the autopilot's own."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import companion as c
from benchmarks.accuracy.cutting import cut
from companion.app.recording import read_recording
from companion.comparison import GENERIC
from companion.comparison.imu_noise import FlightDensity
from companion.comparison.imu_spec import ReferenceSpec
from companion.comparison.windows import compare
from companion.model import (
    STANDARD_GRAVITY,
    Array,
    AttitudeTrack,
    Event,
    Flight,
    Series,
    StatusText,
    Vehicle,
    rows,
)
from companion.strapdown import Motion, motions, quaternion, simulate
from companion.verdict import Assessment, Finding, assess
from companion.verdict.findings.axes import meaning_findings
from companion.verdict.findings.detect import findings, reading_faults
from companion.verdict.findings.outages import jump_findings
from companion.verdict.findings.readings import lags, turns_back
from companion.verdict.findings.stuck import stuck_findings
from companion.verdict.findings.vibration import clip_counts
from tests.estimation.sensed import sensed
from tests.flights import CIRCLE, GOOD, LIVELY, flight_of, flown, lively, seconds, turned, with_imu, without_aiding
from tests.recordings import BUNDLED, shared

pytestmark = pytest.mark.slow


def kinds(found: Assessment, severity: str = "error") -> list[str]:
    return [f.kind for f in found.verdict.findings if f.severity == severity]


def of_kind(found: Assessment, kind: str) -> Finding:
    said = [f.kind for f in found.verdict.findings]
    assert kind in said, f"found {said}"
    return found.verdict.findings[said.index(kind)]


def mounted(flight: Flight, *degrees: float) -> Flight:
    """The same with its IMU turned by a rotation vector."""
    imu, turn = flight.imu(), quaternion.to_matrix(quaternion.exp(np.radians(degrees)))
    return with_imu(flight, gyro=imu.gyro @ turn.T, accel=imu.accel @ turn.T)


@pytest.mark.parametrize("motion", [LIVELY, CIRCLE])
def test_a_trim_is_a_mounting_and_no_bias(motion: Motion) -> None:
    """One that the log does not name: the attitude may lean as well as the board, and the IMU is not accused."""
    found = assess(mounted(flown(motion), -3.0, 3.0, 0.0), GENERIC)
    assert found.verdict.status != "imu_suspect"
    assert set(kinds(found)) <= {"tilt_off"}
    said = of_kind(found, "mounting")
    assert said.side == "data"
    if motion is LIVELY:
        angles = [float(word) for word in said.evidence.split("(")[1].split(")")[0].split(",")]
        assert angles == pytest.approx([3.0, -3.0, 0.0], abs=0.7)


def test_a_lever_arm_is_no_bias() -> None:
    flight, arm = flown(), np.array([0.4, -0.2, 0.1])
    imu = flight.imu()
    angular = np.gradient(LIVELY.gyro, LIVELY.t, axis=0)
    away = np.cross(angular, arm) + np.cross(LIVELY.gyro, np.cross(LIVELY.gyro, arm))
    found = assess(with_imu(flight, accel=imu.accel + away), GENERIC)
    assert found.verdict.status == "consistent"
    assert kinds(found) == []


def test_a_plane_in_coordinated_circles_and_a_rover() -> None:
    bank = float(np.arctan(20.0**2 / (90.0 * STANDARD_GRAVITY)))
    plane = motions.circle(seconds(50, 50), radius=90.0, speed=20.0, bank=bank, heave=0.0)
    rover = motions.circle(seconds(50, 50), radius=8.0, speed=2.0, bank=0.0, heave=0.02, frequency=1.0)
    for motion in (plane, rover):
        found = assess(flown(motion), GENERIC)
        assert found.verdict.status == "consistent"
        assert kinds(found) == []


def test_a_lossy_radio_blames_the_data() -> None:
    """No window of 5 s is whole: the best estimate, which bridges the gaps, finds nothing else."""
    flight = flown(CIRCLE)
    imu = flight.imu()
    heard = np.sin(2 * np.pi * 0.9 * imu.t) < 0.6  # a third of each second is lost
    found = assess(replace(flight, imus={"RAW_IMU": rows(imu, heard)}), GENERIC)
    assert found.verdict.status == "consistent"
    assert "left out" in found.verdict.summary
    assert of_kind(found, "samples_missing").side == "data"
    assert of_kind(found, "samples_missing").evidence.startswith("RAW_IMU has ")
    assert not [f for f in found.verdict.findings if f.side != "data"]


@pytest.mark.parametrize("armed_again", [True, False])
def test_a_pause_of_an_on_board_log_while_disarmed_is_no_loggers_fault(*, armed_again: bool) -> None:
    flight = flown(CIRCLE)
    imu = flight.imu()
    middle = 0.5 * (imu.t[0] + imu.t[-1])
    heard = np.abs(imu.t - middle) > 4.0
    arms = [float(imu.t[0]), middle + 3.9] if armed_again else [float(imu.t[0])]
    events = tuple(Event(t, "armed", "armed") for t in arms)  # older firmware does not say that it was disarmed
    said = of_kind(
        assess(replace(flight, imus={"RAW_IMU": rows(imu, heard)}, events=events, on_board=True), GENERIC),
        "samples_missing",
    )
    assert said.evidence.startswith(
        "RAW_IMU has 1 pause while disarmed, 8." if armed_again else "RAW_IMU has 1 gap, 8."
    )
    assert said.severity == ("info" if armed_again else "warning")
    assert ("could not keep up" in said.advice) != armed_again


def test_a_gap_of_the_link_is_no_loss_of_the_position() -> None:
    """Nothing is heard for 8 s: that says nothing about GPS or estimator. Without position alone, it does."""
    flight = flown(CIRCLE)
    position = flight.position
    assert position is not None
    imu = flight.imu()
    middle = 0.5 * (imu.t[0] + imu.t[-1])
    heard, known = (np.abs(t - middle) > 4.0 for t in (imu.t, position.t))
    placed = replace(
        position, t=position.t[known], position=position.position[known], velocity=position.velocity[known]
    )
    alone = assess(replace(flight, position=placed), GENERIC)
    assert "no position for 8" in of_kind(alone, "position_lost").evidence
    found = assess(replace(flight, imus={"RAW_IMU": rows(imu, heard)}, position=placed), GENERIC)
    assert "position_lost" not in [f.kind for f in found.verdict.findings]
    assert of_kind(found, "samples_missing")


def test_a_board_turned_by_any_angle() -> None:
    found = assess(mounted(flown(), 0.0, 0.0, 45.0), GENERIC)
    assert found.verdict.status == "imu_suspect"
    angle, about = of_kind(found, "axes_wrong").evidence.split("turned by ")[1].split("° about")
    assert float(angle) == pytest.approx(45, abs=1.5)
    assert "-1.0)" in about


@pytest.mark.parametrize(
    ("gyro", "accel", "said"),
    [
        (np.degrees(1.0), 1.0, ["gyro reads 57 times", "degrees, where radians are meant"]),
        (1.0, 1.0 / STANDARD_GRAVITY, ["accelerometer reads 0.10", "g, where m/s² are meant"]),
        (1e-3, 1e-3, ["gyro reads 0.0", "whole units, where thousandths are meant", "accelerometer reads 0.00"]),
        (3.75, 4.18, ["gyro reads 3.7", "accelerometer reads 4.", "as the counts of a converter would"]),
    ],
)
def test_readings_of_other_units_are_told_and_no_estimate_is_made_of_them(
    gyro: float, accel: float, said: list[str]
) -> None:
    """However the board is mounted, and though the heading is set while it stands."""
    flight = flown()
    imu, board = flight.imu(), quaternion.to_matrix(quaternion.exp(np.array([0.3, -0.8, 2.0])))
    wrong = with_imu(flight, gyro=gyro * imu.gyro @ board.T, accel=accel * imu.accel @ board.T)
    begin = flight.start
    set_late = turned(wrong, (flight.require_attitude().t < begin + 2.0)[:, None] * [0.0, 0.0, 2.0])
    found = assess(set_late, GENERIC)
    assert (found.verdict.status, found.best) == ("imu_suspect", None)
    told = [f for f in found.verdict.findings if f.severity == "error"]
    assert {f.kind for f in told} == {"units_wrong"}
    assert len(told) == (gyro != 1.0) + (accel != 1.0)
    for words in said:
        assert any(words in f.evidence for f in told)


@pytest.mark.parametrize("times", [0.0, 0.5, 1.6, 3.0])
def test_an_axis_that_reads_too_much_alone_is_not_of_other_units(times: float) -> None:
    flight = flown()
    imu = flight.imu()
    one = with_imu(flight, gyro=imu.gyro * [1.0, times, 1.0], accel=imu.accel * [times, 1.0, 1.0])
    assert "units_wrong" not in {f.kind for f in meaning_findings(one, compare(one))}


def test_a_vehicle_that_stands_tells_nothing_of_units() -> None:
    """Its estimate turns a little while it aligns, and the gyro's bias changes with it."""
    motion = motions.rest(seconds(14.0, 50))
    flight, slews = flight_of(motion), 4e-3 * np.exp(-(motion.t - motion.t[0]) / 5.0)
    about_down = [0.0, 0.0, 1.0]
    read = flight.imu().gyro + 0.4 * slews[:, None] / 5.0 * about_down
    standing = turned(with_imu(flight, gyro=read), -slews[:, None] * about_down)
    assert "units_wrong" not in {f.kind for f in meaning_findings(standing, compare(standing))}


def test_turns_that_are_all_read_about_one_axis_are_not_of_other_units() -> None:
    flight = flown()
    turning = np.linalg.norm(flight.imu().gyro, axis=1)
    one = with_imu(flight, gyro=turning[:, None] * [3.0, 0.0, 0.0])
    assert "units_wrong" not in {f.kind for f in meaning_findings(one, compare(one))}


def test_clocks_that_do_not_run_alike() -> None:
    flight = flown(lively(30.0))  # the longer it is, the more is tried to explain it
    imu = flight.imu()
    found = assess(with_imu(flight, t=10 + (imu.t - 10) * 1.006), GENERIC)
    assert found.verdict.status == "insufficient_data"
    assert of_kind(found, "clocks_diverge")


@pytest.mark.parametrize("late", [-0.03, 0.0, 0.05, 0.107])
def test_a_lag_is_measured_between_the_shifts_that_are_tried(late: float) -> None:
    flight = flown()
    found = lags(compare(with_imu(flight, t=flight.imu().t + late)))
    assert len(found) == 3
    assert [lag for *_, lag in found] == pytest.approx([late] * 3, abs=3e-3)


def test_a_step_of_the_heading_lies_between_the_two_samples_that_it_is_told_by() -> None:
    flight, jump = flown(), 35.0
    attitude = flight.require_attitude()
    stepped = turned(flight, np.radians(15.0) * (attitude.t > jump)[:, None] * [0.0, 0.0, 1.0])
    (found,) = jump_findings(compare(stepped), stepped)
    before, after = attitude.t[attitude.t <= jump][-1], attitude.t[attitude.t > jump][0]
    assert found.start_s == pytest.approx(before, abs=0.03)
    assert found.end_s == pytest.approx(after, abs=0.03)


def test_steps_of_the_heading_before_there_is_a_position_are_told_once() -> None:
    flight = flown()
    attitude, position = flight.require_attitude(), flight.position
    assert position is not None
    off = sum(sign * (attitude.t > at) for at, sign in ((12.0, -20.0), (14.0, 20.0), (17.0, -12.0), (40.0, 15.0)))
    stepped = turned(flight, np.radians(off)[:, None] * [0.0, 0.0, 1.0])
    late = position.t > 20.0
    later = replace(position, t=position.t[late], position=position.position[late], velocity=position.velocity[late])
    stepped = replace(stepped, position=later)
    early, flying = jump_findings(compare(stepped), stepped)
    assert (early.severity, flying.severity) == ("info", "error")
    assert "steps 3 times, by up to 20.0°" in early.evidence
    assert (round(early.start_s), round(early.end_s)) == (12, 17)


def test_uneven_samples_are_told() -> None:
    flight, rng = flown(CIRCLE), np.random.default_rng(4)
    imu = flight.imu()
    found = assess(with_imu(flight, t=imu.t + rng.uniform(-0.009, 0.009, len(imu))), GENERIC)
    assert "multiples of 20 ms" in of_kind(found, "samples_irregular").evidence


def vibration(level: float, clips: float) -> Series:
    t = seconds(50, 2)
    columns = ("x_mps2", "y_mps2", "z_mps2", "clips_0", "clips_1", "clips_2")
    values = np.column_stack([np.full((len(t), 3), level), np.where(t > 40, clips, 0.0), np.zeros((len(t), 2))])
    return Series(t, values, columns, "VIBRATION")


def test_the_vehicles_own_vibration_and_clip_counts() -> None:
    found = assess(flown(series={"vibration": vibration(40.0, 7.0)}), GENERIC)
    shaken, clipped = of_kind(found, "vibration"), of_kind(found, "clipping_counted")
    assert shaken.severity == "warning"
    assert "vibration 40 m/s² typical, 40 peak (limit 30), by VIBRATION" in shaken.evidence
    assert clipped.start_s == pytest.approx(40, abs=0.6)
    assert "7 readings" in clipped.evidence
    quiet = assess(flown(series={"vibration": vibration(3.0, 0.0)}), GENERIC)
    assert not {"vibration", "clipping_counted"} & {f.kind for f in quiet.verdict.findings}


def test_clips_are_counted_from_the_last_sample_before_them_to_the_first_with_all_of_them() -> None:
    counts = np.array([3.0, 3.0, 3.0, 5.0, 5.0, 9.0, 9.0])
    t = 10.0 + np.arange(7.0)
    (found,) = clip_counts(Series(t, counts[:, None], ("clips_0",), "VIBE"))
    assert found.readings == 6.0
    assert (found.start_s, found.end_s) == (t[counts == 3.0][-1], t[counts == 9.0][0])
    counts[4] = 2.0**30  # of a damaged message: more than an IMU reads within a second
    (damaged,) = clip_counts(Series(t, counts[:, None], ("clips_0",), "VIBE"))
    assert damaged == found


def test_an_axis_and_counts_that_the_vehicle_does_not_tell() -> None:
    told = vibration(40.0, 7.0)
    values = told.values.copy()
    values[:, 0] = np.nan
    values[told.t > 50, 3] = 2.0  # the counter began anew
    found = assess(flown(series={"vibration": replace(told, values=values)}), GENERIC)
    assert "x 0, y 40, z 40" in of_kind(found, "vibration").evidence
    assert "7 readings" in of_kind(found, "clipping_counted").evidence


def test_shocks_close_together_are_one_finding() -> None:
    flight = flown(motions.circle(seconds(30, 100), radius=25.0, speed=6.0, bank=0.15))
    imu = flight.imu()
    hit = np.arange(len(imu)) % 10 == 0
    found = assess(with_imu(flight, accel=np.where(hit[:, None], 160.0, imu.accel)), GENERIC)
    said = [f.evidence for f in found.verdict.findings if f.kind == "accel_clipping"]
    assert said == [f"{hit.sum()} samples of the accelerometer at the end of its range, 160.0 m/s²"]


def test_a_gyro_axis_that_does_not_turn_is_not_stuck() -> None:
    """In a circle roll does not turn: whole milli-units read zero for seconds, and the attitude's noise is no turn."""
    flight = flown(CIRCLE)
    imu, rng = flight.imu(), np.random.default_rng(3)
    quiet = imu.gyro.copy()
    quiet[:, 0] = np.where(np.arange(len(imu)) % 115 == 0, 1e-3, 0.0)
    noisy = turned(flight, rng.normal(0.0, 1e-3, (len(flight.require_attitude()), 3)))
    assert "stuck_axis" not in kinds(assess(with_imu(noisy, gyro=quiet), GENERIC))


def test_a_heading_that_swings_alone_sticks_no_gyro() -> None:
    """As with a compass that turns: the autopilot follows it, and only another gyro tells who is right."""
    flight = flown(motions.rest(seconds(40, 100)))
    imu, rng, swings = flight.imu(), np.random.default_rng(7), np.pi / 2
    read = np.round(imu.gyro + 2e-3 * rng.normal(size=imu.gyro.shape), 3)
    read[:, 2] = np.where(np.arange(len(imu)) % 115 == 0, 1e-3, 0.0)
    attitude = flight.require_attitude()
    swung = turned(flight, 0.5 * np.sin(swings * attitude.t)[:, None] * [0.0, 0.0, 1.0])
    alone = with_imu(swung, gyro=read, gyro_step=1e-3)
    assert not reading_faults(alone, compare(alone), GENERIC)
    for turns, stuck in ((0.0, set()), (1.0, {"gyro z"})):
        rate = turns * 0.5 * swings * np.cos(swings * imu.t)[:, None] * [0.0, 0.0, 1.0]
        other = replace(imu, source="SCALED_IMU2", instance=1, gyro=imu.gyro + rate)
        both = replace(alone, imus={**alone.imus, other.source: other})
        found = reading_faults(both, compare(both, imu=imu.source), GENERIC)
        assert {f.evidence[:6] for f in found if f.kind == "stuck_axis"} == stuck
    stepped = with_imu(both, gyro=read + 0.02 * (imu.t > imu.t[len(imu) // 2])[:, None] * [0.0, 0.0, 1.0])
    both = replace(stepped, imus={imu.source: stepped.imus[imu.source], "SCALED_IMU2": replace(other, gyro=imu.gyro)})
    assert not reading_faults(both, compare(both, imu=imu.source), GENERIC), "a bias sticks no axis"


def test_a_simulated_gyro_without_noise_is_not_stuck_where_nothing_turns() -> None:
    """A rover that turns on flat ground: roll and pitch rates are digits that flicker."""
    t = seconds(40, 50)
    rng = np.random.default_rng(4)
    flight = flown(motions.circle(t, radius=8.0, speed=3.0, bank=0.0))
    imu = flight.imu()
    clean = np.column_stack([1e-5 * rng.normal(size=(len(t), 2)), 0.4 + 0.05 * rng.normal(size=len(t))])
    clean[700:760, 0] = 3e-6 * rng.normal(size=60)
    assert "stuck_axis" not in kinds(assess(with_imu(flight, gyro=clean, gyro_step=0.0), GENERIC))
    lost = imu.gyro + 1e-2 * rng.normal(size=imu.gyro.shape)
    lost[700:800, 0] = 0.45 + 1e-5 * rng.normal(size=100)
    assert "stuck_axis" in kinds(assess(with_imu(flight, gyro=lost, gyro_step=0.0), GENERIC))


@pytest.mark.parametrize("yaws_on", [False, True])
def test_a_simulated_boat_that_halts_and_rolls_on_sticks_no_yaw(yaws_on: bool) -> None:
    """What a gyro without noise does not turn about it reads as evenly as what it has lost, while the others go on."""
    flight = flown(motions.rest(seconds(60, 50)))
    imu, attitude, rng = flight.imu(), flight.require_attitude(), np.random.default_rng(3)
    halt = imu.t[0] + 45.0

    def angles(t: Array, swings: bool) -> Array:
        yaw = np.where((t < halt) | swings, np.sin(2.0 * (t - halt)), 0.0)
        return np.column_stack([0.2 * np.sin(t), 0.08 * np.cos(t), 0.3 * yaw])

    swaying = turned(flight, angles(attitude.t, yaws_on))
    rates = np.gradient(angles(imu.t, False), imu.t, axis=0)
    flickers = rates + 1e-5 * rng.normal(size=rates.shape)
    flickers[imu.t > halt, 2] += 2.5e-3
    found = reading_faults(flight, compare(with_imu(swaying, gyro=flickers, gyro_step=0.0)), GENERIC)
    assert ("stuck_axis" in {f.kind for f in found}) == yaws_on


@pytest.mark.parametrize("sensor", ["gyro", "accel"])
@pytest.mark.parametrize("step", [0.0, 1e-3])
def test_a_whole_sensor_that_stops_while_the_other_goes_on(sensor: str, step: float) -> None:
    """For longer than it went on: to read the same is then usual. The last digits of floats may flicker."""
    flight, truth = sensed(90.0)
    imu, rng = flight.imu(), np.random.default_rng(5)
    read = {"gyro": truth.gyro + 5e-3 * rng.normal(size=truth.gyro.shape)}
    read["accel"] = truth.accel + 0.05 * rng.normal(size=truth.accel.shape)
    first, last = len(imu) // 3, len(imu) - 100
    if step:
        read = {name: np.round(values, 3) for name, values in read.items()}
    steps = {"gyro_step": step, "accel_step": step}
    going = with_imu(flight, **read, **steps)
    assert not reading_faults(going, compare(going), GENERIC)
    flicker = (0.0 if step else 1e-7) * rng.normal(size=(last + 1 - first, 3))
    read[sensor][first : last + 1] = read[sensor][first] * (1.0 + flicker)
    stopped = with_imu(flight, **read, **steps)
    found = reading_faults(stopped, compare(stopped), GENERIC)
    assert [f.kind for f in found] == ["stuck_axis"]
    assert found[0].evidence.startswith(f"{sensor} reads (")
    assert found[0].cause is not None
    assert (found[0].cause.sensor, found[0].cause.axis) == (sensor, "")
    assert (found[0].start_s, found[0].end_s) == pytest.approx((imu.t[first], imu.t[last]), abs=0.011)


def test_a_whole_gyro_that_reads_zero_at_rest_is_not_stuck() -> None:
    flight = flown(motions.rest(seconds(40, 100)))
    imu, rng = flight.imu(), np.random.default_rng(6)
    accel = imu.accel + 0.05 * rng.normal(size=imu.accel.shape)
    gyro = np.where(np.arange(len(imu))[:, None] % 115 == 0, 1e-3, 0.0 * imu.gyro)
    bench = with_imu(flight, gyro=gyro, accel=accel, gyro_step=1e-3)
    assert not reading_faults(bench, compare(bench), GENERIC)


@pytest.mark.parametrize("moves", [False, True])
def test_two_accelerometers_at_rest_whose_biases_step_are_not_stuck(moves: bool) -> None:
    """Readings in whole steps, without noise; one is stuck where the other feels that the vehicle is moved."""
    flight = flown(motions.rest(seconds(60, 50)))
    imu, rng = flight.imu(), np.random.default_rng(7)
    later = imu.t > imu.t[0] + 35.0

    def read(bias: list[float], moved: float) -> Array:
        rocks = moved * np.sin(imu.t - imu.t[0])[:, None] * [1.0, 1.0, 0.0]
        felt = np.array([0.0, 0.0, -STANDARD_GRAVITY]) + later[:, None] * (np.array(bias) + rocks)
        return np.asarray(np.round(felt, 2))

    gyro = np.round(5e-3 * rng.normal(size=imu.gyro.shape), 3)
    own = replace(imu, gyro=gyro, accel=read([0.15, -0.1, 0.2], 0.0), accel_step=0.01, gyro_step=1e-3)
    other = replace(own, source="SCALED_IMU2", instance=1, accel=read([0.04, 0.04, -0.1], 0.3 * moves))
    both = replace(flight, imus={own.source: own, other.source: other})
    found = reading_faults(both, compare(both, imu=own.source), GENERIC)
    assert [f.evidence[:5] for f in found if f.kind == "stuck_axis"] == ["accel"] * moves


def test_the_scale_of_a_gyro_in_a_turn_that_goes_on_is_no_bias() -> None:
    flight = flown(motions.spin(seconds(40, 50), (0.9, -1.2, 1.5)))
    imu = flight.imu()
    assert assess(with_imu(flight, gyro=1.004 * imu.gyro), GENERIC).verdict.status == "consistent"
    biased = assess(with_imu(flight, gyro=imu.gyro + [0.0, 0.08, 0.0]), GENERIC)
    assert biased.verdict.status in {"imu_suspect", "insufficient_data"}


def test_a_trim_is_no_false_bias_in_px4s_estimator() -> None:
    spiral = motions.circle(seconds(50, 50), radius=20.0, speed=12.0, bank=0.6, heave=4.0, frequency=0.2)
    flight = flown(spiral, vehicle=Vehicle(1, 1, "PX4", "QUADROTOR"))
    trim = quaternion.to_matrix(quaternion.exp(np.radians([0.0, 5.0, 0.0]))).T
    imu = flight.imu()
    scaled = replace(imu, gyro=imu.gyro @ trim.T, accel=imu.accel @ trim.T, source="SCALED_IMU")
    both = {"SCALED_IMU": scaled, "HIGHRES_IMU": replace(scaled, source="HIGHRES_IMU")}
    found = assess(replace(flight, imus=both), GENERIC)
    assert of_kind(found, "mounting").side == "data"
    assert "ekf_bias" not in [f.kind for f in found.verdict.findings]


def test_vibration_in_the_samples() -> None:
    flight = flown(motions.circle(seconds(30, 100), radius=25.0, speed=6.0, bank=0.15))
    imu = flight.imu()
    shake = 20.0 * np.sin(2 * np.pi * 33.0 * imu.t)[:, None] * [0.3, 0.3, 1.0]
    said = of_kind(assess(with_imu(flight, accel=imu.accel + shake), GENERIC), "vibration")
    assert said.evidence.startswith("vibration 14 m/s² typical")  # 20 / √2


def test_a_jump_is_told_with_what_the_vehicle_said() -> None:
    flight = flown()
    position = flight.position
    assert position
    moved = position.position + [30.0, 0, 0] * (position.t > 40)[:, None]
    t = seconds(50, 2)
    ratios = np.where(np.abs(t - 41) < 1, 3.5, 0.1)[:, None]
    found = assess(
        replace(
            flight,
            position=replace(position, position=moved),
            texts=(StatusText(41.0, 2, "EKF variance\x1b[31m"), StatusText(41.0, 6, "Mission: 3 WP")),
            events=(Event(41.5, "error", "EKF check: error 2"),),
            series={"estimator": Series(t, ratios, ("position_ratio",), "EKF_STATUS_REPORT")},
        ),
        GENERIC,
    )
    evidence = of_kind(found, "position_jump").evidence
    assert "'EKF variance[31m' at 41.0 s, 'EKF check: error 2' at 41.5 s" in evidence
    assert "EKF_STATUS_REPORT's position ratio reached 3.5" in evidence
    assert "Mission" not in evidence


@pytest.mark.parametrize(("at", "severity"), [(45.0, "error"), (54.6, "info")], ids=["in flight", "as it is disarmed"])
def test_a_jump_within_the_second_before_it_says_disarmed_is_not_judged(at: float, severity: str) -> None:
    flight = flown(events=(Event(10.0, "armed", "armed"), Event(55.0, "disarmed", "disarmed")))
    position = flight.position
    assert position is not None
    moved = position.position + [30.0, 0.0, 0.0] * (position.t > at)[:, None]
    found = assess(replace(flight, position=replace(position, position=moved)), GENERIC)
    assert of_kind(found, "position_jump").severity == severity


@pytest.mark.parametrize(
    ("name", "statuses", "kind"),
    [
        ("px4/px4_hover.tlog", {"consistent", "autopilot_suspect"}, None),
        ("px4/px4_hover_250hz.tlog", {"insufficient_data", "consistent"}, "gyro_noise"),
        ("px4/px4_square_lownoise.tlog", {"consistent"}, None),
        ("public/SemvdH__5g_drone_ROS2__src_mav.tlog", {"consistent"}, "samples_irregular"),
        ("public/jschall__magfit_scaling__test.tlog", {"insufficient_data"}, "rate_too_low"),
    ],
)
def test_recordings(name: str, statuses: set[str], kind: str | None) -> None:
    flight = c.open_log(shared(name))[0]
    found = c.examine(flight).assessment
    assert found.verdict.status in statuses
    assert not {"gyro_bias", "accel_bias"} & set(kinds(found))
    if kind:
        assert of_kind(found, kind)


@pytest.mark.parametrize("step", [0.0, 1e-3])
def test_an_axis_that_is_never_still_is_stuck_when_it_is(step: float) -> None:
    """In a steady hover nothing was to be read: the noise that every second shows has stopped."""
    flight = flown(motions.rest(seconds(40, 50)))
    imu, rng = flight.imu(), np.random.default_rng(6)
    noisy = imu.gyro + 5e-3 * rng.normal(size=imu.gyro.shape)
    shaken = imu.accel + 0.05 * rng.normal(size=imu.accel.shape)
    steps = step or 1e-9
    read = np.round(noisy / steps) * steps
    held = read.copy()
    held[700:760, 0] = held[700, 0]
    healthy = with_imu(flight, gyro=read, gyro_step=step, accel=shaken, accel_step=0.0)
    assert "stuck_axis" not in kinds(assess(healthy, GENERIC))
    wrong = with_imu(healthy, gyro=held)
    assert "stuck_axis" in kinds(assess(wrong, GENERIC))
    for last, stuck in ((700, False), (730, True)):  # when the motors stop
        found = stuck_findings(compare(wrong), wrong.imus.values(), armed=np.arange(len(imu)) < last)
        assert bool(list(found)) == stuck


def test_an_axis_that_stands_still_now_is_stuck() -> None:
    """The newest readings are newer than the newest attitude: live that is always so."""
    flight = flown()
    imu, attitude = flight.imu(), flight.require_attitude()
    held = imu.gyro + 5e-3 * np.random.default_rng(7).normal(size=imu.gyro.shape)
    held[-70:, 0] = held[-70, 0]
    heard = slice(0, int(np.searchsorted(attitude.t, imu.t[-1] - 0.1)))
    told = AttitudeTrack(attitude.t[heard], attitude.q_ned_frd[heard], attitude.rates[heard])
    flight = replace(flight, attitude=told)
    assert "stuck_axis" in kinds(assess(with_imu(flight, gyro=held), GENERIC))
    held[-70:-15, 0] += np.linspace(0.0, 0.1, 55)
    assert "stuck_axis" not in kinds(assess(with_imu(flight, gyro=held), GENERIC))


@pytest.mark.parametrize(("crashed", "told"), [(128.0, True), (88.0, False)])
def test_axes_are_told_of_what_was_flown_before_a_crash(crashed: float, told: bool) -> None:
    """A mirrored gyro makes an estimator tumble. Some seconds of flight are too few to tell."""
    flight = cut(read_recording(BUNDLED / "copter-demo-100hz.tlog").flights[0], 70.0, 140.0)
    words = StatusText(crashed, 2, "Crash: Disarming: AngErr=45>30, Accel=0.7<3.0")
    found = assess(
        with_imu(replace(flight, texts=(*flight.texts, words)), gyro=flight.imu().gyro * [-1.0, 1.0, 1.0]), GENERIC
    )
    assert ("axes_wrong" in kinds(found)) is told
    assert "control_lost" in kinds(found, "warning")


def test_without_gps_no_axes_are_read_otherwise() -> None:
    """Gravity and a compass fit many ways to read a gyro."""
    flight = cut(read_recording(BUNDLED / "copter-demo-100hz.tlog").flights[0], 70.0, 140.0)
    found = assess(with_imu(replace(flight, gps=()), gyro=flight.imu().gyro * [-1.0, 1.0, 1.0]), GENERIC)
    assert "axes_wrong" not in kinds(found)


@cache
def in_milliradians() -> Flight:
    """A gyro of so little noise that whole milliradians per second do not tell of it."""
    flight, truth = sensed(56.0, rate=50.0)
    quiet = np.round(truth.gyro + 2e-4 * np.random.default_rng(1).standard_normal(truth.gyro.shape), 3)
    return with_imu(flight, gyro=quiet, gyro_step=1e-3)


def test_a_gyro_that_tells_no_noise_is_not_stuck() -> None:
    assert "stuck_axis" not in kinds(assess(in_milliradians(), GENERIC))


@pytest.mark.parametrize("goes", [0.03, 0.0])
def test_an_axis_without_noise_that_goes_somewhere_beside_others_that_shake_is_not_stuck(goes: float) -> None:
    """A simulated gyro whose yaw dies out, while a controller oscillates about the other axes."""
    flight = flown(lively(40.0))
    imu = flight.imu()
    shaken, quiet = imu.gyro.copy(), (imu.t >= 30.0) & (imu.t < 36.0)
    shaken[:, :2] += 1.5 * np.column_stack([np.sin(90.0 * imu.t), np.cos(90.0 * imu.t)])
    shaken[quiet, 2] = 0.02 + goes * np.exp(-(imu.t[quiet] - 30.0))
    found = reading_faults(flight, compare(with_imu(flight, gyro=shaken, gyro_step=0.0)), GENERIC)
    assert ("stuck_axis" in {f.kind for f in found}) == (goes == 0.0)


def test_an_axis_that_misses_what_all_other_sensors_saw_is_stuck() -> None:
    """It reads one value in the time of a quick manoeuvre; the others may be calm."""
    flight, begin = in_milliradians(), 22.0
    imu = flight.imu()
    during, held = (imu.t >= begin) & (imu.t < begin + 16.0), imu.gyro.copy()
    held[during, 1] = held[np.argmax(during), 1]
    found = assess(with_imu(flight, gyro=held), GENERIC)
    assert found.verdict.status == "imu_suspect"
    said = of_kind(found, "stuck_axis")
    assert said.evidence.startswith("gyro y")
    assert (said.start_s, said.end_s) == pytest.approx((begin, begin + 16.0), abs=2.5)


def test_a_healthy_gyro_is_not_stuck_where_iron_turns_the_compass() -> None:
    """The gyro rightly reads 0 for 3 s, in which the field turns about the same axis by 20° and back."""
    flight = in_milliradians()
    compass = flight.compasses[0]
    along = np.clip((compass.t - 16.8) / 2.5, 0.0, 1.0)
    by_iron = np.radians(20.0) * np.sin(np.pi * along)[:, None] * [0.0, 0.0, 1.0]
    iron = replace(compass, field=quaternion.rotate(quaternion.exp(by_iron), compass.field))
    found = assess(replace(flight, compasses=(iron,)), GENERIC)
    assert found.verdict.status != "imu_suspect"
    assert "stuck_axis" not in kinds(found)


@pytest.mark.parametrize("without", [{"compasses": ()}, {"gps": ()}])
def test_one_aiding_sensor_alone_calls_no_gyro_stuck(without: Any) -> None:
    """What the gyro missed is true here, but the one sensor that says so may be wrong itself."""
    flight = in_milliradians()
    held, during = flight.imu().gyro.copy(), (flight.imu().t >= 22.0) & (flight.imu().t < 38.0)
    held[during, 1] = held[np.argmax(during), 1]
    assert "stuck_axis" not in kinds(assess(replace(with_imu(flight, gyro=held), **without), GENERIC))


@pytest.mark.parametrize("stands", [True, False])
def test_the_gyro_of_another_imu_tells_whether_one_missed_a_turn(stands: bool) -> None:
    flight = in_milliradians()
    imu = flight.imu()
    held, during = imu.gyro.copy(), (imu.t >= 22.0) & (imu.t < 38.0)
    held[during, 1] = held[np.argmax(during), 1]
    other = replace(imu, source="SCALED_IMU2", instance=1, gyro=held if stands else imu.gyro)
    spoilt = with_imu(flight, gyro=held)
    found = assess(replace(spoilt, imus={**spoilt.imus, other.source: other}), GENERIC, imu=imu.source)
    if stands:
        assert "stuck_axis" not in kinds(found)
        return
    cause = found.verdict.cause
    assert found.verdict.status == "imu_suspect"
    assert cause is not None
    assert (cause.sensor, cause.axis) == ("gyro", "y")


@pytest.mark.parametrize("wobbles", [True, False])
def test_an_axis_that_another_imu_says_is_never_so_still_is_stuck(wobbles: bool) -> None:
    """A hover that turns by a few steps, or not at all: then both IMUs read the same throughout."""
    flight = flown(motions.rest(seconds(90, 100)))
    imu, rng = flight.imu(), np.random.default_rng(11)
    turns = 2e-3 * np.sin(2.0 * imu.t)[:, None] * [float(wobbles), 1.0, 0.0]

    def read(noise: float) -> Array:
        shaken = turns + noise * rng.normal(size=turns.shape) * [float(wobbles), 1.0, 0.0]
        return np.round(shaken, 3)

    held, during = read(3e-4), (imu.t >= imu.t[0] + 40.0) & (imu.t < imu.t[0] + 60.0)
    other = replace(imu, source="SCALED_IMU2", instance=1, gyro=read(5e-4), gyro_step=1e-3)
    for stuck in (False, True):
        held[during & stuck, 0] = -1e-3 * wobbles
        one = with_imu(flight, gyro=held, gyro_step=1e-3)
        both = replace(one, imus={**one.imus, other.source: other})
        found = reading_faults(both, compare(both, imu=imu.source), GENERIC)
        assert [f.evidence[:6] for f in found] == ["gyro x"] * (stuck and wobbles)
    whole = np.where(during[:, None], held[during][0], held)  # which is another finding
    both = replace(both, imus={**both.imus, imu.source: replace(one.imu(), gyro=whole)})
    faults = reading_faults(both, compare(both, imu=imu.source), GENERIC)
    assert not [f for f in faults if f.evidence.startswith(("gyro x", "gyro y"))]


def test_a_quiet_imu_on_the_ground_beside_one_that_is_noisier_is_not_stuck() -> None:
    """The noise of the other, of some steps even in means, is no motion."""
    flight = flown(motions.rest(seconds(90, 25)))
    imu, rng = flight.imu(), np.random.default_rng(13)
    flies = (imu.t > imu.t[0] + 40.0)[:, None]
    shakes = np.sin(2.0 * imu.t)[:, None] * [2.0, 0.3, 1.0] * flies

    def read(noise: float) -> Array:
        return np.asarray(np.round((shakes + [0.0, 0.0, -9.81] + noise * rng.normal(size=shakes.shape)) / 0.01) * 0.01)

    one = with_imu(flight, accel=read(1e-3), accel_step=0.01, gyro=imu.gyro + 0.1 * shakes)
    other = replace(imu, source="SCALED_IMU2", instance=1, accel=read(0.02), accel_step=0.01)
    both = replace(one, imus={**one.imus, other.source: other})
    assert not list(stuck_findings(compare(both, imu=imu.source), both.imus.values()))


def test_an_axis_in_the_middle_of_a_step_is_not_stuck() -> None:
    """Noise of less than a step: whether it shows depends on where in a step the bias stands, of either IMU."""
    flight = flown(motions.rest(seconds(90, 100)))
    imu, rng = flight.imu(), np.random.default_rng(12)
    still = np.abs(imu.t - imu.t[0] - 50.0) < 10.0

    def read(bias: Array) -> Array:
        return np.round(bias[:, None] * [1.0, 0.0, 0.0] + 1e-4 * rng.normal(size=(len(imu), 3)) * [1.0, 5.0, 1.0], 3)

    one = with_imu(flight, gyro=read(np.where(still, 0.0, 5e-4)), gyro_step=1e-3)
    other = replace(imu, source="SCALED_IMU2", instance=1, gyro=read(np.full(len(imu), 5e-4)), gyro_step=1e-3)
    both = replace(one, imus={**one.imus, other.source: other})
    assert not reading_faults(both, compare(both, imu=imu.source), GENERIC)


def test_an_axis_that_is_quiet_on_the_ground_is_not_stuck_while_the_heading_is_aligned() -> None:
    """A simulated aeroplane that rolls to a stop: its accelerometer has no noise, and its heading steps once."""
    flight = flown(motions.rest(seconds(40, 50)))
    imu, attitude = flight.imu(), flight.require_attitude()
    rng = np.random.default_rng(2)
    shaken = np.where((imu.t > 26.0)[:, None], 2.0 * rng.standard_normal(imu.accel.shape), 0.0)
    slowing = np.outer(np.exp(-(imu.t - imu.t[0]) / 2.0), [2.0, 0.0, 0.0])
    still = np.array([0.0, 0.0, -STANDARD_GRAVITY]) + [3e-2, 3e-2, 6e-4] * rng.standard_normal(imu.accel.shape)
    aligned = np.where(attitude.t > imu.t[0] + 3.0, 0.25, 0.0)[:, None] * [0.0, 0.0, 1.0]
    made = turned(with_imu(flight, accel=still + slowing + shaken, accel_step=0.0), aligned)
    assert "stuck_axis" not in [f.kind for f in reading_faults(made, compare(made), GENERIC)]


@pytest.mark.parametrize("on_board", [False, True])
def test_an_imu_without_the_estimators_biases_is_no_independent_sensor(on_board: bool) -> None:
    """On a link another message has them; an on-board log has nothing else where it has no better track."""
    flight = c.open_log(BUNDLED / "copter-demo-100hz.tlog")[0]
    freed = replace(flight, imus={"RAW_IMU": replace(flight.imu(), bias_removed=True)}, on_board=on_board)
    comparison = compare(freed)
    told = {f.kind for f in findings(freed, comparison, None, GENERIC, NO_NOISE, ReferenceSpec(), (), None)[0]}
    assert ("not_independent" in told) != on_board


NO_NOISE = FlightDensity(None, None)
CRASHED = StatusText(45.0, 2, "Crash: Disarming: AngErr=45>30, Accel=0.7<3.0")
RANGE = np.radians(250.0)  # of a gyro, rad/s


def tumbling(t: Array) -> Array:
    """(N, 3) rates of a vehicle that has crashed at 45 s."""
    return np.where(t > 45.0, 7.0 * np.sin(9.0 * (t - 45.0)), 0.0)[:, None] * [1.0, -0.9, 0.2]


def test_a_gyro_at_its_end_after_control_was_lost_is_a_consequence() -> None:
    """The noise is on top, and the end is reached within some samples: a range that no data sheet states."""
    flight = flown(motions.circle(seconds(40, 250)), texts=(CRASHED,))
    imu = flight.imu()
    noise = 5e-3 * np.random.default_rng(1).normal(size=imu.gyro.shape)
    gyro = np.clip(imu.gyro + tumbling(imu.t), -RANGE, RANGE) + noise
    found = assess(with_imu(flight, gyro=gyro), GENERIC)
    said = of_kind(found, "gyro_clipping")
    assert (said.severity, said.cause) == ("warning", None)
    assert 45.0 < said.start_s < 45.5
    assert found.verdict.status == "insufficient_data"
    assert (
        "4.4 rad/s), which misleads the autopilot too. No sensor fault was found before that" in found.verdict.summary
    )
    slow = assess(with_imu(flight, gyro=imu.gyro + 0.5 * tumbling(imu.t) + noise), GENERIC)
    assert "control_lost" in kinds(slow, "warning")
    assert "gyro_clipping" not in kinds(slow, "warning")


@pytest.mark.parametrize("rate_hz", [50, 250, 1000])
def test_a_rate_that_a_vehicle_keeps_is_no_end_of_a_range(rate_hz: int) -> None:
    """A trapezoid of 40 rad/s² behind the lag of motors, without noise; and a round top, a parabola."""
    flight = flown(motions.circle(seconds(30, rate_hz)))
    imu = flight.imu()
    past = imu.t - 20.0
    shape = np.clip(40.0 * np.minimum(past, 1.5 - past), 0.0, 3.0)
    lagged = np.zeros(len(shape))
    for i in range(1, len(shape)):
        lagged[i] = lagged[i - 1] + (shape[i] - lagged[i - 1]) / (0.03 * rate_hz + 1.0)
    top = 3.1 * np.maximum(1.0 - (past - 4.0) ** 2 / 0.05, 0.0)
    gyro = imu.gyro + (lagged + top)[:, None] * [1.0, 0.0, 0.0]
    assert not clipped(flight, gyro)
    assert clipped(flight, np.minimum(gyro, 2.5))


def clipped(flight: Flight, gyro: Array) -> list[Finding]:
    compared = compare(flight, track=with_imu(flight, gyro=gyro).imu())
    return [f for f in reading_faults(flight, compared, GENERIC) if f.kind == "gyro_clipping"]


@pytest.mark.parametrize("times", [1, 2])
def test_a_short_top_below_what_is_strong_is_a_range_where_another_ends_at_its_level(times: int) -> None:
    """A vehicle that swerves: a peak of the motion is flat within a step of the readings."""
    flight = flown(motions.circle(seconds(30, 50)))
    imu = flight.imu()
    samples = np.abs(np.arange(len(imu))[:, None] - [500, 1000][:times]).min(axis=1)
    swerve = np.maximum(2.0 - 0.05 * np.maximum(samples - 2, 0), np.sin(11.0 * imu.t) - 3.0)
    accel = np.column_stack([imu.accel[:, 0], np.round(swerve, 2), imu.accel[:, 2]])
    swerving = with_imu(flight, accel=accel, accel_step=0.01)
    found = reading_faults(flight, compare(flight, track=swerving.imu()), GENERIC)
    assert ("accel_clipping" in {f.kind for f in found}) == (times == 2)


def test_a_turn_that_changes_every_reading_is_no_noise() -> None:
    """Of whole steps: an axis that swings and then rests is in order, one that is noisy and then rests is stuck."""
    t = np.arange(0.0, 40.0, 0.01)
    swing, noise = np.trunc(200.0 * np.sin(4.0 * t)), np.random.default_rng(4).normal(0.0, 4.0, len(t))
    assert not turns_back(np.diff(swing), 100.0)
    assert turns_back(np.diff(np.trunc(noise)), 100.0)
    assert turns_back(np.diff(np.trunc(200.0 * np.sin(t) + noise)), 100.0)
    yaws = np.where(t % 3.0 < 1.0, 3000.0 * (t % 3.0), 0.0)  # at each corner, by far more than the noise
    assert turns_back(np.diff(np.trunc(yaws + noise)), 100.0)
    assert not turns_back(np.diff(np.trunc(yaws)), 100.0)


@pytest.mark.parametrize("dead", [True, False])
def test_a_gyro_that_is_dead_on_an_imu_that_was_not_judged_is_named(*, dead: bool) -> None:
    """A simulator without noise, whose accelerometer mostly reads the same whole steps: the other gyro tells."""
    flight = flown(lively(60.0))
    imu = flight.imu()
    gyro, accel = np.round(imu.gyro, 3), imu.accel * [0.0, 0.0, 1.0]
    stopped = np.where((imu.t > 30.0)[:, None] & dead, gyro[np.argmax(imu.t > 30.0)], gyro)
    first = replace(imu, source="RAW_IMU", gyro=stopped, gyro_step=1e-3, accel=accel)
    second = replace(imu, source="HIGHRES_IMU", instance=1, gyro_step=0.0, accel_step=0.0)
    found = assess(replace(flight, imus={"HIGHRES_IMU": second, "RAW_IMU": first}), GENERIC, imu="HIGHRES_IMU")
    said = [f for f in found.verdict.findings if f.kind == "stuck_axis"]
    assert [f.evidence.startswith("RAW_IMU: gyro reads") for f in said] == [True] * dead
    assert all(f.start_s == pytest.approx(30.0, abs=0.1) for f in said)
    assert found.best is not None
    assert not any("gaps in HIGHRES_IMU" in note for note in found.best.notes)


def test_a_gyro_whose_finer_message_goes_on_is_not_stuck_though_another_imu_steps() -> None:
    """What turns by less than a whole step reads zero; another gyro whose bias steps meanwhile did not turn."""
    flight = flown(lively(60.0))
    imu = flight.imu()
    calm, late = (imu.t > 30.0) & (imu.t < 31.3), imu.t > 30.65
    gyro, accel = imu.gyro.copy(), imu.accel * [0.0, 0.0, 1.0]
    gyro[calm, 2] = 5e-4 * np.sin(9.0 * imu.t[calm])
    finer = replace(imu, source="HIGHRES_IMU", gyro=gyro, gyro_step=0.0, accel_step=0.0)
    coarse = replace(imu, source="RAW_IMU", gyro=np.trunc(1e3 * gyro) / 1e3, gyro_step=1e-3, accel=accel)
    other = np.trunc(1e3 * (gyro - late[:, None] * [0.0, 0.0, 0.026])) / 1e3
    second = replace(coarse, source="SCALED_IMU2", instance=1, gyro=other)
    imus = {one.source: one for one in (finer, coarse, second)}
    found = assess(replace(flight, imus=imus), GENERIC, imu="HIGHRES_IMU")
    assert "stuck_axis" not in {f.kind for f in found.verdict.findings}
    assert found.verdict.cause is not None
    assert (found.verdict.cause.kind, found.verdict.cause.imu) == ("gyro_bias", 1)


@pytest.mark.parametrize("kind", ["frozen", "gyro_noise"])
def test_an_imu_that_was_not_judged_is_named_with_what_it_reads(kind: str) -> None:
    flight = flown()
    own = flight.imu()
    t, noise = own.t, np.random.default_rng(2).standard_normal(own.gyro.shape)
    gyro, accel = own.gyro + 1e-4 * noise, own.accel + 1e-3 * noise
    if kind == "frozen":
        gyro, accel = (np.where((t > 35.0)[:, None], one[np.argmax(t > 35.0)], one) for one in (gyro, accel))
    else:
        gyro = gyro + 0.05 * noise * [0.0, 1.0, 0.0] * ((t > 35.0) & (t < 45.0))[:, None]
    other = replace(own, gyro=gyro, accel=accel, source="SCALED_IMU2", instance=1)
    verdict = assess(replace(flight, imus={**flight.imus, other.source: other}), GENERIC).verdict
    assert verdict.status == "imu_suspect"
    assert verdict.cause is not None
    assert (verdict.cause.kind, verdict.cause.imu) == (kind, 1)


@pytest.mark.parametrize("begin", [0.0, 35.0])
def test_an_imu_that_was_not_judged_and_stops_is_not_called_biased(begin: float) -> None:
    """It reads whatever it did then, which differs from what the others read as a bias and a scale do."""
    flight = flown()
    other = replace(simulate(LIVELY.imu, GOOD, 7), source="SCALED_IMU2", instance=1)
    stopped = (other.t >= begin)[:, None]
    gyro, accel = (np.where(stopped, read[np.argmax(stopped)], read) for read in (other.gyro, other.accel))
    other = replace(other, gyro=gyro, accel=accel)
    found = assess(replace(flight, imus={**flight.imus, other.source: other}), GENERIC)
    assert {f.kind for f in found.verdict.findings if f.severity == "error"} == {"frozen"}
    assert found.verdict.cause is not None
    assert (found.verdict.cause.kind, found.verdict.cause.imu) == ("frozen", 1)


@pytest.mark.parametrize("motion", [LIVELY, motions.rest(seconds(50, 50))], ids=["lively", "hover"])
def test_an_accelerometer_that_never_feels_its_weight_is_stuck_whatever_else_there_is(motion: Motion) -> None:
    flight = flown(motion)
    dead = with_imu(flight, accel=np.zeros((len(flight.imu()), 3)))
    for one in (dead, replace(without_aiding(dead), position=None)):
        found = assess(one, GENERIC)
        assert kinds(found) == ["stuck_axis"]
        assert of_kind(found, "stuck_axis").evidence.startswith("accel reads (0, 0, 0) m/s² for 50.0 s while the gyro")
    held = with_imu(flight, accel=np.tile([0.0, 0.0, -STANDARD_GRAVITY], (len(flight.imu()), 1)))
    assert "stuck_axis" not in kinds(assess(held, GENERIC)), "as a calm hover may read"


@pytest.mark.parametrize("times", [-1.0, 1.0])
def test_an_accelerometer_that_feels_its_weight_upside_down_does_not_agree_with_an_attitude(times: float) -> None:
    """The turns agree, and nothing has a velocity to compare."""
    flight = replace(flown(), gps=(), position=None)
    turned_over = with_imu(flight, accel=times * flight.imu().accel)
    for one in (turned_over, without_aiding(turned_over)):
        found = assess(one, GENERIC)
        assert found.verdict.status == ("consistent" if times > 0.0 else "insufficient_data")
        assert ("the accelerometer feels -1.0" in found.verdict.summary) == (times < 0.0)
