"""What the parameters say of an IMU."""

from __future__ import annotations

import numpy as np
import pytest

from companion.model import ImuTrack, Vehicle
from companion.telemetry.parameters import with_facts

PX4 = Vehicle(1, 1, "PX4", "QUADROTOR")


@pytest.mark.parametrize("rate", [100.0, 200.0, 400.0])
def test_px4s_means_stand_at_the_middles_of_their_intervals(rate: float) -> None:
    """They are stamped at the end of them: of a rate that grows evenly each then is the rate of its time."""
    stamps = np.arange(1.0, 2.0, 0.02)
    growing = np.outer(stamps - 0.5 / rate, [1.0, -2.0, 0.5])  # the mean of the interval that has ended
    track = with_facts(ImuTrack(stamps, growing, growing, "SCALED_IMU"), PX4, {"IMU_INTEG_RATE": rate})
    np.testing.assert_allclose(track.gyro, np.outer(track.t, [1.0, -2.0, 0.5]), atol=1e-12)
    assert track.interval == pytest.approx(1.0 / rate)
