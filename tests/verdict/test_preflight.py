"""Before take-off: a healthy vehicle is fit to fly, a fault of twice a limit is no-go."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from companion.comparison import GENERIC
from companion.constants import harm, healthy
from companion.model import (
    STANDARD_GRAVITY,
    Array,
    BiasTrack,
    DataError,
    Event,
    Flight,
    ImuTrack,
    StatusText,
    rows,
)
from companion.strapdown import ImuModel, Sensor, motions, simulate
from companion.verdict import Check, Preflight, ageing, preflight
from companion.verdict.preflight import _sigma
from tests.flights import VEHICLE, aided, flight_of, seconds

MOTION = motions.rest(seconds(40.0, 100.0))
PART = ImuModel(
    gyro=Sensor(noise_density=GENERIC.gyro.noise_density, bias=np.array([1e-3, -1e-3, 5e-4])),
    accel=Sensor(noise_density=GENERIC.accel.noise_density, bias=np.array([0.05, 0.02, -0.05])),
)
X = np.array([1.0, 0.0, 0.0])
TURNED = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # by 90° about down


def standing(seed: int = 1, *, off: Array | float = 0.0, push: Array | float = 0.0, **changes: object) -> Flight:
    """40 s on the ground with two IMUs and every aiding sensor; the first IMU's readings off by as much."""
    first, second = (
        replace(simulate(MOTION.imu, PART, np.random.default_rng(seed + i)), source=name, instance=i)
        for i, name in enumerate(("IMU[0]", "IMU[1]"))
    )
    first = replace(first, gyro=first.gyro + off, accel=first.accel + push)
    flight = flight_of(MOTION, imus={"IMU[0]": first, "IMU[1]": second}, events=(Event(10.0, "disarmed", ""),))
    return replace(aided(flight, MOTION, seed=seed), **changes)  # type: ignore[arg-type]


def checked(flight: Flight) -> Preflight:
    return preflight(flight, lambda _: GENERIC)


def line(result: Preflight, name: str, sensor: str = "IMU[0]") -> Check:
    return next(one for one in result.checks if (one.name, one.sensor) == (name, sensor))


@pytest.mark.parametrize("seed", range(5))
def test_a_healthy_vehicle_is_fit_to_fly(seed: int) -> None:
    result = checked(standing(seed))
    assert [one for one in result.checks if one.outcome != "go"] == []
    assert result.outcome == "go"
    assert result.motors_off
    assert result.end_s - result.start_s > 35.0
    names = {one.name for one in result.checks}
    assert {"gyro_bias", "gyro_warming", "gyro_noise", "accel_size", "accel_direction", "gyro_difference"} <= names
    assert {"compass_field", "compass_inclination", "compass_heading", "barometer_wander", "gps_satellites"} <= names


LEANS = STANDARD_GRAVITY * np.sin(2.0 * harm.AP_ERROR["tilt"]) * X


@pytest.mark.parametrize(("imus", "named"), [(2, "IMU[0], IMU[1]"), (3, "IMU[0]")])
def test_of_two_imus_that_lean_apart_neither_is_named_and_of_three_the_odd_one(imus: int, named: str) -> None:
    """The estimate leans with the IMU that it follows, so that the healthy one of two differs from it."""
    flight = standing(push=LEANS)
    third = replace(flight.imus["IMU[1]"], source="IMU[2]", instance=2)
    result = checked(replace(flight, imus={**flight.imus, "IMU[2]": third} if imus == 3 else flight.imus))
    assert [one.sensor for one in result.checks if (one.name, one.outcome) == ("accel_direction", "no_go")] == [named]
    assert result.outcome == "no_go"


GYRO, ACCEL = healthy.USUAL_BIAS["gyro"], float(np.hypot(healthy.USUAL_BIAS["accel"], 0.03 * STANDARD_GRAVITY))

FAULTS: dict[str, Callable[[], Flight]] = {
    "gyro_bias": lambda: standing(off=2.0 * GYRO * X),
    "gyro_warming": lambda: standing(off=2.0 * GYRO / harm.WARMING_S * (MOTION.t - MOTION.t[0])[:, None] * X),
    "accel_size": lambda: standing(push=np.array([0.0, 0.0, -2.0 * ACCEL])),
    "accel_direction": lambda: standing(push=LEANS),
    "gyro_noise": lambda: standing(
        off=20.0
        * GENERIC.gyro.noise_density
        * np.sqrt(100.0)
        * np.random.default_rng(3).normal(size=(len(MOTION.t), 3))
        * 0.7
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_of_twice_its_limit_is_no_go(name: str) -> None:
    result = checked(FAULTS[name]())
    bad = next(one for one in result.checks if (one.name, one.outcome) == (name, "no_go"))
    assert bad.sensor.startswith("IMU[0]")
    assert bad.probability > 0.95
    assert result.outcome == "no_go"
    assert not [one for one in result.checks if one.outcome == "no_go" and one.sensor == "IMU[1]"]


@pytest.mark.parametrize("push", [4.0 * X, np.array([0.0, 0.0, 2.0 * STANDARD_GRAVITY])], ids=["leans", "flipped"])
def test_no_compass_is_blamed_for_an_accelerometer(push: Array) -> None:
    """Its inclination is against gravity, of an IMU that feels it."""
    result = checked(standing(push=push))
    assert result.outcome == "no_go"
    assert {one.name.split("_")[0] for one in result.checks if one.outcome != "go"} == {"accel"}


def test_the_limits_of_ekf3_for_a_gps_are_those_that_are_set() -> None:
    scaled = checked(standing(parameters={"EK3_CHECK_SCALE": 200.0}))
    made = line(scaled, "gps_horizontal_sigma", "GPS_RAW_INT")
    assert made.autopilot_limit == 2.0 * harm.GPS_POOR["horizontal_sigma"]
    assert made.limit == line(checked(standing()), "gps_horizontal_sigma", "GPS_RAW_INT").autopilot_limit


@pytest.mark.parametrize(("degrees", "limit"), [(None, 60.0), (30.0, 30.0), (-1.0, None)])
def test_px4_compares_compasses_as_it_is_set_to(degrees: float | None, limit: float | None) -> None:
    flight = standing(vehicle=replace(VEHICLE, autopilot="PX4"))
    (compass,) = flight.compasses
    both = tuple(replace(compass, source=name, instance=i) for i, name in enumerate("AB"))
    parameters = {} if degrees is None else {"COM_ARM_MAG_ANG": degrees}
    made = line(checked(replace(flight, compasses=both, parameters=parameters)), "compass_difference", "A, B")
    assert made.autopilot_limit == (None if limit is None else pytest.approx(np.radians(limit)))


def test_ardupilot_lets_a_third_accelerometer_differ_three_times_as_much() -> None:
    flight = standing(parameters={"ARMING_ACCTHRESH": 0.5})
    third = replace(flight.imus["IMU[1]"], source="IMU[2]", instance=2)
    result = checked(replace(flight, imus={**flight.imus, "IMU[2]": third}))
    assert line(result, "accel_difference", "IMU[0], IMU[1]").autopilot_limit == 0.5
    assert line(result, "accel_difference", "IMU[0], IMU[2]").autopilot_limit == 1.5
    assert line(result, "gyro_difference", "IMU[0], IMU[2]").autopilot_limit == pytest.approx(np.radians(5.0))


def test_a_sensor_that_falls_silent_is_said_to_be_unchecked() -> None:
    flight = standing()
    assert checked(flight).missing == ()
    (gps,), (compass,) = flight.gps, flight.compasses
    gone = replace(gps, t=gps.t - 100.0)
    assert checked(replace(flight, gps=(gone,))).missing == ("GPS GPS_RAW_INT: no readings while it stood",)
    early = rows(gps, gps.t < flight.start + 10.0)
    assert checked(replace(flight, gps=(early,))).missing == ("GPS GPS_RAW_INT: silent in the last 30 s",)
    raw = replace(compass, calibrated=False)
    assert checked(replace(flight, compasses=(raw,))).missing == ("compass RAW_IMU: too little is known of it",)


@pytest.mark.filterwarnings("error")
def test_an_accelerometer_that_reads_nothing_has_no_direction() -> None:
    flight = standing()
    dead = replace(flight.imus["IMU[0]"], accel=np.zeros_like(flight.imus["IMU[0]"].accel))
    result = checked(replace(flight, imus={**flight.imus, "IMU[0]": dead}))
    assert line(result, "accel_frozen").outcome == "no_go"
    assert line(result, "accel_size").outcome == "no_go"
    assert all(np.isfinite([one.size, one.sigma, one.probability]).all() for one in result.checks)
    assert ("accel_direction", "IMU[0]") not in {(one.name, one.sensor) for one in result.checks}


def test_a_bias_that_the_estimator_takes_off_is_none() -> None:
    known = np.tile(2.0 * GYRO * X, (2, 1))
    nothing = np.full((2, 3), np.nan)
    bias = BiasTrack(np.array([10.0, 49.0]), known, nothing, nothing, nothing, "XKF1[0]", 0, 0)
    result = checked(standing(off=2.0 * GYRO * X, biases=(bias,)))
    assert line(result, "gyro_bias").outcome == "go"
    assert "mrad/s" in line(result, "gyro_bias").note


@pytest.mark.parametrize("sensor", ["gyro", "accel"])
def test_one_axis_that_reads_the_same_is_no_go(sensor: str) -> None:
    """But for its last digits, which flicker as floats do."""
    flight = standing()
    first = flight.imus["IMU[0]"]
    readings = getattr(first, sensor).copy()
    readings[:, 1] = 0.45 + np.random.default_rng(2).normal(0.0, 1e-8, len(first))
    stuck = replace(first, **{sensor: readings})
    result = checked(replace(flight, imus={**flight.imus, "IMU[0]": stuck}))
    frozen = line(result, f"{sensor}_frozen")
    assert (frozen.outcome, frozen.note) == ("no_go", "y reads the same")


def test_a_frozen_imu_is_no_go() -> None:
    flight = standing()
    first = flight.imus["IMU[0]"]
    frozen = replace(first, gyro=np.tile(first.gyro[0], (len(first), 1)))
    result = checked(replace(flight, imus={**flight.imus, "IMU[0]": frozen}))
    assert line(result, "gyro_frozen").outcome == "no_go"


def test_a_compass_beside_iron_is_no_go() -> None:
    flight = standing()
    iron = np.array([0.0, 0.0, 2.0 * healthy.USUAL_IRON * 1e-6])
    compasses = tuple(replace(one, field=one.field + iron) for one in flight.compasses)
    result = checked(replace(flight, compasses=compasses))
    assert {one.name for one in result.checks if one.outcome == "no_go"} & {"compass_field", "compass_inclination"}


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"satellites": 4.0}, "gps_satellites"),
        ({"fix_type": 2.0}, "gps_fix"),
        ({"horizontal_sigma": 2.0 * harm.GPS_POOR["horizontal_sigma"]}, "gps_horizontal_sigma"),
        ({"speed_sigma": 2.0 * harm.GPS_POOR["speed_sigma"]}, "gps_speed_sigma"),
    ],
)
def test_a_receiver_without_a_good_fix_is_no_go(change: dict[str, float], name: str) -> None:
    flight = standing()
    (gps,) = flight.gps
    columns: dict[str, Any] = {field: np.full(len(gps), value) for field, value in change.items()}
    poor = replace(gps, **columns)
    assert line(checked(replace(flight, gps=(poor,))), name, gps.source).outcome == "no_go"


def test_satellites_that_are_not_told_hold_nothing_up() -> None:
    """255 in GPS_RAW_INT."""
    flight = standing()
    (gps,) = flight.gps
    result = checked(replace(flight, gps=(replace(gps, satellites=np.full(len(gps), np.nan)),)))
    assert result.outcome == "go"
    assert "gps_satellites" not in {one.name for one in result.checks}


def test_a_reading_that_a_compass_lacks_is_left_out() -> None:
    flight = standing()
    (compass,) = flight.compasses
    field = compass.field.copy()
    field[100] = np.nan
    assert checked(replace(flight, compasses=(replace(compass, field=field),))).outcome == "go"


def test_how_well_noise_at_rest_is_known() -> None:
    """By how it differs from flight to flight: what it is at most of three axes."""
    lines = [line(checked(standing(seed)), "accel_noise") for seed in range(20)]
    spread = float(np.std([one.size for one in lines]))
    assert 0.5 * spread < np.mean([one.sigma for one in lines]) < 2.0 * spread


def test_a_mean_is_known_no_better_for_the_seconds_that_are_missing() -> None:
    t = np.arange(0.0, 60.0, 0.1)
    wander = np.repeat(np.random.default_rng(1).standard_normal((60, 3)), 10, axis=0)
    heard = (t < 8.0) | (t >= 53.0)
    assert _sigma(t[heard], wander[heard], 0.0) == pytest.approx(np.full(3, 15**-0.5), rel=0.5)


def test_what_is_not_in_the_log_is_said() -> None:
    result = checked(replace(standing(), gps=(), compasses=()))
    assert result.missing == ("compass: none in the log", "GPS: none in the log")
    assert result.outcome == "go"


def test_the_vehicles_own_refusals_are_told() -> None:
    texts = (StatusText(20.0, 2, "PreArm: Gyros inconsistent"), StatusText(21.0, 6, "EKF3 IMU0 is using GPS"))
    result = checked(standing(texts=texts))
    assert result.vehicle_reports == ("PreArm: Gyros inconsistent",)
    assert result.outcome == "unknown", "all checks are go, and it does not arm"
    events = (Event(10.0, "disarmed", ""), Event(49.0, "armed", ""))
    assert checked(standing(texts=texts, events=events)).outcome == "go", "it did in the end"


def test_of_three_compasses_the_one_against_the_others_is_named_though_the_autopilot_follows_it() -> None:
    flight = standing()
    (one,) = flight.compasses
    two = [replace(one, field=one.field @ TURNED.T, source=f"MAG[{i}]", instance=i) for i in (1, 2)]
    result = checked(replace(flight, compasses=(one, *two)))
    bad = {check.sensor for check in result.checks if check.name == "compass_heading" and check.outcome == "no_go"}
    assert bad == {one.source, "ATTITUDE"}


def test_only_what_lies_before_arming_is_looked_at() -> None:
    flight = standing()
    first = flight.imus["IMU[0]"]
    later = replace(first, gyro=first.gyro + np.where(first.t > 30.0, 0.05, 0.0)[:, None] * X)
    events = (Event(10.0, "disarmed", ""), Event(29.0, "armed", ""))
    result = checked(replace(flight, imus={"IMU[0]": later}, events=events))
    assert result.end_s <= 29.0
    assert result.outcome == "go"


def test_a_vehicle_that_never_stands_cannot_be_checked() -> None:
    moving = motions.coning(seconds(30.0, 100.0), frequency=1.0, angle=0.3)
    with pytest.raises(DataError, match="does not stand still"):
        checked(flight_of(moving))
    with pytest.raises(DataError, match="no IMU"):
        checked(Flight(VEHICLE, 1, 0.0, 10.0))


def test_ageing_is_a_change_against_the_vehicles_own_flights() -> None:
    before = [checked(standing(seed)).checks for seed in range(10, 14)]
    same = {one.check.name: one for one in ageing(checked(standing(20)), before) if one.check.sensor == "IMU[0]"}
    assert not [name for name, one in same.items() if one.changed and name != "accel_direction"]
    aged = {one.check.name: one for one in ageing(checked(standing(20, off=8e-3 * X)), before)}
    changed = next(o for o in ageing(checked(standing(20, off=8e-3 * X)), before) if o.check.sensor == "IMU[0]")
    assert changed.changed, "though within its limit"
    assert changed.check.outcome == "go"
    assert aged["gyro_bias"].times == 4
    assert ageing(checked(standing(20)), before[:2]) == ()


def test_the_order_of_the_imus_does_not_matter() -> None:
    flight = standing(off=2.0 * GYRO * X)
    turned: dict[str, ImuTrack] = dict(reversed(list(flight.imus.items())))
    one, other = checked(flight), checked(replace(flight, imus=turned))
    assert {c.name for c in one.checks if c.outcome == "no_go"} == {
        c.name for c in other.checks if c.outcome == "no_go"
    }
