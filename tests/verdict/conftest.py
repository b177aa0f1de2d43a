"""What several tests of the analysis ask of."""

from __future__ import annotations

import pytest

from companion.estimation import BestEstimate, smooth
from companion.model import Flight
from tests.estimation.sensed import sensed


@pytest.fixture(scope="session")
def flight() -> Flight:
    """A minute at 50 Hz, without any fault, heard by every aiding sensor."""
    return sensed(60.0, rate=50.0)[0]


@pytest.fixture(scope="session")
def best(flight: Flight) -> BestEstimate:
    return smooth(flight)
