"""What a vehicle says of its own uncertainty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import companion as c
from companion.app.examination import autopilot_of
from companion.app.settings import AutopilotSettings, Settings
from companion.comparison import ReferenceSpec, reported_by
from companion.model import Series
from companion.strapdown import motions
from tests.flights import flight_of, seconds
from tests.recordings import shared

NAMES = ("north_m2", "east_m2", "down_m2", "roll_rad2", "pitch_rad2", "yaw_rad2", "vn_m2ps2", "ve_m2ps2", "vd_m2ps2")


def variances(*values: float) -> Series:
    t = seconds(10, 10)
    table = np.tile(values, (len(t), 1))
    table[0] = 100.0  # while the estimator starts up
    return Series(t, table, NAMES, "ODOMETRY")


def test_variances_take_the_place_of_settings() -> None:
    flight = flight_of(motions.rest(seconds(10, 10)))
    settings = ReferenceSpec()
    assert reported_by(flight, settings) is settings
    told = replace(flight, series={"variance": variances(4, 4, 9, 1e-4, 3e-4, 2.5e-3, 0.01, 0.01, 0.04)})
    found = reported_by(told, settings)
    assert found.tilt == pytest.approx(np.sqrt(2e-4))
    assert found.heading == pytest.approx(0.05)
    assert found.velocity == pytest.approx(np.sqrt(0.02))
    assert found.position == settings.position, "where it is on Earth is no error of a window"
    assert found.reason == "tilt, heading, velocity from ODOMETRY; the rest from the settings"
    assert autopilot_of(Settings(), told) == found
    assert autopilot_of(Settings(autopilot=AutopilotSettings(reported=False)), told) == settings


def test_what_is_not_known_is_not_taken() -> None:
    flight = flight_of(motions.rest(seconds(10, 10)))
    nan, zero = float("nan"), 0.0
    part = replace(flight, series={"variance": variances(1, 1, 1, zero, zero, zero, nan, nan, nan)})
    part.series["variance"].values[0] = nan  # nothing but what is not known
    assert reported_by(part, ReferenceSpec()) == ReferenceSpec()


def test_px4_reports_them() -> None:
    flight = c.open_log(shared("px4/px4_square_lownoise.tlog"))[0]
    found = reported_by(flight, ReferenceSpec())
    assert found.tilt == pytest.approx(0.0051, abs=5e-4)
    assert found.heading == pytest.approx(0.023, abs=2e-3)
    assert found.velocity == pytest.approx(0.09, abs=0.01)
