"""What is fixed before the smoother iterates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.setup import set_up
from companion.model import STANDARD_GRAVITY
from tests.estimation.sensed import sensed, with_imu


@pytest.mark.parametrize("corner", [10.0, 20.0, 40.0])
def test_readings_behind_a_low_pass_stand_at_the_times_that_they_speak_of(corner: float) -> None:
    import scipy.signal  # noqa: PLC0415  (slow to import, and every process of the tests collects this file)

    flight, truth = sensed(10.0, rate=400.0)
    slow = np.outer(np.sin(2.0 * np.pi * 0.4 * truth.t), [1.0, -0.5, 0.2])
    passed = scipy.signal.lfilter(*scipy.signal.butter(2, corner, fs=400.0), slow, axis=0)
    filtered = replace(flight.imu(), gyro=passed, low_pass_hz=corner)
    track = set_up(with_imu(flight, filtered), None, STANDARD_GRAVITY, None).imu
    settled = track.t > 2.0
    spoken_of = np.outer(np.sin(2.0 * np.pi * 0.4 * track.t), [1.0, -0.5, 0.2])
    np.testing.assert_allclose(track.gyro[settled], spoken_of[settled], atol=3e-3)
