"""What is set of declination, GPS delay and antenna, beside what the flight says of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from companion.comparison.reference import Limits
from companion.estimation import BestEstimate, field_at, smooth
from companion.model import Flight, rows
from companion.strapdown import Motion, quaternion
from companion.verdict.finding import Finding
from companion.verdict.findings.settings import setting_findings
from tests.estimation.sensed import gps_of, sensed
from tests.flights import turned

DECLINATION = 0.0605  # rad, where the flights are
OFF = np.radians(10.0)


@cache
def made() -> tuple[Flight, Motion]:
    flight, truth = sensed(90.0, rate=50.0, fixes_hz=5.0)
    return replace(flight, on_board=True), truth


@cache
def healthy() -> BestEstimate:
    return smooth(made()[0])


def found(flight: Flight, parameters: Mapping[str, float], best: BestEstimate | None = None) -> list[Finding]:
    flight = replace(flight, parameters=parameters)
    return list(setting_findings(flight, best or healthy(), Limits()))


def headed(angle: float) -> Flight:
    flight, _ = made()
    return turned(flight, np.tile([0.0, 0.0, angle], (len(flight.require_attitude()), 1)))


def test_the_declination_of_the_place_is_the_world_models() -> None:
    flight, _ = made()
    earth = field_at(flight.origin, flight.epoch)
    assert earth is not None
    assert earth.declination == pytest.approx(DECLINATION, abs=1e-3)


@pytest.mark.parametrize(
    "parameters",
    [
        {},
        {"COMPASS_DEC": DECLINATION, "COMPASS_AUTODEC": 1.0, "GPS1_DELAY_MS": 0.0, "GPS1_POS_X": 0.0},
        {"EKF2_MAG_DECL": 3.5, "EKF2_DECL_TYPE": 3.0, "EKF2_GPS_DELAY": 110.0, "EKF2_GPS_POS_X": 0.0},
        {"COMPASS_DEC": DECLINATION + OFF, "COMPASS_AUTODEC": 0.0},  # the estimator takes no notice of it
    ],
)
def test_a_healthy_flight_contradicts_nothing(parameters: Mapping[str, float]) -> None:
    assert found(made()[0], parameters) == []


@pytest.mark.parametrize(
    ("parameters", "value"),
    [
        ({"COMPASS_DEC": DECLINATION + OFF, "COMPASS_AUTODEC": 0.0}, "COMPASS_DEC to 0.060"),
        ({"EKF2_MAG_DECL": np.degrees(DECLINATION + OFF), "EKF2_DECL_TYPE": 0.0}, "EKF2_MAG_DECL to 3.5°"),
    ],
)
def test_a_declination_that_is_set_wrongly_is_named(parameters: Mapping[str, float], value: str) -> None:
    (one,) = found(headed(OFF), parameters)
    assert (one.kind, one.side, one.severity, one.undecided) == ("declination", "data", "warning", False)
    assert f"Set {value}" in one.advice
    assert "heading is off by 10.0 ± 3.0°" in one.evidence
    assert found(headed(-OFF), parameters) == [], "not the way in which it is off"


def test_a_heading_without_any_declination_is_off_by_all_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    flight, _ = made()
    earth = field_at(flight.origin, flight.epoch)
    assert earth is not None
    far = replace(earth, declination=np.radians(15.0))
    monkeypatch.setattr("companion.verdict.findings.settings.field_at", lambda *_: far)
    (one,) = found(headed(-np.radians(15.0)), {})
    assert "as if no declination were used: it is 15.0° here" in one.evidence
    assert found(flight, {}) == []


@pytest.mark.parametrize(
    ("latency", "name", "told"),
    [(0.2, "EKF2_GPS_DELAY", True), (0.2, "GPS1_DELAY_MS", False), (0.4, "GPS_DELAY_MS", True)],
)
def test_a_gps_that_is_later_than_is_set_is_named(latency: float, name: str, told: bool) -> None:
    """0 is none at PX4, and what is known of the receiver at ArduPilot."""
    flight, truth = made()
    late = replace(flight, gps=(gps_of(truth, np.random.default_rng(3), latency=latency, rate=5.0),))
    best = smooth(late)
    one = [f for f in found(late, {name: 0.0}, best) if f.kind == "gps_delay"]
    assert len(one) == told
    assert all(int(f.advice.split()[3]) == pytest.approx(1e3 * latency, abs=20.0) for f in one)
    assert found(late, {name: 1e3 * latency}, best) == []
    assert found(replace(late, on_board=False), {name: 0.0}, best) == [], "a link stamps when it sends"


@cache
def with_an_arm() -> tuple[Flight, BestEstimate]:
    """The antenna sits 0.8 m before the IMU, and 0.3 m above it."""
    flight, truth = made()
    arm = np.array([0.8, 0.0, -0.3])
    swung = quaternion.rotate(truth.q_ned_frd, np.cross(truth.gyro, arm))
    seen = replace(
        truth, position=truth.position + quaternion.rotate(truth.q_ned_frd, arm), velocity=truth.velocity + swung
    )
    away = replace(flight, gps=(gps_of(seen, np.random.default_rng(3), rate=5.0),))
    return away, smooth(away)


def test_an_antenna_that_sits_elsewhere_is_named() -> None:
    away, best = with_an_arm()
    (one,) = found(away, {"GPS1_POS_X": 0.0, "INS_POS1_X": 0.1}, best)
    assert one.kind == "antenna_position"
    x, y, _ = (float(v) for v in one.advice.split("(")[1].split(")")[0].split(","))
    assert (x - 0.9, y) == pytest.approx((0.0, 0.0), abs=0.1)
    assert found(away, {"GPS1_POS_X": 0.8, "GPS1_POS_Z": -0.3}, best) == []
    fast = replace(best, states=replace(best.states, velocity=6.0 * best.states.velocity))
    assert found(away, {"GPS1_POS_X": 0.0, "INS_POS1_X": 0.1}, fast) == [], "positions 30 ms late would do as much"


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"GPS1_POS_X": 0.0, "GPS2_POS_X": 0.8, "GPS2_POS_Z": -0.3}, []),
        ({"GPS_POS1_X": 0.0, "GPS_POS2_X": 0.8, "GPS_POS2_Z": -0.3}, []),
        ({"GPS1_POS_X": 0.8, "GPS1_POS_Z": -0.3, "GPS2_POS_X": 0.0}, ["Set GPS2_POS_X,"]),
        ({"GPS1_DELAY_MS": 500.0, "GPS2_DELAY_MS": 0.0}, []),
        ({"GPS_DELAY_MS": 0.0, "GPS_DELAY_MS2": 500.0}, ["Set GPS_DELAY_MS2 to"]),
        ({"GPS1_POS_X": 0.0, "INS_POS1_X": 0.0, "INS_POS2_X": -0.8, "INS_POS2_Z": 0.3}, []),
    ],
)
def test_what_is_set_is_that_of_the_receiver_and_the_imu_of_the_estimate(
    parameters: Mapping[str, float], said: list[str]
) -> None:
    """As with two antennas that tell the heading: each has its own place."""
    flight, best, of_imu = *with_an_arm(), any(name.startswith("INS") for name in parameters)
    (gps,), imu = flight.gps, flight.imu()
    second = replace(gps, instance=1, source="GPS[1]")
    both = (gps,) if of_imu else (rows(gps, gps.t > gps.t[0]), second)
    told = replace(flight, gps=both)
    best = replace(best, imu=replace(imu, instance=1)) if of_imu else best
    assert [f.advice[: len(words)] for f, words in zip(found(told, parameters, best), said, strict=True)] == said
