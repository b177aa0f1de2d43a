"""The benchmark of the best estimate beside a simulator's truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import companion as c
from benchmarks.accuracy.truth import error, row, rows
from tests.recordings import BUNDLED

DEMO = BUNDLED / "copter-demo-100hz.tlog"


def test_an_estimate_that_is_the_truth_has_no_error() -> None:
    (flight,) = c.open_log(DEMO)
    truth = flight.truth
    assert truth is not None
    elsewhere = truth.position + [10.0, -20.0, 3.0]  # about an origin of its own
    left = error(truth, truth.t, truth.q_ned_frd, truth.velocity, elsewhere)
    np.testing.assert_allclose(left, 0.0, atol=1e-6)


def test_the_demo_flight_is_estimated_better_than_by_its_autopilot() -> None:
    (one,) = rows(DEMO)
    assert one.name.endswith(DEMO.name)
    assert one.best < one.autopilot
    assert max(one.nees) < 2.0


def test_a_sigma_that_is_ten_times_too_small_shows() -> None:
    (flight,) = c.open_log(DEMO)
    best = c.smooth(flight)
    honest, bold = row("", flight, best), row("", flight, replace(best, covariance=best.covariance / 100))
    assert honest is not None
    assert bold is not None
    assert bold.nees == pytest.approx([100 * value for value in honest.nees])


def test_without_a_truth_there_is_nothing_to_say() -> None:
    (flight,) = c.open_log(DEMO)
    assert row("", replace(flight, truth=None), c.smooth(flight)) is None
