"""Compass, barometer and GPS that read the same while the vehicle flies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import companion as c
from companion.comparison import GENERIC
from companion.model import Array, Flight, Series
from companion.verdict import Finding, assess
from companion.verdict.findings.aiding import screened_aiding
from companion.verdict.findings.detect import misled
from tests.flights import CIRCLE, LIVELY, flown
from tests.recordings import BUNDLED, shared

BEGIN, END = 30.0, 40.0


def held(t: Array, values: Array) -> Array:
    """Values that stay as they are at 30 s until 40 s."""
    during = (t >= BEGIN) & (t < END)
    out = values.copy()
    out[during] = values[np.argmax(during)]
    return out


def compass(flight: Flight) -> Flight:
    one = flight.compasses[0]
    return replace(flight, compasses=(replace(one, field=held(one.t, one.field)),))


def barometer(flight: Flight) -> Flight:
    one = flight.barometers[0]
    return replace(
        flight, barometers=(replace(one, pressure=held(one.t, one.pressure), altitude=held(one.t, one.altitude)),)
    )


def gps(flight: Flight) -> Flight:
    one = flight.gps[0]
    names = ("latitude", "longitude", "height", "velocity")
    frozen: dict[str, Any] = {name: held(one.t, getattr(one, name)) for name in names}
    return replace(flight, gps=(replace(one, **frozen),))


def of_one_length(flight: Flight) -> Flight:
    one = flight.compasses[0]
    during = ((one.t >= BEGIN) & (one.t < END))[:, None]
    unit = one.field / np.linalg.norm(one.field, axis=1)[:, None]
    return replace(flight, compasses=(replace(one, field=np.where(during, 67e-6 * unit, one.field)),))


FREEZE: dict[str, tuple[Callable[[Flight], Flight], str, str]] = {
    "compass": (compass, "compass_frozen", "compasses"),
    "a length of the field": (of_one_length, "compass_frozen", "compasses"),
    "barometer": (barometer, "barometer_frozen", "barometers"),
    "GPS": (gps, "gps_frozen", "gps"),
}


@pytest.mark.parametrize("name", FREEZE)
def test_a_frozen_sensor_is_named_and_its_readings_are_taken_out(name: str) -> None:
    freeze, kind, tracks = FREEZE[name]
    flight = freeze(flown(LIVELY))
    seen, found = screened_aiding(flight, flight.imu())
    assert [f.kind for f in found] == [kind]
    assert (found[0].start_s, found[0].end_s) == pytest.approx((BEGIN, END), abs=0.5)
    left, all_of_them = getattr(seen, tracks)[0].t, getattr(flight, tracks)[0].t
    assert not ((left > BEGIN + 0.5) & (left < END - 0.5)).any()
    assert len(left) == len(all_of_them) - ((all_of_them >= BEGIN) & (all_of_them < END)).sum() + 1
    assert seen.imus is flight.imus


def test_what_is_frozen_in_flight_is_no_reading_after_the_landing_either() -> None:
    flight = flown()
    one = flight.compasses[0]
    stopped = np.where((one.t >= BEGIN)[:, None], one.field[np.argmax(one.t >= BEGIN)], one.field)
    landed = (*flight.events, c.Event(50.0, "disarmed", "disarmed"))
    left, (said,) = screened_aiding(
        replace(flight, compasses=(replace(one, field=stopped),), events=landed), flight.imu()
    )
    assert said.end_s == pytest.approx(50.0, abs=0.1)
    assert left.compasses[0].t[-1] == pytest.approx(BEGIN, abs=0.1)


def test_a_receiver_may_hold_its_fix_while_a_rover_stands_but_not_while_it_moves() -> None:
    flight = gps(flown(LIVELY))
    rover = replace(flight, vehicle=replace(flight.vehicle, type="GROUND_ROVER"))
    stands = (replace(rover.gps[0], velocity=np.zeros_like(rover.gps[0].velocity)),)
    assert [f.kind for f in screened_aiding(rover, rover.imu())[1]] == ["gps_frozen"]
    assert screened_aiding(replace(rover, gps=stands), rover.imu())[1] == []


def test_sensors_in_order_are_not_frozen() -> None:
    for flight in (flown(LIVELY), flown(CIRCLE), c.open_log(BUNDLED / "copter-demo-100hz.tlog")[0]):
        seen, found = screened_aiding(flight, flight.imu())
        assert found == []
        assert seen is flight


def test_a_compass_without_noise_reads_the_same_where_nothing_turns() -> None:
    """As a simulator's in whole milligauss, and sent ten times as often as it reads; a gyro's bias is no turn."""
    flight = flown(CIRCLE)
    one, imu = flight.compasses[0], flight.imu()
    coarse = np.round(np.repeat(one.field[::10], 10, axis=0)[: len(one)], 7)
    coarse = np.where(((one.t >= BEGIN) & (one.t < END))[:, None], coarse[np.argmax(one.t >= BEGIN)], coarse)
    still = ((imu.t >= BEGIN - 0.1) & (imu.t < END + 0.1))[:, None]
    gyro = np.where(still, [0.0, 0.0, 0.03], imu.gyro)
    flight = replace(flight, compasses=(replace(one, field=coarse),), imus={imu.source: replace(imu, gyro=gyro)})
    assert screened_aiding(flight, flight.imu())[1] == []


def test_a_compass_that_never_reads_anything_else_is_named_too() -> None:
    """No track is made of it."""
    flight = flown(LIVELY)
    one = flight.compasses[0]
    constant = np.tile([67e-6, 0.0, 0.0], (len(one), 1))
    names = ("x_tesla", "y_tesla", "z_tesla")
    series = {"magnetometer": Series(one.t, constant, names, "MAG[0]", 0)}
    found = screened_aiding(replace(flight, compasses=(), series=series), flight.imu())[1]
    assert [f.kind for f in found] == ["compass_frozen"]


@pytest.mark.slow
def test_a_frozen_gps_does_not_end_the_judgement_of_the_rest() -> None:
    found = assess(gps(flown(LIVELY)), GENERIC).verdict
    said = next(f for f in found.findings if f.kind == "gps_frozen")
    assert (said.severity, said.side) == ("warning", "data")  # this autopilot knew better
    assert found.status == "consistent"


def test_an_autopilot_that_is_misled_by_a_frozen_sensor_has_that_as_the_cause() -> None:
    flight = compass(flown(LIVELY))
    _, found = screened_aiding(flight, flight.imu())
    off = Finding("heading_off", "autopilot", "error", BEGIN + 5.0, END, "its heading is off by 40°", "look at it")
    (said, _) = misled([*found, off])
    assert (said.side, said.severity) == ("autopilot", "error")
    assert said.cause is not None
    assert (said.cause.sensor, said.cause.consequences) == ("compass", ("its heading is off by 40°",))
    for innocent in (replace(off, start_s=BEGIN - 5.0), replace(off, kind="height_off"), replace(off, side="data")):
        assert misled([*found, innocent]) == [*found, innocent]


@pytest.mark.slow
def test_a_recorded_compass_that_reads_67_for_ever() -> None:
    flight = c.open_log(shared("strangers/erlerobot__logs__83.BIN"))[0]
    assert "compass_frozen" in [f.kind for f in screened_aiding(flight, flight.imu())[1]]


def test_a_gps_that_leaps_about_is_left_out_and_one_jump_is_not() -> None:
    flight, rng = flown(), np.random.default_rng(4)
    one = flight.gps[0]
    during = (one.t >= BEGIN) & (one.t < END)
    jammed = replace(one, latitude=one.latitude + np.where(during, rng.normal(0.0, 5e-4, len(one.t)), 0.0))
    seen, found = screened_aiding(replace(flight, gps=(jammed,)), flight.imu())
    assert [(f.kind, f.side) for f in found] == [("gps_inconsistent", "data")]
    assert found[0].start_s == pytest.approx(BEGIN, abs=1.0)
    assert found[0].end_s == pytest.approx(END, abs=1.0)
    assert len(seen.gps[0]) <= len(one) - during.sum() + 2
    shifted = replace(one, latitude=one.latitude + np.where(during, 5e-4, 0.0))
    assert screened_aiding(replace(flight, gps=(shifted,)), flight.imu())[1] == []
    leaping = replace(one, velocity=one.velocity + np.where(during, rng.normal(0.0, 60.0, len(one.t)), 0.0)[:, None])
    assert [f.kind for f in screened_aiding(replace(flight, gps=(leaping,)), flight.imu())[1]] == ["gps_inconsistent"]


@pytest.mark.parametrize(("degrees", "says"), [(110.0, True), (-50.0, True), (80.0, False), (np.nan, False)])
def test_a_barometer_beyond_what_it_is_made_for_is_left_out(degrees: float, *, says: bool) -> None:
    flight = flown(LIVELY)
    (one,) = flight.barometers
    hot = np.where((one.t >= BEGIN) & (one.t < END), degrees, one.temperature)
    without, found = screened_aiding(replace(flight, barometers=(replace(one, temperature=hot),)), flight.imu())
    assert [f.kind for f in found] == ["barometer_out_of_range"] * says
    (left,) = without.barometers
    assert ((left.t < BEGIN) | (left.t >= END)).all() == says


def test_one_damaged_temperature_is_no_finding() -> None:
    flight = flown(LIVELY)
    (one,) = flight.barometers
    damaged = np.where(np.arange(len(one)) == 7, -174.0, one.temperature)
    assert screened_aiding(replace(flight, barometers=(replace(one, temperature=damaged),)), flight.imu())[1] == []
