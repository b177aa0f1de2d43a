"""What the accuracy benchmarks take a verdict to say."""

from __future__ import annotations

import pytest

from benchmarks.accuracy.answer import read_verdict
from companion.verdict import Verdict


@pytest.mark.parametrize(
    ("probability", "stated"),
    [
        ({"nobody": 0.98, "imu": 0.02}, 0.98),
        ({"nobody": 0.01, "gps": 0.97, "imu": 0.02}, 0.97),  # a fault of the GPS, which misled nobody
        ({}, None),
    ],
)
def test_a_consistent_verdict_states_the_probability_that_it_names(
    probability: dict[str, float], stated: float | None
) -> None:
    assert read_verdict(Verdict("consistent", "", (), None, probability)).stated == stated
