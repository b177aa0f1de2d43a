"""Every IMU through the same windows, and two of one vehicle against each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import companion as c
from companion.analysis import GENERIC, Finding, RedundantImu, ReferenceSpec, compare, each_imu
from companion.analysis.redundant_imus import differences, parting_findings, partings
from companion.estimation import BestEstimate, Explained
from companion.model import Array, Flight, ImuTrack
from companion.strapdown import motions
from tests.flights import flight_of, seconds
from tests.recordings import recording


def side_by_side(flight: c.Flight) -> tuple[RedundantImu, ...]:
    return each_imu(flight, lambda name: compare(flight, imu=name), lambda _: GENERIC, ReferenceSpec())


def test_the_imu_with_the_bias_is_outside_its_bound() -> None:
    flight = flight_of(motions.coning(seconds(60, 100), angle=0.2, frequency=0.2))
    good = flight.imu()
    bad = replace(good, gyro=good.gyro + np.array([0.05, 0, 0]), source="SCALED_IMU2", instance=1)
    found = side_by_side(replace(flight, imus={"RAW_IMU": good, "SCALED_IMU2": bad}))
    assert [(s.imu, s.instance) for s in found] == [("RAW_IMU", 0), ("SCALED_IMU2", 1)]
    inside = [min(s.inside.values()) for s in found]
    assert inside[0] > 0.9
    assert inside[1] < 0.1


def test_two_messages_of_one_imu_are_one() -> None:
    flight = c.open_log(recording("sitl/copter-hover-nodrift-100hz.tlog"))[0]
    found = side_by_side(flight)
    assert {s.imu: s.instance for s in found}["RAW_IMU"] == {s.imu: s.instance for s in found}["HIGHRES_IMU"] == 0
    assert [s.drift.horizon_s for s in found] == pytest.approx([5.0] * len(found))


ONSET = 31.0
WHOLE = ((0.0, 90.0),)


def sibling(flight: Flight, every: int = 25, gyro: Array | float = 0.0, accel: Array | float = 0.0) -> ImuTrack:
    """A second IMU, logged 25 times less often, with errors of its own (N, 3)."""
    own = flight.imu()
    noise = np.random.default_rng(5).normal(size=(2, len(own), 3))
    other = replace(
        own,
        source="IMU[1]",
        instance=own.instance + 1,
        gyro=own.gyro + gyro + 2e-3 * noise[0],
        accel=own.accel + accel + 0.05 * noise[1],
    )
    return other[::every]


def step(flight: Flight, *size: float) -> Array:
    return np.asarray((flight.imu().t >= ONSET)[:, None] * np.array(size))


def test_a_step_of_a_slow_second_imu_is_found(flight: Flight) -> None:
    (one,) = partings(differences(flight.imu(), sibling(flight, accel=step(flight, 0.6, 0.0, -0.2)), WHOLE))
    assert (one.sensor, one.axis) == ("accel", "x")
    assert one.onset == pytest.approx(ONSET, abs=2.5)
    assert one.size == pytest.approx([0.6, 0.0, -0.2], abs=5.0 * one.sigma)


@pytest.mark.parametrize("every", [1, 5])
def test_the_order_of_the_two_is_that_of_the_sign(flight: Flight, every: int) -> None:
    """Whichever of them was logged more often."""
    other = sibling(flight, every=every, gyro=step(flight, 0.0, 0.02, 0.0))
    (there,), (back,) = (partings(differences(*two, WHOLE)) for two in ((flight.imu(), other), (other, flight.imu())))
    assert there.size == pytest.approx([0.0, 0.02, 0.0], abs=5.0 * there.sigma)
    assert there.size == pytest.approx(-back.size, abs=1e-4)
    assert there.axis == "y"


@pytest.mark.parametrize("kind", ["nothing", "an offset throughout", "a slow drift"])
def test_what_does_not_come_at_once_is_no_parting(flight: Flight, kind: str) -> None:
    errors = {
        "nothing": 0.0,
        "an offset throughout": np.array([0.5, 0.0, 0.0]),
        "a slow drift": np.linspace(0.0, 0.8, len(flight.imu()))[:, None] * np.array([1.0, 0.0, 0.0]),
    }
    assert list(partings(differences(flight.imu(), sibling(flight, accel=errors[kind]), WHOLE))) == []


def test_a_step_across_a_time_that_was_not_heard_is_none(flight: Flight) -> None:
    other = sibling(flight, every=5, accel=step(flight, 0.6, 0.0, 0.0))
    heard = (other.t < ONSET - 8.0) | (other.t > ONSET + 8.0)
    first, last = np.flatnonzero(~heard)[[0, -1]]
    spans = ((0.0, float(other.t[first])), (float(other.t[last]), 90.0))
    assert list(partings(differences(flight.imu(), other, spans))) == []


def test_the_one_that_agrees_with_all_other_sensors_is_not_accused(flight: Flight, best: BestEstimate) -> None:
    other = sibling(flight, accel=step(flight, 0.6, 0.0, 0.0))
    both = replace(flight, imus={**flight.imus, other.source: other})
    (found,) = parting_findings(both, flight.imu(), best)
    assert (found.kind, found.side, found.severity) == ("accel_bias", "imu", "error")
    assert "IMU[1]" in found.evidence
    assert found.cause is not None
    assert found.cause.axis == "x"
    own = Explained("accel_bias", "step", ONSET, 0.1, np.inf, np.array([0.6, 0.0, 0.0]), np.full(3, 0.01))
    assert parting_findings(both, flight.imu(), replace(best, explained=(own,))) == []
    before = replace(own, kind="accel_scale", onset=ONSET - 15.0)
    (later,) = parting_findings(both, flight.imu(), replace(best, explained=(before,)))
    assert (later.kind, later.severity) == ("accel_bias", "error")
    assert later.evidence.endswith("which shows no change then")
    assert parting_findings(both, flight.imu(), replace(best, explained=(replace(before, onset_sigma=6.0),))) == []
    ended = replace(before, end=ONSET + 1.0)
    assert parting_findings(both, flight.imu(), replace(best, explained=(ended,))) == [], "its own error ended then"
    assert parting_findings(both, flight.imu(), replace(best, detectable={"accel_bias": 1.0})) == []


def test_a_steady_bias_of_another_imu_is_told_and_accuses_nobody(flight: Flight, best: BestEstimate) -> None:
    """As large as no part in order has it: what the two differ by, and what the estimate's own is off by."""

    def told(**errors: Array) -> list[Finding]:
        other = sibling(flight, every=5, **errors)
        return parting_findings(replace(flight, imus={**flight.imus, other.source: other}), flight.imu(), best)

    own = np.median(best.states.gyro_bias, axis=0)
    (found,) = told(gyro=np.array([0.0, 0.0, -0.025]) - own)
    assert (found.kind, found.side, found.severity, found.cause) == ("imus_disagree", "imu", "warning", None)
    assert "IMU[1] (IMU 1): gyro bias (0.0, 0.0, -25.0)" in found.evidence
    assert "-25.0) ± " in found.evidence
    assert [f.kind for f in told(accel=np.array([0.4, 0.0, 0.0]))] == ["imus_disagree"]
    assert told(gyro=np.array([0.0, 0.0, 0.012]), accel=np.array([0.0, 0.12, 0.0])) == []


def test_which_of_two_parted_is_not_said_before_it_can_be_known(flight: Flight, best: BestEstimate) -> None:
    """A second after the step the estimate would not show it either, if it were its own IMU's."""
    imu, late = flight.imu(), best.t[-1] - 7.0
    after = (imu.t >= late)[:, None] * np.array([0.0, 0.0, 0.02])
    assert best.detectable["gyro_bias"] < 0.02, "in the middle of the flight it would"
    other = sibling(flight, every=5, gyro=after)
    (found,) = parting_findings(replace(flight, imus={**flight.imus, other.source: other}), imu, best)
    assert (found.kind, found.side, found.severity, found.advice) == ("gyro_bias", "imu", "error", "")
    assert found.evidence.endswith("too short a time to tell which of them is wrong")
