"""Every IMU through the same windows, and two of one vehicle against each other."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import companion as c
from companion.analysis import GENERIC, Finding, RedundantImu, ReferenceSpec, compare, each_imu
from companion.analysis.redundant_imus import steady_findings
from companion.estimation import BestEstimate
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


def test_a_steady_bias_of_another_imu_is_told_and_accuses_nobody(flight: Flight, best: BestEstimate) -> None:
    """As large as no part in order has it: what the two differ by, and what the estimate's own is off by."""

    def told(**errors: Array) -> list[Finding]:
        other = sibling(flight, every=5, **errors)
        return steady_findings(replace(flight, imus={**flight.imus, other.source: other}), flight.imu(), best)

    own = np.median(best.states.gyro_bias, axis=0)
    (found,) = told(gyro=np.array([0.0, 0.0, -0.025]) - own)
    assert (found.kind, found.side, found.severity, found.cause) == ("imus_disagree", "imu", "warning", None)
    assert re.search(r"IMU\[1\] \(IMU 1\): gyro bias \(-?0\.\d, -?0\.\d, -2[45]\.\d\) ± ", found.evidence)
    assert [f.kind for f in told(accel=np.array([0.4, 0.0, 0.0]))] == ["imus_disagree"]
    assert told(gyro=np.array([0.0, 0.0, 0.012]), accel=np.array([0.0, 0.12, 0.0])) == []
