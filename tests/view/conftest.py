from __future__ import annotations

import pytest

from companion.tracks import Flight
from tests.view.circles import make_flight


@pytest.fixture
def flight() -> Flight:
    """A minute of circles."""
    return make_flight()
