"""A row for each aiding sensor, and what a rangefinder adds to a flight."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from companion.estimation import POSITION, smooth
from companion.estimation.aiding_sensors import SENSORS
from companion.estimation.readings import Intake
from companion.model import Array, Flight, GpsTrack, RangeTrack
from companion.strapdown import Motion
from tests.estimation.sensed import errors, range_of, sensed


def with_range(flight: Flight, truth: Motion, ground: Callable[[Array], Array] | None = None) -> Flight:
    return replace(flight, ranges=(range_of(truth, np.random.default_rng(5), ground),))


def without_height(gps: GpsTrack) -> GpsTrack:
    unknown = np.full(len(gps), np.nan)
    return replace(gps, height=unknown, velocity=np.column_stack([gps.velocity[:, :2], unknown]))


@pytest.mark.parametrize("path", ["square", "heave"])
def test_with_no_other_height_a_rangefinder_keeps_it_known(path: str) -> None:
    flight, truth = sensed(60.0, path)
    flight = replace(flight, barometers=(), gps=(without_height(flight.gps[0]),))
    for ranged, least, most in ((flight, 1.0, np.inf), (with_range(flight, truth), 0.0, 0.2)):
        best = smooth(ranged)
        off = errors(best, truth)[:, POSITION.stop - 1]
        off, sigma = off[1:] - off[0], best.change_sigma(POSITION, since=0)[1:, 2]
        assert least < np.abs(off).max() < most
        assert (np.abs(off) < 3.0 * sigma).all(), "and says how well"
        assert least < np.median(sigma) < 5.0 * most


def hills(t: Array) -> Array:
    """m: a slope of 5 % at 5 m/s, and two roofs of 4 m."""
    roofs = ((t > 14.0) & (t < 18.0)) | ((t > 41.0) & (t < 44.0))
    return np.asarray(0.25 * np.clip(t - 20.0, 0.0, 25.0) + 4.0 * roofs)


def test_uneven_ground_is_no_fault_of_any_sensor_and_moves_no_other_height() -> None:
    flight, truth = sensed(60.0)
    level, uneven = (smooth(one) for one in (flight, with_range(flight, truth, hills)))
    assert not uneven.explained
    assert all(one.fault_log_odds < 0.0 for one in uneven.further)
    np.testing.assert_allclose(uneven.position, level.position, atol=0.5)


def read_of(flight: Flight, *ranges: RangeTrack) -> Array:
    t = flight.imu().t[::40]
    row = SENSORS["rangefinder"]
    assert row.read is not None
    readings = row.read(row, Intake(replace(flight, ranges=ranges), flight.imu(), t, 0.4, None, None, []))
    return np.zeros(0) if readings is None else readings.value[:, 0]


def test_only_a_rangefinder_that_looks_down_is_read_and_only_within_its_range() -> None:
    flight, truth = sensed(20.0, "heave")
    down = range_of(truth, np.random.default_rng(0))
    assert not len(read_of(flight, replace(down, orientation=0), replace(down, orientation=None)))
    middle = float(np.median(down.distance))
    short = replace(down, distance=np.clip(down.distance, middle - 0.2, middle + 0.2), least=middle - 0.2,
                    most=middle + 0.2)  # fmt: skip
    assert 5 < len(read_of(flight, short)) < len(read_of(flight, down))
    assert (np.abs(read_of(flight, short) - middle) < 0.2).all(), "at an end it is saturated"
    assert len(read_of(flight, short, down)) == len(read_of(flight, down)), "the one with the most readings"


def test_a_reading_that_a_compass_lacks_is_left_out_and_the_others_are_read() -> None:
    flight, _ = sensed(20.0)
    (compass,) = flight.compasses
    field = compass.field.copy()
    field[7] = np.nan
    t, row, notes = flight.imu().t[::40], SENSORS["compass"], list[str]()
    assert row.read is not None
    lacking = replace(flight, compasses=(replace(compass, field=field),))
    readings = row.read(row, Intake(lacking, flight.imu(), t, 0.4, None, None, notes))
    assert not notes
    assert readings is not None
    assert np.isfinite(readings.value).all()
