"""The Earth's field: NOAA's test values of the World Magnetic Model 2020; and compasses that are turned beside it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from companion.estimation import BestEstimate, righted, smooth, turned_compasses
from companion.estimation.earth_field import field_at
from companion.model import Epoch, Flight, Origin, orientation_number, orientations
from companion.strapdown import quaternion
from tests.estimation.sensed import sensed

BEGIN_2020, MIDDLE_2022 = Epoch(1_577_923_200.0, "GPS"), Epoch(1_656_676_800.0, "GPS")


@pytest.mark.parametrize(
    ("latitude", "longitude", "height", "epoch", "nanotesla"),
    [
        (80.0, 0.0, 0.0, BEGIN_2020, (6570.4, -146.3, 54606.0)),
        (0.0, 120.0, 0.0, BEGIN_2020, (39624.3, 109.9, -10932.5)),
        (-80.0, 240.0, 100_000.0, MIDDLE_2022, (5815.0, 14803.0, -49755.3)),
    ],
)
def test_it_is_that_of_the_model_to_the_north_the_east_and_down(
    latitude: float, longitude: float, height: float, epoch: Epoch, nanotesla: tuple[float, float, float]
) -> None:
    """height: m. Within what the model's field changes by in a day."""
    found = field_at(Origin(np.radians(latitude), np.radians(longitude), height), epoch)
    assert found is not None
    assert found.ned * 1e9 == pytest.approx(nanotesla, abs=0.5)
    assert found.declination == pytest.approx(np.arctan2(nanotesla[1], nanotesla[0]), abs=1e-4)
    assert found.inclination == pytest.approx(np.arctan2(nanotesla[2], np.hypot(*nanotesla[:2])), abs=1e-4)


@cache
def healthy() -> Flight:
    return sensed(60.0, rate=50.0)[0]


def mounted(number: int) -> Flight:
    """Its compass mounted so, and read as if it were not turned."""
    (one,) = healthy().compasses
    back = quaternion.conjugate(orientations()[number])
    return replace(healthy(), compasses=(replace(one, field=quaternion.rotate(back, one.field)),))


@cache
def smoothed() -> BestEstimate:
    return smooth(healthy())


@cache
def alone() -> BestEstimate:
    return smooth(replace(healthy(), compasses=()))


def without(flight: Flight) -> BestEstimate:
    assert not flight.compasses
    return alone()


@pytest.mark.parametrize("number", [1, 2, 4, 7, 8, 12, 24, 31, 38])
def test_its_orientation_is_found(number: int) -> None:
    flight = mounted(number)
    (one,) = turned_compasses(flight, smoothed(), without)
    assert orientation_number(orientations()[number])[0] == one.orientation
    assert one.off > np.radians(30.0)
    assert one.left < np.radians(3.0)
    (field,), (true,) = ([c.field for c in f.compasses] for f in (righted(flight, (one,)), healthy()))
    assert np.allclose(field, true)


@pytest.mark.parametrize("number", [1, 24])
def test_an_estimate_that_it_led_astray_shows_it(number: int) -> None:
    flight = mounted(number)
    (one,) = turned_compasses(flight, smooth(flight), without)
    assert one.orientation == number


def test_one_in_order_costs_no_estimate() -> None:
    def never(_: Flight) -> BestEstimate:
        raise AssertionError

    assert turned_compasses(healthy(), smoothed(), never) == ()


@pytest.mark.parametrize("iron", [(40e-6, 0.0, 0.0), (-30e-6, 60e-6, 20e-6)])
def test_iron_on_the_vehicle_is_no_orientation(iron: tuple[float, float, float]) -> None:
    (one,) = healthy().compasses
    flight = replace(healthy(), compasses=(replace(one, field=one.field + np.array(iron)),))
    assert turned_compasses(flight, smoothed(), without) == ()


def test_without_a_heading_nothing_is_told() -> None:
    flight = replace(mounted(2), gps=())
    assert turned_compasses(flight, smoothed(), smooth) == ()


def test_a_turn_that_is_none_of_the_list_is_no_orientation() -> None:
    (one,) = healthy().compasses
    turn = quaternion.exp(np.array([0.0, 0.0, np.radians(22.5)]))
    flight = replace(healthy(), compasses=(replace(one, field=quaternion.rotate(turn, one.field)),))
    assert turned_compasses(flight, smoothed(), without) == ()
