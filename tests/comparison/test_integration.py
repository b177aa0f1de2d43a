"""Which gravity a flight is integrated with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import companion as c
from companion.comparison import gravity_for
from companion.model import DataError, Origin, SettingsError
from companion.strapdown import motions
from tests.flights import flight_of, seconds
from tests.recordings import BUNDLED

FLIGHT = flight_of(motions.rest(seconds(20, 100)))


def test_the_models() -> None:
    """WGS-84: 9.7803 at the equator, 9.8322 at the poles, 3.086e-6 m/s² less for each metre up."""
    zurich = replace(FLIGHT, origin=Origin(np.radians(47.4), np.radians(8.5), 430.0))
    assert gravity_for(FLIGHT, "standard") == 9.80665
    assert gravity_for(FLIGHT, 9.81) == 9.81
    assert gravity_for(zurich, "normal") == pytest.approx(9.8083 - 430 * 3.086e-6, abs=2e-4)
    with pytest.raises(DataError, match="no latitude"):
        gravity_for(FLIGHT, "normal")
    with pytest.raises(SettingsError, match="heavy"):
        gravity_for(FLIGHT, "heavy")


def test_a_gravity_error_falls_as_half_t_squared() -> None:
    row = c.drift(FLIGHT, horizons=(10,), how=c.Integration(gravity=9.80665 + 0.01)).rows[0]
    assert row.position_m
    assert row.position_m.median == pytest.approx(0.5 * 0.01 * 10**2, rel=1e-6)


def test_the_bundled_flight_knows_where_it_was() -> None:
    """SITL's home in Canberra: 35.36° south, 584 m."""
    origin = c.open_log(BUNDLED / "copter-demo-100hz.tlog")[0].origin
    assert origin
    assert np.degrees([origin.latitude, origin.longitude]) == pytest.approx([-35.3633, 149.1652], abs=1e-3)
    assert origin.height == pytest.approx(584, abs=3)
