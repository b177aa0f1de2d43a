"""Which of the two is wrong: on simulated faults, and on recordings whose faults are known."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import companion as c
from benchmarks.accuracy.answer import answer
from benchmarks.accuracy.labels import load_labels, outcome
from companion.app.sensors import load_imu_spec
from companion.comparison import GENERIC, PARTS
from companion.comparison.windows import compare
from companion.estimation import probabilities
from companion.model import Array, CompassTrack, Flight, GpsTrack, MessageStats, Series, rows
from companion.simulate.true_flight import square
from companion.strapdown import ImuModel, Motion, Sensor, motions, quaternion, simulate
from companion.verdict import Assessment, Finding, assess
from companion.verdict.findings.detect import reading_faults
from companion.verdict.findings.readings import reading_findings
from tests.estimation.sensed import sensed
from tests.flights import (
    CIRCLE,
    LIVELY,
    drifting,
    flight_of,
    flown,
    lively,
    moved_north,
    seconds,
    turned,
    with_imu,
    without_aiding,
)
from tests.recordings import BUNDLED, ROOT, recording, shared, whole

pytestmark = pytest.mark.slow

LABELS = ROOT / "benchmarks" / "accuracy" / "labels.toml"
LABELLED = (
    "ap_witness/clean_cruise.tlog.xz",
    "ap_witness/gyro1_z_15mrad.tlog.xz",
    "ap_witness/compass_rot_defaultcal.tlog.xz",
    "px4_faults/q_gps_creep.tlog.xz",
    "px4_faults/q_accel_step.tlog.xz",
)


def of_kind(found: Assessment, kind: str) -> Finding:
    kinds = [f.kind for f in found.verdict.findings]
    assert kind in kinds, f"found {kinds}"
    return found.verdict.findings[kinds.index(kind)]


def errors(found: Assessment) -> list[str]:
    return [f.kind for f in found.verdict.findings if f.severity == "error"]


def since(imu: c.ImuTrack, begin: float, end: float = np.inf) -> Array:
    return np.asarray((imu.t >= begin) & (imu.t < end), np.float64)[:, None]


def misread(flight: Flight, *, gyro: Any = 0.0, accel: Any = 0.0, begin: float = 35.0, end: float = np.inf) -> Flight:
    """The IMU reads too much for a while."""
    imu = flight.imu()
    during = since(imu, begin, end)
    return with_imu(flight, gyro=imu.gyro + during * np.array(gyro), accel=imu.accel + during * np.array(accel))


@pytest.mark.parametrize("motion", [LIVELY, CIRCLE], ids=["lively", "circle"])
def test_a_good_imu_and_a_good_autopilot_are_consistent(motion: Motion) -> None:
    found = assess(flown(motion), GENERIC)
    assert found.verdict.status == "consistent"
    assert not errors(found)


@pytest.mark.parametrize(
    ("motion", "kind", "size"),
    [
        (LIVELY, "gyro_bias", (0.0, 0.0, 0.015)),
        (CIRCLE, "gyro_bias", (0.0, -0.015, 0.0)),
        (LIVELY, "accel_bias", (0.6, 0.0, 0.0)),
    ],
)
def test_a_step_of_a_bias_is_the_imus_with_its_axis_size_and_time(
    motion: Motion, kind: str, size: tuple[float, float, float]
) -> None:
    wrong: dict[str, Any] = {"gyro": size} if kind == "gyro_bias" else {"accel": size}
    found = assess(misread(flown(motion), **wrong), GENERIC)
    assert found.verdict.status == "imu_suspect"
    assert errors(found) == [kind]
    axis = "xyz"[int(np.argmax(np.abs(size)))]
    assert f"{'gyro' if 'gyro' in kind else 'accelerometer'} {axis} bias" in found.verdict.summary
    assert found.best
    (step,) = (e for e in found.best.explained if e.kind == kind)
    spread = float(np.linalg.norm(step.sigma))
    np.testing.assert_allclose(step.size, size, atol=4 * spread)
    assert spread < 0.1 * np.linalg.norm(size)
    assert step.onset == pytest.approx(35.0, abs=max(0.5, 4 * step.onset_sigma))


def test_a_bias_that_goes_again_ends() -> None:
    finding = of_kind(assess(misread(flown(), accel=(3.0, 0.0, 0.0), begin=25, end=37), GENERIC), "accel_bias")
    assert finding.side == "imu"
    assert (finding.start_s, finding.end_s) == pytest.approx((25, 37), abs=1.0)


def test_a_gps_that_jumps_takes_the_autopilot_with_it() -> None:
    def glitch(t: Array) -> Array:
        return np.asarray(((t > 30) & (t < 45))[:, None] * [12.0, 0.0, 0.0])

    found = assess(flown(glitch=glitch, fixes_hz=5.0), GENERIC)
    assert found.verdict.status == "autopilot_suspect"
    finding = of_kind(found, "gps_position")
    assert (finding.start_s, finding.end_s) == pytest.approx((30, 45), abs=0.5)
    assert "the autopilot was misled by it: 11.9" in finding.evidence
    jumps = [f.start_s for f in found.verdict.findings if f.kind == "position_jump"]
    assert jumps == pytest.approx([30, 45], abs=0.1)


def test_a_gps_that_jumped_a_moment_ago_is_no_fault_of_the_imu() -> None:
    """As on a link: the newest second of it is all that there is."""
    since = float(flown().imu().t[-1]) - 0.9
    found = assess(flown(glitch=lambda t: (t > since)[:, None] * [40.0, 0.0, 0.0], fixes_hz=5.0), GENERIC)
    assert found.best
    assert [one.kind for one in found.best.explained] == ["gps_position"]
    assert found.best.explained[0].onset == pytest.approx(since, abs=0.4)
    assert not [f for f in found.verdict.findings if f.side == "imu" and f.severity == "error"]


def test_a_gps_that_creeps_takes_the_autopilot_with_it() -> None:
    def creep(t: Array) -> Array:
        return np.asarray(np.clip(t - 30, 0, 15)[:, None] * [1.0, 0.0, 0.0])

    found = assess(flown(glitch=creep), GENERIC)
    assert found.verdict.status == "autopilot_suspect"
    assert of_kind(found, "gps_position").start_s == pytest.approx(30, abs=3.0)
    assert not [f for f in found.verdict.findings if f.side == "imu" and f.severity == "error"]


def shifted(gps: GpsTrack) -> GpsTrack:
    """By 5 m, as receivers in order do."""
    return moved_north(gps, 5.0 * (gps.t > 30.0))


def swifter(gps: GpsTrack) -> GpsTrack:
    """By 0.8 m/s for a while: no fix stands out."""
    during = (gps.t > 30.0) & (gps.t < 45.0)
    return replace(gps, velocity=gps.velocity + during[:, None] * [0.6, 0.5, 0.0])


@pytest.mark.parametrize("bend", [shifted, swifter])
@pytest.mark.parametrize("fixes_hz", [1.0, 5.0])
def test_an_autopilot_that_does_not_follow_a_receiver_is_not_to_blame(
    bend: Callable[[GpsTrack], GpsTrack], fixes_hz: float
) -> None:
    flight = flown(fixes_hz=fixes_hz)
    found = assess(replace(flight, gps=tuple(bend(gps) for gps in flight.gps)), GENERIC)
    assert not errors(found)
    assert found.best
    if bend is swifter:
        assert [(one.kind, one.shape) for one in found.best.explained] == [("gps_velocity", "pulse")]


def turned_and_back(compass: CompassTrack) -> CompassTrack:
    """By 60°, from 30 to 42 s."""
    during = (compass.t > 30.0) & (compass.t < 42.0)
    turn = quaternion.exp(np.radians(60.0) * during[:, None] * [0.0, 0.0, 1.0])
    return replace(compass, field=quaternion.rotate(turn, compass.field))


def test_a_compass_that_turns_and_turns_back_accuses_no_imu() -> None:
    flight = flown(square(seconds(70, 50)), fixes_hz=5.0)
    found = assess(replace(flight, compasses=tuple(map(turned_and_back, flight.compasses))), GENERIC)
    assert not errors(found)
    assert found.best
    assert all(probabilities(one.rivals)["imu"] < 0.5 for one in found.best.explained)
    assert any(one.kind.startswith("compass") for one in found.best.explained)


def test_a_gyro_that_goes_wrong_on_a_circle_turns_no_imu_in_its_mounting() -> None:
    """The windows alone cannot tell it from an IMU that sits askew, by which an autopilot in order would lean."""
    flight = flown(motions.circle(seconds(60, 50), radius=40.0, speed=12.0, bank=0.35))
    imu = flight.imu()
    wrong = with_imu(flight, gyro=imu.gyro + (imu.t >= 24.0)[:, None] * [-0.0134, 0.0063, -0.009])
    found = assess(wrong, load_imu_spec("adis16470"))
    assert found.verdict.status == "imu_suspect"
    assert {"tilt_off", "mounting"}.isdisjoint(finding.kind for finding in found.verdict.findings)


def creeping(flight: Flight) -> Flight:
    """The autopilot's position creeps away, but for its velocity and its GPS."""
    position = flight.position
    assert position
    moved = position.position + 1.5 * np.clip(position.t - 30, 0, 15)[:, None] * [1.0, 0.0, 0.0]
    return replace(flight, position=replace(position, position=moved))


BENT: dict[str, tuple[Motion, str, Callable[[Flight], Flight]]] = {
    "tilt": (LIVELY, "tilt_off", lambda flight: drifting(flight, (1.0, 0.0, 0.0))),
    "heading": (LIVELY, "heading_off", lambda flight: drifting(flight, (0.0, 0.0, 1.6))),
    "tilt from the start": (CIRCLE, "tilt_off", lambda flight: turned(flight, np.radians([[0.0, 12.0, 0.0]]))),
    "heading from the start": (LIVELY, "heading_off", lambda flight: turned(flight, np.radians([[0.0, 0.0, -25.0]]))),
    "position": (CIRCLE, "position_off", creeping),
}


@pytest.mark.parametrize("name", BENT)
def test_an_estimate_that_leaves_its_sensors_is_the_autopilots(name: str) -> None:
    """The sensors agree with one another all the while."""
    motion, kind, bend = BENT[name]
    found = assess(bend(flown(motion)), GENERIC)
    assert found.verdict.status == "autopilot_suspect"
    finding = of_kind(found, kind)
    assert "the sensors, which agree with each other" in finding.evidence
    assert finding.start_s < (20.0 if "start" in name else 45.0)


def test_a_yaw_reset_is_the_autopilots() -> None:
    flight = flown()
    t = flight.require_attitude().t
    found = assess(turned(flight, np.radians(15.0) * (t > 35)[:, None] * [0.0, 0.0, 1.0]), GENERIC)
    assert found.verdict.status == "autopilot_suspect"
    assert of_kind(found, "heading_jump").start_s == pytest.approx(35, abs=0.3)
    assert errors(found) == ["heading_jump", "heading_off"]
    assert "imu_lag" not in [f.kind for f in found.verdict.findings]


def test_without_aiding_no_healthy_side_is_accused() -> None:
    """IMU and autopilot alone: it is one word against the other."""
    flight = without_aiding(flown())
    assert assess(flight, GENERIC).verdict.status == "consistent"
    assert assess(misread(flight, gyro=(0.0, 0.03, 0.0)), GENERIC).verdict.status == "insufficient_data"
    for axis in ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)):
        bent = assess(drifting(flight, axis, begin=25.0, lasts=30.0), GENERIC)
        assert bent.verdict.status == "insufficient_data"


@pytest.mark.parametrize(("metres", "status"), [(12.0, "insufficient_data"), (4.0, "consistent")])
def test_a_position_that_steps_without_gps_was_wrong_before_or_is_after(metres: float, status: str) -> None:
    """A reset accuses nobody; but one by more than healthy receivers differ by clears nobody either."""
    flight = without_aiding(flown())
    position = flight.position
    assert position is not None
    moved = position.position + metres * (position.t > 40.0)[:, None] * np.array([1.0, 0.0, 0.0])
    found = assess(replace(flight, position=replace(position, position=moved)), GENERIC)
    assert found.verdict.status == status
    assert of_kind(found, "position_jump").severity != "error"


def frozen_from(begin: float, readings: Array, t: Array) -> Array:
    held = readings.copy()
    held[t >= begin] = held[np.argmax(t >= begin)]
    return held


@pytest.mark.parametrize(("until", "status"), [(10.3, "insufficient_data"), (40.0, "consistent")])
def test_an_autopilot_that_falls_silent_is_not_cleared_by_the_sensors_alone(until: float, status: str) -> None:
    flight = flown()
    attitude = flight.require_attitude()
    silent = replace(flight, attitude=rows(attitude, attitude.t < until))
    assert assess(silent, GENERIC).verdict.status == status


def test_a_frozen_imu() -> None:
    flight = flown()
    imu = flight.imu()
    gyro, accel = (frozen_from(40, readings, imu.t) for readings in (imu.gyro, imu.accel))
    found = assess(with_imu(flight, gyro=gyro, accel=accel), GENERIC)
    assert found.verdict.status == "imu_suspect"
    assert found.verdict.probability["imu"] > 0.95
    assert sum(found.verdict.probability.values()) == pytest.approx(1.0)
    assert of_kind(found, "frozen").start_s == pytest.approx(40, abs=0.1)


def test_an_imu_at_rest_is_not_frozen_because_the_estimator_tilts() -> None:
    """A simulated one, of no noise, whose motors are off while the attitude is corrected by some degrees."""
    flight = flown()
    imu = flight.imu()
    gyro, accel = (frozen_from(40, readings, imu.t) for readings in (imu.gyro, imu.accel))
    disarmed = replace(
        with_imu(flight, gyro=gyro, accel=accel, gyro_step=0.0, accel_step=0.0),
        events=(c.model.Event(flight.start - 1.0, "armed", "armed"), c.model.Event(39.9, "disarmed", "disarmed")),
    )
    assert "frozen" not in [f.kind for f in assess(disarmed, GENERIC).verdict.findings]


def test_readings_from_before_the_estimator_has_aligned_are_not_judged() -> None:
    """A heading that is being set turns the attitude, and not the vehicle."""
    flight = flown(events=(c.model.Event(18.0, "armed", "armed"),))
    imu = flight.imu()
    begin = flight.start
    gyro, accel = (np.where((imu.t < begin + 3.0)[:, None], x[:1], x) for x in (imu.gyro, imu.accel))
    stuck = with_imu(flight, gyro=gyro, accel=accel)
    assert of_kind(assess(stuck, GENERIC), "frozen").severity == "error"
    flags = Series(np.array([begin, begin + 5.0]), np.array([[0.0], [831.0]]), ("flags",), "EKF_STATUS_REPORT")
    found = assess(replace(stuck, series={"estimator": flags}), GENERIC)
    assert "frozen" not in [f.kind for f in found.verdict.findings]


def test_a_stuck_axis() -> None:
    flight = flown(lively(30.0))
    imu = flight.imu()
    held = imu.gyro.copy()
    during = (imu.t >= 26) & (imu.t < 29)
    held[during, 1] = held[np.argmax(during), 1]
    found = assess(with_imu(flight, gyro=held), GENERIC)
    assert found.verdict.status == "imu_suspect"
    finding = of_kind(found, "stuck_axis")
    assert (finding.start_s, finding.end_s) == pytest.approx((26, 29), abs=0.1)
    assert finding.evidence.startswith("gyro y")


def test_an_axis_without_noise_is_stuck_whatever_is_corrected_and_lost_and_however_straight_the_flight() -> None:
    flight = flown(motions.rest(seconds(60, 100)))
    imu = flight.imu()
    noisy = imu.gyro + 2e-3 * np.random.default_rng(7).standard_normal(imu.gyro.shape)
    shaken = with_imu(flight, gyro=noisy, gyro_step=0.0)
    assert not [f for f in reading_faults(shaken, compare(shaken), GENERIC) if f.kind == "stuck_axis"]
    during = imu.t >= imu.t[0] + 30.0
    drifting = noisy.copy()
    drifting[during, 2] = 0.1 + 1e-7 * np.random.default_rng(8).standard_normal(during.sum()).cumsum()
    recorded = (imu.t < imu.t[0] + 40.0) | (imu.t > imu.t[0] + 40.3)
    kept = replace(shaken.imu(), t=imu.t[recorded], gyro=drifting[recorded], accel=imu.accel[recorded])
    stuck = replace(shaken, imus={"RAW_IMU": kept})
    kinds = [f for f in reading_faults(stuck, compare(stuck), GENERIC) if f.kind == "stuck_axis"]
    assert [f.evidence[:6] for f in kinds] == ["gyro z", "gyro z"]
    assert sum(f.end_s - f.start_s for f in kinds) == pytest.approx(29.7, abs=0.2)


def test_an_axis_that_stops_is_seen_at_a_ground_stations_rate() -> None:
    """Ten samples tell as little at 4 Hz as at 100: it takes longer to be sure."""
    flight = flown(motions.coning(seconds(75, 4), angle=0.2, frequency=0.2))
    imu = flight.imu()
    assert "stuck_axis" not in [f.kind for f in assess(flight, GENERIC).verdict.findings]
    held = imu.gyro.copy()
    held[imu.t >= 60, 1] = held[np.argmax(imu.t >= 60), 1]
    assert of_kind(assess(with_imu(flight, gyro=held), GENERIC), "stuck_axis").start_s == pytest.approx(60, abs=1.0)


def test_what_hides_between_samples_is_not_called_consistent() -> None:
    """A gyro that is off by ten times what harms, for some seconds of a flight at 4 Hz."""
    flight = flown(motions.coning(seconds(150, 4), angle=0.2, frequency=0.2))
    imu = flight.imu()
    off = imu.gyro + ((imu.t > 100.0) & (imu.t < 108.0))[:, None] * [0.0, 0.05, 0.0]
    found = assess(with_imu(flight, gyro=off), GENERIC)
    assert found.verdict.status in ("insufficient_data", "imu_suspect")
    assert of_kind(found, "gyro_bias")


def test_a_sensor_at_rest_is_not_frozen() -> None:
    """Whole milli-units read the same for ever at rest."""
    assert assess(flight_of(motions.rest(seconds(60, 100))), GENERIC).verdict.status == "consistent"


def test_no_axis_is_stuck_when_the_motors_stop_shaking_it() -> None:
    """Whole milliradians, noisy in every second of the flight: nothing is, once what is left of the motion dies out."""
    flight = flown()
    imu = flight.imu()
    noisy = imu.gyro + 4e-3 * np.random.default_rng(5).standard_normal(imu.gyro.shape)
    stopped, left = imu.t >= imu.t[-1] - 0.8, imu.t - (imu.t[-1] - 0.8)
    noisy[stopped] = np.exp(-left[stopped, None] / 0.1) * [-0.03, -0.15, 0.0] + [0.0, 0.0, 1e-3]
    quiet = with_imu(flight, gyro=np.round(noisy, 3), gyro_step=1e-3)
    assert "stuck_axis" not in [f.kind for f in reading_faults(quiet, compare(quiet), GENERIC)]
    noisy[stopped, :2] = imu.gyro[stopped, :2] + 4e-3 * np.random.default_rng(6).standard_normal((stopped.sum(), 2))
    stuck = with_imu(flight, gyro=np.round(noisy, 3), gyro_step=1e-3)
    (found,) = reading_faults(stuck, compare(stuck), GENERIC)
    assert (found.kind, found.evidence[:6]) == ("stuck_axis", "gyro z")


def test_an_estimator_that_corrects_its_tilt_at_rest_freezes_no_sensor() -> None:
    """It reads the same whole milli-units for ever, and the estimate turns by nine of them a second."""
    flight = with_imu(flight_of(motions.rest(seconds(60, 100))), gyro_step=1e-3)
    assert flight.attitude is not None
    leaning = np.radians(1.5) * np.clip((flight.attitude.t - flight.start - 30.0) / 3.0, 0.0, 1.0)
    tilted = quaternion.multiply(flight.attitude.q_ned_frd, quaternion.exp(leaning[:, None] * [1.0, 0.0, 0.0]))
    found = assess(replace(flight, attitude=replace(flight.attitude, q_ned_frd=tilted)), GENERIC)
    assert "frozen" not in [f.kind for f in found.verdict.findings]


@pytest.mark.parametrize(
    ("at", "lasted", "status", "severity"),
    [
        ([30], 0.1, "imu_suspect", "error"),
        ([30], 0.02, "consistent", "warning"),
        ([25, 30, 35], 0.02, "consistent", "warning"),
        ([21, 23, 25, 27, 29, 31, 33, 35, 37], 0.02, "imu_suspect", "error"),
    ],
    ids=["lasting", "a shock", "some shocks", "again and again"],
)
def test_clipping(at: list[int], lasted: float, status: str, severity: str) -> None:
    flight = flown()
    imu = flight.imu()
    hit = sum(since(imu, t, t + lasted) for t in at) > 0
    found = assess(with_imu(flight, accel=np.where(hit, 157.0, imu.accel)), GENERIC)
    said = of_kind(found, "accel_clipping")
    assert (found.verdict.status, said.severity) == (status, severity)
    assert said.start_s == pytest.approx(at[0], abs=0.05)


@pytest.mark.parametrize(("landed", "status"), [(None, "imu_suspect"), (38.0, "consistent")], ids=["aloft", "landed"])
def test_what_goes_wrong_after_the_landing_is_not_judged(landed: float | None, status: str) -> None:
    told = [c.model.Event(10.0, "armed", "armed")]
    if landed is not None:
        told.append(c.model.Event(landed, "disarmed", "disarmed"))
    spoilt = misread(flown(events=tuple(told)), gyro=[0.03, 0.0, 0.0], begin=42.0)
    assert assess(spoilt, GENERIC).verdict.status == status


@pytest.mark.parametrize(("later", "clipped"), [(25.0, True), (60.0, False)], ids=["never exceeded", "exceeded later"])
def test_a_level_that_the_axis_goes_beyond_is_no_end_of_its_range(later: float, clipped: bool) -> None:
    flight = flown()
    imu = flight.imu()
    accel = imu.accel.copy()
    accel[np.argmax(imu.t > 30.0) + np.arange(4), 0] = 30.0
    accel[np.argmax(imu.t > 40.0), 0] = later
    said = {f.kind for f in assess(with_imu(flight, accel=accel), GENERIC).verdict.findings}
    assert ("accel_clipping" in said) is clipped


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("step", [0.0, 1e-3])
@pytest.mark.parametrize("to_the_end", [True, False])
def test_a_range_may_end_at_any_level(sign: float, step: float, *, to_the_end: bool) -> None:
    """A gyro that reads no more than 0.3 rad/s on one side, in a turn that is faster for a while or to the end."""
    imu = flown().imu()
    rng = np.random.default_rng(3)
    turns = np.where((imu.t > 40.0) & (imu.t < (99.0 if to_the_end else 45.0)), 0.8, 0.1) * sign
    rate = np.clip(turns + 5e-3 * rng.standard_normal(len(imu.t)), -0.3, 0.3)
    gyro = np.column_stack([imu.gyro[:, 0], imu.gyro[:, 1], np.round(rate, 3) if step else rate])
    flight = with_imu(flown(), gyro=gyro, gyro_step=step)
    found = list(reading_findings(flight.imu(), flight.require_attitude(), GENERIC))
    assert [f.kind for f in found] == ["gyro_clipping"]
    assert found[0].start_s == pytest.approx(40.0, abs=0.1)
    assert found[0].end_s == pytest.approx(imu.t[-1] if to_the_end else 45.0, abs=0.1)


def test_a_rate_that_is_told_is_no_end_of_a_range() -> None:
    """A simulated gyro without noise in an even turn, that it comes to and leaves as a vehicle does."""
    imu = flown().imu()
    rate = 0.3 * (np.tanh((imu.t - 30.0) / 0.3) - np.tanh((imu.t - 40.0) / 0.3))
    flight = with_imu(flown(), gyro=np.column_stack([imu.gyro[:, :2], np.round(rate, 3)]), gyro_step=1e-3)
    assert not list(reading_findings(flight.imu(), flight.require_attitude(), GENERIC))


def test_a_board_mounted_the_wrong_way() -> None:
    """Turned by 90° about down: what is right reads as forward."""
    turn = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    flight = flown()
    imu = flight.imu()
    found = assess(with_imu(flight, gyro=imu.gyro @ turn.T, accel=imu.accel @ turn.T), GENERIC)
    assert found.verdict.status == "imu_suspect"
    assert "(-y, x, z)" in of_kind(found, "axes_wrong").evidence


def test_what_the_other_sensors_do_not_tell_is_not_known_at_four_hertz() -> None:
    flight = replace(flown(motions.coning(seconds(60, 4), angle=0.2, frequency=0.2)), gps=(), compasses=())
    found = assess(flight, GENERIC)
    assert found.verdict.status == "insufficient_data"
    assert of_kind(found, "rate_too_low")


@pytest.mark.parametrize(
    ("bias", "status"), [((0.0, 0.0, 0.0), "consistent"), ((0.0, 0.0, 0.06), "imu_suspect")], ids=["healthy", "gyro"]
)
def test_at_four_hertz_the_best_estimate_speaks_for_the_windows(bias: tuple[float, float, float], status: str) -> None:
    """GPS and compass tell of the gyro what no dead reckoning of such samples can."""
    flight, truth = sensed(150.0, "circle", rate=100.0)
    imu = flight.imu()
    off = np.where(imu.t[:, None] > 80.0, bias, (0.0, 0.0, 0.0))
    slow = replace(imu, gyro=imu.gyro + off)[::25]
    position = c.PositionTrack(truth.t[::10], truth.position[::10], truth.velocity[::10], "LOCAL_POSITION_NED")
    verdict = assess(replace(flight, imus={imu.source: slow}, position=position), GENERIC).verdict
    assert verdict.status == status
    assert ("a bias of the gyro of" in verdict.summary) == (status == "consistent")


def test_a_short_flight_is_too_little() -> None:
    assert assess(flown(motions.circle(seconds(9, 100))), GENERIC).verdict.status == "insufficient_data"


@pytest.mark.parametrize(("gyro", "severity"), [(4e-3, "info"), (2e-2, "warning")])
def test_a_noisy_sensor_is_called_noisy(gyro: float, severity: str) -> None:
    """And warned of where its noise, and no longer its bias, is most of what the IMU may be off by."""
    model = ImuModel(gyro=Sensor(noise_density=gyro), accel=Sensor(noise_density=0.05))
    noisy = replace(simulate(LIVELY.imu, model, 2), source="RAW_IMU")
    found = assess(replace(flown(), imus={"RAW_IMU": noisy}), GENERIC)
    assert of_kind(found, "gyro_noise").severity == severity
    assert re.match(r"noise of \d+ mdps/√Hz in flight, \d+ times the 6.88 of ", of_kind(found, "gyro_noise").evidence)
    assert re.match(r"noise of \d{4} µg/√Hz in flight, \d+ times the ", of_kind(found, "accel_noise").evidence)
    assert found.measured_noise.gyro == pytest.approx(gyro, rel=0.2)
    assert found.measured_noise.accel == pytest.approx(0.05, rel=0.2)


def test_every_finding_lies_in_the_flight_and_says_what_to_do() -> None:
    for name in ("copter-demo-100hz", "copter-hover-100hz", "copter-mission-default-rates"):
        flight = c.open_log(BUNDLED / f"{name}.tlog")[0]
        found = c.examine(flight).assessment
        for finding in found.verdict.findings:
            assert flight.start - 1 <= finding.start_s <= finding.end_s <= flight.start + flight.duration + 1
            assert finding.evidence
            assert finding.advice


@pytest.mark.parametrize(
    ("name", "status", "kinds"),
    [
        ("copter-demo-100hz", "consistent", {}),
        ("copter-hover-nodrift-100hz", "consistent", {}),
        ("copter-hover-100hz", "consistent", {}),
        ("copter-square-100hz", "consistent", {}),
        ("copter-mission-default-rates", "insufficient_data", {"rate_too_low": 2.5}),
        ("copter-biased-imu-100hz", "imu_suspect", {"gyro_bias": 57.3}),
        ("copter-imu1-fail-100hz", "imu_suspect", {"frozen": 88.8}),
        ("copter-gps-glitch-50hz", "autopilot_suspect", {"gps_position": 70.1, "position_jump": 80.2}),
        ("copter-reboot-midlog", "consistent", {}),
        ("two-vehicles", "consistent", {}),
        ("copter-signed", "consistent", {}),
        ("copter-mavlink1-50hz", "consistent", {}),
    ],
)
def test_recordings_with_known_faults(name: str, status: str, kinds: dict[str, float]) -> None:
    """A cut holds the faults; that there is none is said of a whole flight."""
    for flight in c.open_log((recording if kinds else whole)(f"sitl/{name}.tlog")):
        found = c.examine(flight).assessment
        assert found.verdict.status == status
        for kind, start in kinds.items():
            assert of_kind(found, kind).start_s == pytest.approx(start, abs=2.0)
        if not kinds:
            assert not errors(found)


@pytest.mark.parametrize("name", LABELLED)
def test_recordings_of_others_are_answered_as_they_are_labelled(name: str) -> None:
    """Independent simulators: the right side is named, or it is said that the log cannot tell."""
    (flight,) = c.open_log(shared(name))
    label = next(label for label in load_labels(LABELS) if label.matches(name))
    assert outcome(label, answer(flight)) in {"right", "cannot tell"}


def test_an_attitude_at_1_hz_accuses_no_healthy_autopilot() -> None:
    """Between two samples the vehicle turns by tens of degrees, which nothing but the IMU tells."""
    flight = c.open_log(BUNDLED / "copter-demo-100hz.tlog")[0]
    attitude = flight.require_attitude()
    kept = np.unique(np.searchsorted(attitude.t, np.arange(attitude.t[0], attitude.t[-1])))
    slow = c.AttitudeTrack(attitude.t[kept], attitude.q_ned_frd[kept], attitude.rates[kept], attitude.source)
    found = c.examine(replace(flight, attitude=slow)).assessment
    assert found.verdict.status == "consistent"
    assert not [f for f in found.verdict.findings if f.kind == "heading_jump"]


def test_an_accelerometer_that_is_off_by_more_than_one_in_order_is_named() -> None:
    """A scale of 4 % from the beginning on: windows of a second show it, and what shows it is not taken off."""
    flight = c.open_log(BUNDLED / "copter-demo-100hz.tlog")[0]
    found = assess(with_imu(flight, accel=1.04 * flight.imu().accel), GENERIC)
    assert found.verdict.status == "insufficient_data"
    assert of_kind(found, "accel_bias").evidence in found.verdict.summary
    assert max(found.agreements[horizon].inside["velocity"] for horizon in (1.0, 2.0, 5.0)) < 0.7


def test_calibration_of_the_biased_recording() -> None:
    """RAW_IMU shows (9.55, -14.48, 7.52) mrad/s: what was set, cut towards zero."""
    flight = c.open_log(recording("sitl/copter-biased-imu-100hz.tlog"))[0]
    found = c.examine(flight).assessment
    assert found.calibration
    assert found.calibration.values[:3] * 1e3 == pytest.approx([9.55, -14.48, 7.52], abs=0.5)
    assert not any(found.calibration.from_best), "what began in flight is no constant error"


def test_the_calibration_of_the_first_half_holds_in_the_second() -> None:
    """Of an IMU that is off all the time, by the autopilot and by the best estimate, which tells the bias."""
    flight = c.open_log(BUNDLED / "copter-demo-100hz.tlog")[0]
    imu = flight.imu()
    off = np.array([0.008, -0.011, 0.009])
    found = assess(with_imu(flight, gyro=imu.gyro + off), GENERIC)
    assert found.calibration
    assert found.calibration.observed_by_best("gyro_bias")
    np.testing.assert_allclose(found.calibration.values[:3], off, atol=1e-3)
    assert found.uncorrected
    assert found.corrected
    assert found.judged_by_best
    for before, after in ((found.uncorrected, found.corrected), found.judged_by_best):
        one, other = before.rows[0].position_m, after.rows[0].position_m
        assert one
        assert other
        assert other.median < one.median / 2
    assert not found.made_worse


def test_the_lag_of_ardupilots_filter_is_found() -> None:
    flight = c.open_log(recording("sitl/copter-square-100hz.tlog"))[0]
    found = c.examine(flight).assessment
    assert found.calibration
    assert found.calibration.values[PARTS["time_offset"]] == pytest.approx(0.012, abs=0.0015)


def test_a_link_of_px4() -> None:
    """HIGHRES_IMU beside SCALED_IMU; and a ground station's link, which has neither."""
    (flight,) = c.open_log(recording("px4/px4_square_lownoise.tlog"))
    assert flight.default_imu == "SCALED_IMU"
    assert c.examine(flight).assessment.verdict.status == "consistent"
    (bare,) = c.open_log(recording("px4/px4_gcs_default.tlog"))
    with pytest.raises(c.DataError, match="MAV_x_MODE 2"):
        c.examine(bare)


def test_agreement_without_gps_says_what_was_not_judged() -> None:
    seen, blind = (assess(flight, GENERIC).verdict for flight in (flown(), flown(gps=())))
    assert seen.status == blind.status == "consistent"
    assert "GPS" not in seen.summary
    assert blind.summary.endswith("No GPS data: the position could not be verified.")


@pytest.mark.parametrize(
    ("wrong", "quantity"), [({"gyro": (0.0, 0.0, 0.05)}, "attitude"), ({"accel": (0.0, 0.0, -1.0)}, "velocity")]
)
def test_what_is_off_in_the_last_quarter_of_a_flight_is_no_agreement(wrong: dict[str, Any], quantity: str) -> None:
    """No sensor tells which of the two it is; but three windows of four agree."""
    motion = motions.coning(seconds(110.0, 50.0), angle=0.08, frequency=0.07, amplitude=(4.0, 3.0, 1.0))
    alone = flown(motion, gps=(), compasses=(), barometers=())
    assert assess(alone, GENERIC).verdict.status == "consistent"
    found = assess(misread(alone, begin=92.0, **wrong), GENERIC).verdict
    assert found.status == "insufficient_data"
    assert f"differ in {quantity} by far more than expected from 90.0 to 120.0 s (6 windows of 5 s" in found.summary
    assert not found.probability, "of no fault least of all"


def test_a_vehicle_that_its_heartbeats_never_call_armed_rests() -> None:
    """At a ground station's rate, without GPS and compass: the gyro reads its bias, and gravity tells the tilt."""
    heard = {"HEARTBEAT": MessageStats(60, 1.0, 1.0, 0)}
    bench = flown(motions.rest(seconds(60.0, 4.0)), gps=(), compasses=(), events=(), messages=heard)
    assert assess(bench, GENERIC).verdict.status == "consistent"
    assert assess(replace(bench, messages={}), GENERIC).verdict.status == "insufficient_data", "motors may be running"
    off = assess(misread(bench, gyro=(0.0, 0.02, 0.0)), GENERIC).verdict
    assert (off.status, off.cause and off.cause.kind) == ("imu_suspect", "gyro_bias")


@pytest.mark.parametrize(("rate", "told"), [(0.01, False), (0.02, False), (0.05, True), (0.1, True)])
def test_a_gyro_that_turns_in_a_hover_on_one_heading_accuses_no_autopilot(rate: float, told: bool) -> None:
    """A field that turns as fast the other way fits worse, and so does iron that stands for all of it that is level."""
    t = seconds(100.0, 50.0)
    hover = motions.coning(t, angle=0.02, frequency=0.2, amplitude=(0.3, 0.3, 0.1), swing=(0.05, 0.07, 0.03))
    found = assess(misread(flown(hover), gyro=(0.0, 0.0, rate), begin=60.0), GENERIC)
    assert found.verdict.status == ("imu_suspect" if told else "insufficient_data")
