"""Why control was lost: each cause by what speaks for it, none forced, and what came after is no evidence."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from companion.comparison import GENERIC, phases
from companion.constants import priors
from companion.model import (
    ActuatorTrack,
    ControlTrack,
    DataError,
    EstimatorReset,
    Event,
    Flight,
    StatusText,
)
from companion.present import incident_markdown
from companion.strapdown import motions, quaternion
from companion.verdict import Cause, Finding, Incident, Verdict, assess, incident
from tests.flights import flight_of, flown, seconds, with_imu
from tests.verdict.test_loss_of_control import BEGIN, fallen

MOTORS = 4


@cache
def falling() -> Flight:
    """A quadrotor that turns over from 55 to 59 s, while level flight was desired."""
    flight = fallen()
    t = np.arange(flight.start, flight.start + flight.duration, 0.1)
    level = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    return replace(flight, control=ControlTrack(t, level, "ATT"), actuators=outputs())


def outputs(full: int | None = None, since: float = BEGIN) -> ActuatorTrack:
    """Motors at a third, one of which goes to its end."""
    flight = fallen()
    t = np.arange(flight.start, flight.start + flight.duration, 0.1)
    share = 0.35 + 0.02 * np.sin(3.0 * t)[:, None] * np.ones(MOTORS)
    if full is not None:
        share[t >= since, full] = 1.0
    return ActuatorTrack(t, share, "actuator_motors")


def told(flight: Flight, at: float | None = None) -> Incident:
    return incident(flight, None, at)


def shares(made: Incident) -> dict[str, float]:
    return {one.name: one.probability for one in made.causes}


def test_the_moment_is_the_loss_of_control() -> None:
    made = told(falling())
    assert made.moment.kind == "loss_of_control"
    assert made.moment.t == pytest.approx(BEGIN, abs=0.5)
    assert (made.start_s, made.end_s) == pytest.approx((made.moment.t - 30.0, made.moment.t + 5.0))
    assert sum(shares(made).values()) == pytest.approx(1.0)
    assert made.tracking is not None
    assert made.tracking.left_s is not None
    assert made.tracking.worst > np.radians(150.0)


def test_a_motor_at_its_end_makes_a_motor_likelier() -> None:
    before, after = told(falling()), told(replace(falling(), actuators=outputs(full=2)))
    assert [(one.name, one.end) for one in after.outputs] == [("motor 3", "full")]
    assert shares(after)["mechanical"] > max(shares(before)["mechanical"], 0.5)
    assert next(one for one in after.causes if one.name == "mechanical").evidence


def test_an_output_that_was_always_at_its_end_is_no_evidence() -> None:
    assert told(replace(falling(), actuators=outputs(full=2, since=0.0))).outputs == ()


def test_what_the_vehicle_says_of_its_battery_counts_before_the_fall_alone() -> None:
    def saying(t: float) -> Flight:
        return replace(falling(), texts=(StatusText(t, 2, "Battery 1 low voltage failsafe"),))

    before, after = shares(told(saying(BEGIN - 5.0))), shares(told(saying(BEGIN + 3.0)))
    assert before["power"] > 3.0 * after["power"]


def test_a_flip_that_was_desired_is_a_command() -> None:
    flight = falling()
    steep = quaternion.exp(np.tile([np.radians(100.0), 0.0, 0.0], (len(flight.control or ()), 1)))
    assert flight.control is not None
    asked = replace(flight, control=replace(flight.control, q_ned_frd=np.asarray(steep)))
    assert shares(told(asked))["command"] > 5.0 * shares(told(flight))["command"]


def test_nothing_is_forced() -> None:
    """Without a desired attitude and outputs hardly anything speaks: no cause is sure."""
    made = told(replace(falling(), control=None, actuators=None))
    assert max(shares(made).values()) < priors.ACCUSED
    assert {"the desired attitude", "motors and servos"} <= set(made.missing)


def test_a_sensor_that_the_verdict_accuses_before_the_fall_is_a_cause() -> None:
    flight, assessment = falling(), assess(falling(), GENERIC)

    def accused(since: float) -> Incident:
        stuck = Finding("stuck_axis", "imu", "error", since, BEGIN, "gyro z reads 0.01 for 25 s", "")
        return incident(flight, replace(assessment, verdict=Verdict("imu_suspect", "", (stuck,))))

    healthy, before, after = incident(flight, assessment), accused(30.0), accused(BEGIN + 1.0)
    assert shares(healthy)["imu"] < 0.05
    assert shares(before)["imu"] > 0.2 > shares(after)["imu"]
    assert "gyro z reads 0.01 for 25 s" in next(one for one in before.causes if one.name == "imu").evidence


def test_without_a_loss_of_control_the_verdict_weighs() -> None:
    """A failsafe while everything is in order: nobody."""
    flight = flown(events=(Event(10.0, "armed", "armed"), Event(30.0, "error", "radio failsafe")))
    made = incident(flight, assess(flight, GENERIC))
    assert made.moment.kind == "failsafe"
    assert made.causes[0].name == "nobody"


def test_of_a_failsafe_in_a_flight_that_cannot_be_judged_no_cause_is_told() -> None:
    """Its readings determine no trajectory: nothing was weighed, and nobody is cleared."""
    sound = replace(flown(), gps=(), position=None)
    imu = sound.imu()
    flight = replace(with_imu(sound, accel=-imu.accel), events=(Event(30.0, "error", "radio failsafe"),))
    found = assess(flight, GENERIC)
    assert not found.verdict.probability
    assert incident(flight, found).causes == ()


def test_the_estimator_is_not_blamed_for_what_a_frozen_compass_led_to() -> None:
    flight = flown()
    cause = Cause("compass_frozen", "autopilot", 10.0, 50.0, sensor="compass")
    frozen = Finding("compass_frozen", "autopilot", "error", 10.0, 50.0, "one field", "", cause=cause)
    jump = Finding("heading_jump", "autopilot", "error", 30.0, 30.0, "the heading steps", "")

    def names(second: Finding) -> list[str]:
        verdict = Verdict("autopilot_suspect", "", (frozen, second), cause, {"nobody": 1.0})
        causes = incident(flight, replace(assess(flight, GENERIC), verdict=verdict)).causes
        return [one.name for one in causes]

    assert names(jump) == ["compass", "nobody"]
    assert "autopilot" in names(replace(jump, start_s=51.0, end_s=51.0))


def test_the_timeline_is_about_the_moment() -> None:
    texts = tuple(StatusText(BEGIN + t, 6, f"at {t}") for t in (-40.0, -20.0, 1.0, 9.0))
    resets = (EstimatorReset(BEGIN - 1.0, "lane", "EKF3 lane switch 1", 1),)
    rows = told(replace(falling(), texts=texts, resets=resets)).timeline
    assert [row.text for row in rows if row.what in ("text", "lane")] == ["at -20.0", "EKF3 lane switch 1", "at 1.0"]
    assert [row.after_s for row in rows] == sorted(row.after_s for row in rows)


def test_a_flight_in_order_has_no_incident_but_one_that_is_asked_for() -> None:
    with pytest.raises(DataError, match="nothing went wrong"):
        told(flown())
    made = told(flown(), at=30.0)
    assert (made.moment.kind, made.moment.t) == ("requested", 30.0)
    with pytest.raises(DataError, match="--at"):
        told(flown(), at=1e4)


def test_the_page_tells_no_place_and_lets_no_text_be_markup() -> None:
    texts = (StatusText(BEGIN - 1.0, 4, "<b>Home</b> 47.3977419, 8.5455939 | *set*"),)
    page = incident_markdown(told(replace(falling(), texts=texts)), falling(), "", "a`b.bin")
    assert "47.3977" not in page
    assert "8.54559" not in page
    assert "<b>" not in page.replace("\\<", "")
    assert "\\| \\*set\\*" in page
    assert "`a b.bin`" in page


def test_the_table_of_causes_is_one_of_probabilities() -> None:
    assert sum(row["prior"] for row in priors.INCIDENT.values()) == pytest.approx(1.0)
    assert all(0.0 < share < 1.0 for row in priors.INCIDENT.values() for share in row.values())


def test_what_was_caught_in_the_air_has_not_taken_off() -> None:
    """It turns over again two seconds after it is judged again."""
    t = seconds(80.0, 50.0)
    flight = flight_of(motions.circle(t, radius=25.0, speed=6.0, bank=0.15), events=(Event(11.0, "armed", ""),))
    attitude = flight.require_attitude()
    over = ((t > 30.0) & (t < 34.0)) | ((t > 46.0) & (t < 60.0))
    turned = quaternion.multiply(attitude.q_ned_frd, quaternion.from_euler(np.pi, 0.0, 0.0)[None])
    q = np.where(over[:, None], turned, attitude.q_ned_frd)
    flight = replace(flight, attitude=replace(attitude, q_ned_frd=q))
    *_, again = (part for part in phases(flight) if part.kind == "impact")
    reasons = [one for cause in told(flight, again.start).causes for one in cause.evidence]
    assert again.start > 45.0
    assert not any("took off" in one for one in reasons)
