"""Which reading of a sensor stands at which keyframe."""

from __future__ import annotations

import numpy as np
import pytest

from companion.estimation.measurements import GPS_LATENCY_S, gps_readings, vector_readings
from companion.model import Array, GpsTrack
from companion.strapdown import motions
from tests.estimation.sensed import PLACE, gps_of

SPACING = 0.4
T = np.concatenate([np.arange(0.0, 10.0, SPACING), np.arange(20.0, 30.0, SPACING)])
"""Keyframes, with a gap in which there are none."""


@pytest.mark.parametrize("rate", [0.7, 2.5, 10.0, 50.0])
@pytest.mark.parametrize("seed", range(3))
def test_each_keyframe_has_the_nearest_reading_within_half_a_spacing_and_each_reading_counts_once(
    rate: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    when = np.sort(rng.uniform(-1.0, 31.0, round(32 * rate)))
    found = vector_readings("barometer", when, when[:, None], T, SPACING)
    apart = np.abs(when[:, None] - T[found.keyframe])
    assert (found.t == when[apart.argmin(axis=0)]).all(), "the nearest of all"
    assert (np.abs(found.t - T[found.keyframe]) <= 0.5 * SPACING + 1e-3).all()
    assert (np.diff(found.keyframe) > 0).all()
    assert (np.diff(found.t) > 0).all()
    assert (found.value[:, 0] == found.t).all()
    near = np.abs(when[:, None] - T).min(axis=0) <= 0.5 * SPACING
    alone = np.ones(len(T), np.bool_)
    alone[found.keyframe] = False
    shared = np.isin(np.abs(when[:, None] - T).argmin(axis=0), np.searchsorted(when, found.t))
    assert (alone & near <= shared).all(), "who has none within reach shares it with another"


def fixes(t: Array) -> GpsTrack:
    return gps_of(motions.rest(t), np.random.default_rng(0), rate=1.0)


def test_a_fix_stands_where_the_vehicle_was_when_it_was_made() -> None:
    track = fixes(np.arange(0.0, 30.0, 0.01))
    for one in gps_readings(track, T, PLACE, SPACING):
        assert (np.abs(one.t - GPS_LATENCY_S - T[one.keyframe]) <= 0.5 * SPACING + 1e-3).all()
        assert not ((one.t > 10.3) & (one.t < 19.7)).any(), "no keyframe is near"
