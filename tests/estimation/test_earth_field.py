"""The Earth's field: NOAA's test values of the World Magnetic Model 2020."""

from __future__ import annotations

import numpy as np
import pytest

from companion.estimation.earth_field import field_at
from companion.model import Epoch, Origin

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
