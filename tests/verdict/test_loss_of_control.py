"""A flight that falls in the middle and flies on: what lies before and after is judged, not what lies between."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.accuracy.cutting import thinned
from companion.comparison import GENERIC
from companion.comparison.phases import between, phases
from companion.comparison.phases import flown as flights_of
from companion.model import ActuatorTrack, Array, Event, Flight, Phase, PhaseKind, StatusText, without
from companion.strapdown import Motion, motions, quaternion
from companion.verdict import Assessment, Finding, assess
from companion.verdict.findings.detect import when_lost
from tests.flights import flown, lively, moved_north, seconds, with_imu

pytestmark = pytest.mark.slow

BEGIN, END = 55.0, 59.0  # of three turns about the roll axis
HELD_S = 10.0  # in control in the air, until a vehicle is judged again


def tumbling(motion: Motion) -> Motion:
    """The same path while the body turns over three times in 4 s: analytic, every reading as it has to be."""
    part = np.clip((motion.t - BEGIN) / (END - BEGIN), 0.0, 1.0)
    angle, rate = 6 * np.pi * part, 6 * np.pi / (END - BEGIN) * ((part > 0) & (part < 1))
    roll = np.column_stack([angle, 0 * angle, 0 * angle])
    turn = quaternion.exp(roll)
    back = quaternion.conjugate(turn)
    return replace(
        motion,
        q_ned_frd=quaternion.multiply(motion.q_ned_frd, turn),
        gyro=quaternion.rotate(back, motion.gyro) + np.column_stack([rate, 0 * rate, 0 * rate]),
        accel=quaternion.rotate(back, motion.accel),
    )


def test_a_log_that_is_out_of_control_from_its_first_sample_to_its_last_is_told_of() -> None:
    flight = flown(lively(40.0))
    attitude = flight.require_attitude()
    over = quaternion.multiply(attitude.q_ned_frd, quaternion.from_euler(np.pi, 0.0, 0.0)[None])
    found = assess(replace(flight, attitude=replace(attitude, q_ned_frd=over)), GENERIC)
    assert found.verdict.status == "insufficient_data"
    assert found.verdict.summary.startswith("Control was lost at 10.0 s.")
    assert found.best is None


@cache
def fallen() -> Flight:
    """From 10 to 120 s, out of control from 55 to 59 s, and caught in the air."""
    return flown(tumbling(lively(110.0)))


def misread(flight: Flight, begin: float, end: float, **errors: Any) -> Flight:
    """The IMU reads too much between two times."""
    imu = flight.imu()
    during = ((imu.t >= begin) & (imu.t < end))[:, None]
    return with_imu(flight, **{name: getattr(imu, name) + during * np.array(error) for name, error in errors.items()})


def judged(flight: Flight) -> Assessment:
    return assess(flight, GENERIC)


def kinds(found: Assessment, severity: str) -> list[str]:
    return [f.kind for f in found.verdict.findings if f.severity == severity]


def test_a_fall_with_healthy_sensors_is_said_as_such() -> None:
    found = judged(fallen())
    assert [part.kind for part in phases(fallen())] == ["flight", "impact", "flight"]
    (lost,) = [f for f in found.verdict.findings if f.kind == "control_lost"]
    assert (lost.start_s, lost.end_s) == pytest.approx((BEGIN, END + HELD_S), abs=0.5)
    assert found.verdict.status == "consistent"
    assert found.verdict.summary.startswith(f"Control was lost at {lost.start_s:.1f} s; the sensors agree")
    assert not kinds(found, "error")
    assert [one.status for one in found.verdict.flights] == ["consistent", "consistent"]


def test_at_a_ground_stations_rate_no_sensor_is_cleared_of_it() -> None:
    found = judged(thinned(fallen(), 4.0))
    assert "control_lost" in kinds(found, "warning")
    assert found.verdict.status == "insufficient_data"
    assert "within a second of the loss" in found.verdict.summary


def test_what_is_read_in_the_fall_changes_nothing() -> None:
    """A wreck reads whatever it reads, by every sensor."""
    flight, rng = fallen(), np.random.default_rng(3)

    def wild(t: Array, size: float) -> Array:
        within = (t > BEGIN + 0.5) & (t < END + 5.0)
        return np.asarray(within[:, None] * size * rng.normal(size=(len(t), 3)))

    imu, gps, compass, air = flight.imu(), flight.gps[0], flight.compasses[0], flight.barometers[0]
    wrecked = replace(
        with_imu(flight, accel=imu.accel + wild(imu.t, 300.0)),
        gps=(moved_north(replace(gps, velocity=gps.velocity + wild(gps.t, 20.0)), wild(gps.t, 300.0)[:, 0]),),
        compasses=(replace(compass, field=compass.field + wild(compass.t, 5e-5)),),
        barometers=(replace(air, altitude=air.altitude + wild(air.t, 50.0)[:, 0]),),
    )
    sound, wreck = judged(flight), judged(wrecked)
    assert wreck.verdict.status == sound.verdict.status
    assert wreck.agreements == sound.agreements
    assert wreck.verdict.flights == sound.verdict.flights
    assert wreck.best is not None
    assert sound.best is not None
    np.testing.assert_array_equal(wreck.best.position, sound.best.position)


def test_a_fault_before_the_fall_is_the_headline_with_the_time_between_them() -> None:
    found = judged(misread(fallen(), 30.0, np.inf, gyro=(0.0, 0.0, 0.02)))
    assert found.verdict.status == "imu_suspect"
    assert found.verdict.cause is not None
    assert (found.verdict.cause.kind, found.verdict.cause.sensor) == ("gyro_bias", "gyro")
    assert found.verdict.cause.onset_s == pytest.approx(30.0, abs=1.0)
    (lost,) = [f for f in found.verdict.findings if f.kind == "control_lost"]
    between = lost.start_s - found.verdict.cause.onset_s
    assert f"Control was lost at {lost.start_s:.1f} s, {between:.1f} s after it began." in found.verdict.summary
    assert [one.status for one in found.verdict.flights] == ["imu_suspect", "imu_suspect"], "it lasts"


def test_a_fault_of_the_second_flight_alone_is_its_own() -> None:
    found = judged(misread(fallen(), 90.0, np.inf, gyro=(0.0, 0.0, 0.02)))
    first, second = found.verdict.flights
    assert (first.status, second.status) == ("consistent", "imu_suspect")
    assert found.verdict.status == "imu_suspect", "the first fault of any"
    assert second.cause == found.verdict.cause
    assert second.cause is not None
    assert second.cause.onset_s == pytest.approx(90.0, abs=1.0)
    assert "after it began" not in found.verdict.summary


def test_an_imu_that_stopped_in_the_first_flight_hides_no_fault_of_the_second() -> None:
    biased = misread(fallen(), 90.0, np.inf, gyro=(0.0, 0.0, 0.02))
    imu = biased.imu()
    stopped = ((imu.t > 25.0) & (imu.t < 35.0))[:, None]
    gyro, accel = (np.where(stopped, read[np.argmax(stopped)], read) for read in (imu.gyro, imu.accel))
    found = judged(with_imu(biased, gyro=gyro, accel=accel))
    assert [None if one.cause is None else one.cause.kind for one in found.verdict.flights] == ["frozen", "gyro_bias"]


def test_an_imu_that_nobody_flew_on_and_that_stops_in_the_second_flight_is_told_of() -> None:
    flight, noise = fallen(), np.random.default_rng(2).standard_normal((len(fallen().imu()), 3))
    own = flight.imu()
    gyro, accel = own.gyro + 1e-4 * noise, own.accel + 1e-3 * noise
    stopped = (own.t > 90.0) & (own.t < 100.0)
    gyro, accel = (np.where(stopped[:, None], one[np.argmax(stopped)], one) for one in (gyro, accel))
    other = replace(own, gyro=gyro, accel=accel, source="SCALED_IMU2", instance=1)
    found = judged(replace(flight, imus={**flight.imus, other.source: other}))
    assert [one.status for one in found.verdict.flights] == ["consistent", "imu_suspect"]
    assert found.verdict.cause is not None
    assert (found.verdict.cause.kind, found.verdict.cause.imu) == ("frozen", 1)


def test_evidence_in_the_last_second_of_a_log_is_worth_nothing() -> None:
    end = float(fallen().imu().t[-1])
    late = misread(fallen(), end - 0.9, np.inf, accel=(200.0, 0.0, 0.0), gyro=(0.0, 40.0, 0.0))
    found = judged(late)
    assert not kinds(found, "error")
    assert not [f for f in found.verdict.findings if f.severity == "warning" and f.start_s > end - 1.0]
    doubt = Finding("gyro_shock", "data", "warning", end - 0.5, end, "perhaps", "", undecided=True)
    assert not [f for f in when_lost((doubt,), fallen(), fallen().imu(), phases(fallen()), GENERIC) if f.undecided]


@pytest.mark.parametrize(
    ("ends", "said"),
    [([], ""), ([0], " with output 1 at its end"), ([0, 2], " with output 1 and output 3 at their end")],
)
def test_an_output_that_came_to_its_end_as_control_was_lost_is_named(ends: list[int], said: str) -> None:
    """The fourth is at its end all the time: a lamp."""
    t = np.arange(10.0, 120.0, 0.1)
    output = np.full((len(t), 4), 0.4)
    output[:, 3] = 1.0
    for i in ends:
        output[(t > BEGIN - 1.0) & (t < BEGIN + 2.0), i] = 1.0
    found = judged(replace(fallen(), actuators=ActuatorTrack(t, output, "RCOU")))
    (lost,) = [f for f in found.verdict.findings if f.kind == "control_lost"]
    assert lost.headline == f"control was lost at {lost.start_s:.1f} s{said}"


def test_outputs_of_which_the_flight_has_none_say_nothing_of_a_loss_of_control() -> None:
    """A log of several flights may have them in another one alone."""
    nothing = ActuatorTrack(np.zeros(0), np.zeros((0, 4)), "RCOU")
    (lost,) = [f for f in judged(replace(fallen(), actuators=nothing)).verdict.findings if f.kind == "control_lost"]
    assert lost.headline == f"control was lost at {lost.start_s:.1f} s"


def kinds_of(flight: Flight) -> list[tuple[str, float]]:
    return [(part.kind, round(part.start, 1)) for part in phases(flight)]


def test_after_a_crash_the_next_arming_begins_the_next_flight() -> None:
    crash = (StatusText(50.0, 2, "Crash: Disarming: AngErr=45>30, Accel=0.7<3.0"),)
    armed = Event(10.0, "armed", "armed")
    events = (armed, Event(50.1, "disarmed", "disarmed"), Event(80.0, "armed", "armed"))
    flight = flown(lively(110.0), texts=crash, events=events)
    assert kinds_of(flight)[:3] == [("flight", 10.0), ("impact", 50.0), ("flight", 80.0)]
    assert kinds_of(replace(flight, events=events[:2])) == [("flight", 10.0), ("impact", 50.0)], "nothing is invented"


@pytest.mark.parametrize(("mode", "kind"), [("ACRO", "flight"), ("STABILIZE", "impact")])
def test_who_turns_over_at_will_has_lost_nothing(mode: str, kind: str) -> None:
    flight = fallen()
    events = (Event(10.0, "mode", mode), *flight.events)
    assert kind in [part.kind for part in phases(replace(flight, events=events))][-2:]
    assert ("impact" in [part.kind for part in phases(replace(flight, events=events))]) == (kind == "impact")


def test_a_vehicle_that_lies_still_as_its_attitude_turns_over_has_lost_nothing() -> None:
    """A gyro that reads 0.4 rad/s at rest takes the estimator round and round."""
    t = seconds(60.0, 50)
    lying = flown(motions.rest(t), events=(Event(10.0, "armed", "armed"), Event(12.0, "event", "took off")))
    attitude = lying.require_attitude()
    rolling = quaternion.exp(np.outer(0.4 * (attitude.t - 10.0), [1.0, 0.0, 0.0]))
    misled = replace(lying, attitude=replace(attitude, q_ned_frd=rolling))
    assert "impact" not in [part.kind for part in phases(misled)]
    shaken = with_imu(misled, accel=misled.imu().accel + np.random.default_rng(5).normal(size=(len(t), 3)))
    assert "impact" in [part.kind for part in phases(shaken)]


SPANS = st.lists(st.tuples(st.floats(0.0, 130.0), st.floats(0.0, 40.0)).map(lambda s: (s[0], s[0] + s[1])), max_size=4)


@given(SPANS)
def test_what_is_left_out_is_gone_from_every_track_and_nothing_else_is(spans: list[tuple[float, float]]) -> None:
    flight = fallen()
    seen = without(flight, spans)
    pairs = (
        [
            (seen.imu(), flight.imu()),
            (seen.require_attitude(), flight.require_attitude()),
            (seen.gps[0], flight.gps[0]),
            (seen.compasses[0], flight.compasses[0]),
            (seen.barometers[0], flight.barometers[0]),
        ]
        if min(len(seen.imus["RAW_IMU"]), len(seen.attitude or ())) > 1
        else []
    )
    for left, whole in pairs:
        kept = np.array([not any(begin <= t < end for begin, end in spans) for t in whole.t])
        np.testing.assert_array_equal(left.t, whole.t[kept])
    assert (seen.events, seen.texts) == (flight.events, flight.texts)
    assert (seen.start, seen.duration) == (flight.start, flight.duration)


@given(st.lists(st.floats(0.0, 100.0), min_size=2, max_size=8, unique=True))
def test_in_and_out_of_control_make_up_the_whole(edges: list[float]) -> None:
    ordered = sorted(edges)[: len(edges) // 2 * 2]
    out = list(zip(ordered[::2], ordered[1::2], strict=True))
    held = between(out, np.array([-1.0, 50.0, 101.0]))
    every = sorted([*out, *held])
    assert (every[0][0], every[-1][1]) == (-1.0, 101.0)
    assert all(one[1] == other[0] for one, other in pairwise(every))


KINDS: tuple[PhaseKind, ...] = ("aligning", "standing", "flight", "landed", "impact")


@given(st.lists(st.sampled_from(KINDS), min_size=1, max_size=12))
def test_flights_are_apart_in_order_and_have_all_that_was_flown(order: list[PhaseKind]) -> None:
    parts = [Phase(float(i), float(i + 1), kind) for i, kind in enumerate(order)]
    spans = flights_of(parts)
    edges = [edge for span in spans for edge in span]
    assert edges == sorted(edges)
    for part in parts:
        inside = [begin <= part.start and part.end <= end for begin, end in spans]
        if part.kind == "flight":
            assert sum(inside) == 1
        if part.kind == "impact":
            assert not any(inside)
