"""How large something was, in words: the right component, factor and σ."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from companion.estimation.hypotheses import Phrase, Size, by_axes, by_length, by_number

EARTH_FIELD = np.array([20.0, 5.0, 40.0])


@pytest.mark.parametrize(
    ("phrase", "value", "told"),
    [
        (partial(by_axes, "gyro", "bias", "mrad/s", 1e3, 1), [1e-4, 0.0, 0.02], "gyro z bias 20.0 ± 0.6 mrad/s"),
        (
            partial(by_axes, "gyro", "bias", "mrad/s", 1e3, 1),
            [0.01, 0.0, 0.02],
            "gyro bias x 10.0, y 0.0, z 20.0 ± 0.6 mrad/s",
        ),
        (
            partial(by_length, "the GPS", "m"),
            [3.0, -4.0],
            "the GPS is off by up to 5.000 ± 0.001 m (north 3.0, east -4.0)",
        ),
        (partial(by_length, "the barometer", "m"), [-4.0], "the barometer is off by up to 4.000 ± 0.001 m"),
        (partial(by_number, "late by {} ms", 2, 1e3), [-0.2], "late by -200.00 ± 0.60 ms"),
        (partial(by_number, "a turn of {} rad", 1, 1.0), [0.3, 0.0, 0.4], "a turn of 0.500 ± 0.001 rad"),
    ],
)
def test_a_size_in_words(phrase: Phrase, value: list[float], told: str) -> None:
    assert phrase(Size(np.array(value), 6e-4, EARTH_FIELD)) == told
