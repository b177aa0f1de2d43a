"""GPS fixes that come late by much more from some time on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.constants import healthy
from companion.constants.priors import ACCUSED
from companion.estimation import hypothesis_of, probabilities, smooth
from companion.estimation.candidate import Candidate
from companion.estimation.iteration import start_of
from companion.estimation.readings import Readings
from companion.estimation.setup import first_guess, set_up
from companion.estimation.time_shift import time_shifted
from companion.model import STANDARD_GRAVITY, Flight
from companion.strapdown import Motion
from tests.estimation.sensed import LATENCY, errors, gps_of, sensed, with_imu

ONSET = 20.0


def late_by(flight: Flight, truth: Motion, seconds: float) -> Flight:
    """The fixes from the onset on are so much older."""
    (gps,) = flight.gps
    older = gps_of(truth, np.random.default_rng(8), latency=LATENCY + seconds, rate=2.5)
    after = gps.t >= ONSET
    columns = {
        name: np.where(
            after[:, None] if getattr(gps, name).ndim > 1 else after, getattr(older, name), getattr(gps, name)
        )
        for name in ("latitude", "longitude", "height", "velocity")
    }
    return replace(flight, gps=(replace(gps, **columns),))


@pytest.mark.parametrize("seconds", [0.4, 1.0])
@pytest.mark.slow
def test_fixes_that_come_late_are_put_where_the_vehicle_was(seconds: float) -> None:
    flight, truth = sensed(45.0, seed=3)
    found = smooth(late_by(flight, truth, seconds))
    (late,) = found.explained
    assert (late.kind, late.shape) == ("gps_latency", "step")
    assert late.size[0] == pytest.approx(seconds, abs=max(4.0 * float(late.sigma[0]), 0.02))
    own = next(one for one in late.rivals if (one.kind, one.shape) == (late.kind, late.shape))
    assert own.log_odds > 0.25 * (late.size[0] / late.sigma[0]) ** 2  # of all of it, not of what the last pass left
    assert late.onset == pytest.approx(ONSET, abs=max(3.0 * late.onset_sigma, 0.5))
    assert np.linalg.norm(errors(found, truth)[:, 6:8], axis=1).max() < 1.0  # at 1 s and 6 m/s it was 6 m


@pytest.mark.slow
def test_no_fix_tells_of_what_has_not_happened_yet() -> None:
    """What looks like fixes from the future, as slow errors of a velocity do, is not the time."""
    flight, truth = sensed(45.0, seed=3)
    found = smooth(late_by(flight, truth, -0.6))
    assert "gps_latency" not in {one.kind for one in found.explained}


def test_a_late_reading_goes_to_the_keyframe_that_it_speaks_of() -> None:
    t = 0.2 * np.arange(20.0)
    arrived = t + healthy.GPS_LATENCY_S
    one = Readings(
        "gps_position", arrived, np.arange(20), np.column_stack([t, -t]), np.ones((20, 2)), np.zeros(20, np.intp),
        latency_s=healthy.GPS_LATENCY_S,
    )  # fmt: skip
    late = one.later(np.where(arrived >= 2.0, 0.6, 0.0), t)
    assert (np.diff(late.keyframe) > 0).all()  # each once
    np.testing.assert_allclose(late.t - late.late - healthy.GPS_LATENCY_S, t[late.keyframe])
    np.testing.assert_allclose(late.value[:, 0], late.t - healthy.GPS_LATENCY_S)  # what was read goes with it
    back = late.later(np.where(late.t >= 2.0, -0.6, 0.0), t)
    np.testing.assert_allclose(back.t - healthy.GPS_LATENCY_S, t[back.keyframe])
    assert back.late == pytest.approx(0.0)
    assert len(one.later(np.full(20, 1.0), t).t) == 15  # what speaks of the time before the first is left out


@pytest.mark.parametrize("faulty", ["gps_latency", "accel_scale"])
@pytest.mark.slow
def test_the_whole_estimate_decides_between_what_is_linear_and_what_is_not(faulty: str) -> None:
    """At first order an accelerometer that reads too little may explain more of a late GPS than its latency does."""
    flight, truth = sensed(45.0, seed=3)
    if faulty == "gps_latency":
        flight = late_by(flight, truth, 1.0)
    else:
        imu = flight.imu()
        flight = with_imu(flight, replace(imu, accel=imu.accel * np.where(imu.t >= ONSET, 0.9, 1.0)[:, None]))
    found = smooth(flight).explained
    assert found[0].kind == faulty
    if faulty == "gps_latency":
        assert found[0].size[0] == pytest.approx(1.0, abs=0.05)
    assert probabilities(found[0].rivals)[hypothesis_of(faulty).device] > ACCUSED


@pytest.mark.slow
def test_the_onset_is_sought_again_with_the_size_known() -> None:
    """At first order a latency may show from where the vehicle turned, long after the fixes came late."""
    flight, truth = sensed(45.0, seed=3)
    setup = set_up(late_by(flight, truth, 1.0), None, STANDARD_GRAVITY, None)
    start = start_of(setup, first_guess(setup, flight))
    possible = time_shifted(
        setup, start, [], Candidate(hypothesis_of("gps_latency"), "step", ONSET + 6.0, np.inf, 0.1, -1, 300.0, 1.0)
    )
    assert possible is not None
    moved, found = possible.setup, possible.candidate
    assert found.taken == pytest.approx(1.0, abs=0.05)
    assert found.onset == pytest.approx(ONSET, abs=max(3.0 * found.onset_sigma, 0.5))
    assert found.onset_sigma < 2.0
    assert next(one for one in moved.readings if one.name == "barometer").late == 0.0
