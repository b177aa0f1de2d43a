"""Flights that lack something or are wrong: a note or a DataError, never NaN, a warning or an error of NumPy."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import companion as c
from companion.estimation import POSITION, BestEstimate, smooth
from companion.model import DataError, Flight, NoEstimateError
from tests.estimation.sensed import errors, sensed, with_imu
from tests.recordings import BUNDLED

pytestmark = pytest.mark.slow


def sound(found: BestEstimate) -> None:
    """Every number of the estimate is one, and σ is positive."""
    for values in (found.q_ned_frd, found.velocity, found.position, found.states.constants, found.constants_sigma):
        assert np.isfinite(values).all()
    for values in (found.covariance, found.gyro_bias_sigma, found.accel_bias_sigma):
        assert np.isfinite(values).all()
    assert (np.diagonal(found.covariance, axis1=1, axis2=2) > 0).all()
    assert (np.diff(found.t) > 0).all()
    for left in found.residuals.values():
        assert np.isfinite(left.value).all()


def no_compass(flight: Flight) -> Flight:
    return replace(flight, compasses=())


def no_gps(flight: Flight) -> Flight:
    return replace(flight, gps=())


def neither(flight: Flight) -> Flight:
    return replace(flight, gps=(), compasses=())


def imu_alone(flight: Flight) -> Flight:
    return replace(flight, gps=(), compasses=(), barometers=(), attitude=None, origin=None, epoch=None)


def compass_zero(flight: Flight) -> Flight:
    (compass,) = flight.compasses
    return replace(flight, compasses=(replace(compass, field=np.zeros_like(compass.field)),))


def compass_in_a_motors_field(flight: Flight) -> Flight:
    (compass,) = flight.compasses
    return replace(flight, compasses=(replace(compass, field=compass.field + [4e-4, -3e-4, 5e-4]),))


def gap(flight: Flight) -> Flight:
    imu = flight.imu()
    keep = (imu.t < 12.0) | (imu.t > 16.0)
    return with_imu(flight, replace(imu, t=imu.t[keep], gyro=imu.gyro[keep], accel=imu.accel[keep]))


def gps_of_nan(flight: Flight) -> Flight:
    (gps,) = flight.gps
    lost = np.arange(len(gps)) % 3 > 0
    return replace(
        flight,
        gps=(
            replace(
                gps,
                latitude=np.where(lost, np.nan, gps.latitude),
                height=np.where(lost, np.nan, gps.height),
                velocity=np.full_like(gps.velocity, np.nan),
                horizontal_sigma=np.full(len(gps), np.nan),
            ),
        ),
    )


def all_nan(flight: Flight) -> Flight:
    (gps,), (compass,), (barometer,) = flight.gps, flight.compasses, flight.barometers
    return replace(
        flight,
        gps=(replace(gps, latitude=np.full(len(gps), np.nan), velocity=np.full_like(gps.velocity, np.nan)),),
        compasses=(replace(compass, field=np.full_like(compass.field, np.nan)),),
        barometers=(replace(barometer, altitude=np.full(len(barometer), np.nan)),),
    )


def gps_of_another_clock(flight: Flight) -> Flight:
    """Times in UNIX seconds: none of the flight."""
    (gps,) = flight.gps
    return replace(flight, gps=(replace(gps, t=gps.t + 1.75e9),))


def few_fixes(flight: Flight) -> Flight:
    (gps,) = flight.gps
    return replace(flight, gps=(replace(gps, fix_type=np.where(np.arange(len(gps)) < 7, 3.0, 1.0)),))


def frozen(flight: Flight) -> Flight:
    """Readings that never change."""
    imu = flight.imu()
    level = np.tile([0.0, 0.0, -9.8], (len(imu), 1))
    return with_imu(flight, replace(imu, gyro=np.zeros_like(imu.gyro), accel=level))


def zero(flight: Flight) -> Flight:
    imu = flight.imu()
    return with_imu(flight, replace(imu, gyro=np.zeros_like(imu.gyro), accel=np.zeros_like(imu.accel)))


def absurd(flight: Flight) -> Flight:
    imu = flight.imu()
    return with_imu(flight, replace(imu, gyro=imu.gyro * 1e4, accel=imu.accel * 1e6))


def gps_beyond_squaring(flight: Flight) -> Flight:
    """A velocity whose square is infinite."""
    (gps,) = flight.gps
    return replace(flight, gps=(replace(gps, velocity=np.full_like(gps.velocity, 1e200)),))


def seldom_told(flight: Flight) -> Flight:
    """A compass and a barometer that read every other second, and never where a keyframe is."""
    (compass,), (barometer,) = flight.compasses, flight.barometers
    return replace(
        flight,
        gps=(),
        compasses=(replace(compass, t=compass.t[::20] + 0.25, field=compass.field[::20]),),
        barometers=(
            replace(
                barometer,
                t=barometer.t[::20] + 0.25,
                pressure=barometer.pressure[::20],
                altitude=barometer.altitude[::20],
                temperature=barometer.temperature[::20],
            ),
        ),
    )


BAD: dict[Callable[[Flight], Flight], str] = {
    no_compass: "",
    no_gps: "no GPS",
    neither: "no GPS",
    imu_alone: "no GPS",
    compass_zero: "no compass is used",
    compass_in_a_motors_field: "no compass is used",
    gap: "gap",
    gps_of_nan: "",
    all_nan: "",
    gps_of_another_clock: "GPS",
    few_fixes: "",
    frozen: "",
    zero: "",
    absurd: "",
    gps_beyond_squaring: "",
    seldom_told: "no GPS",
}
"""What is done to a flight, and what a note has to speak of then; a DataError instead is as good."""


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("bend", "note"), BAD.items(), ids=[bend.__name__ for bend in BAD])
def test_what_is_wrong_is_told_or_survived(bend: Callable[[Flight], Flight], note: str) -> None:
    flight, _ = sensed(30.0, "circle", rate=50.0)
    found: BestEstimate | None = None
    with contextlib.suppress(DataError):
        found = smooth(bend(flight))
    if found is not None:
        sound(found)
        assert not note or any(note in said for said in found.notes)


@pytest.mark.parametrize("rate", [0.5, 1.0])
def test_an_imu_that_is_too_slow_is_an_error_that_says_what_to_do(rate: float) -> None:
    flight, _ = sensed(50.0, "circle", rate=rate)
    with pytest.raises(NoEstimateError, match="RAW_IMU: it has .* Hz.*1.5 Hz or more"):
        smooth(flight)


def test_no_step_that_is_not_finite_is_taken() -> None:
    flight, _ = sensed(30.0, "circle", rate=50.0)
    with pytest.raises(NoEstimateError, match="no best estimate from RAW_IMU: "):
        smooth(gps_beyond_squaring(flight))


def test_a_compass_that_reads_once_a_second_is_used_without_gps() -> None:
    """Its readings are 0.2 s away from the keyframes, which stand every half second there."""
    flight, _ = sensed(30.0, "circle", rate=50.0)
    (compass,) = flight.compasses
    at = np.searchsorted(compass.t, np.arange(flight.start + 1.2, compass.t[-1]))
    slow = replace(compass, t=compass.t[at], field=compass.field[at])
    found = smooth(replace(flight, gps=(), compasses=(slow,)))
    assert len(found.residuals["compass"].t) > 20


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "place",
    [(0.3, np.pi - 1e-6, 10.0), (np.radians(89.9), 1.0, 10.0), (np.radians(-89.995), 0.0, 0.0)],
    ids=["date line", "north pole", "south pole"],
)
def test_no_place_on_earth_is_different(place: tuple[float, float, float]) -> None:
    flight, truth = sensed(40.0, rate=50.0, place=place)
    found = smooth(flight)
    sound(found)
    error = errors(found, truth)
    assert np.percentile(np.linalg.norm(error[:, POSITION], axis=1), 95) < 1.0
    assert np.percentile(np.linalg.norm(error[:, :2], axis=1), 95) < np.radians(0.5)


def test_nothing_is_wrong_with_the_bundled_demo() -> None:
    flight = c.open_log(BUNDLED / "copter-demo-100hz.tlog")[0]
    found = c.smooth(flight)
    sound(found)
    assert found.explained == ()
    assert found.heading_from == "compass"
