"""Lanes and the checks before take-off beside the picture: all of their tables, as text."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import viser

from companion.estimation import Correlation
from companion.estimation.block_tridiagonal import Factor
from companion.verdict import Check, LaneError, LaneInSpan, Lanes, LaneSpan, Preflight
from companion.verdict.lanes import Compared
from companion.view import FlightChecks
from companion.view.panels.verdict import ChecksFolders, lanes_markup, preflight_markup
from tests.view.browser_messages import Tags
from tests.view.panels.test_live_panel import EVIL

NOTHING = np.zeros(0)
UNKNOWN = Correlation(Factor((), NOTHING, NOTHING), NOTHING, NOTHING)
CHECKS = (
    Check("gyro_bias", "IMU[0]", 1e-3, 5e-4, 18e-3, "rad/s", "go", 0.0, autopilot="Gyros not calibrated"),
    Check("compass_heading", EVIL, 0.9, 0.05, 0.35, "rad", "no_go", 1.0),
    Check("gps_speed", "GPS", 0.5, 0.2, 0.5, "m/s", "unknown", 0.5),
)
RESULT = Preflight(1.0, 20.0, True, CHECKS, (EVIL,), ("barometer: none in the log",))


def test_each_check_has_its_outcome_and_what_the_vehicle_says_is_text() -> None:
    shown = Tags(preflight_markup(RESULT).replace("&nbsp;", " "))
    assert shown.tags <= {"div", "span", "b", "br", "table", "tr", "td", "style"}
    for words in ("NO-GO", "cannot tell", "1.0 ± 0.5 mrad/s", "18.0 mrad/s", "barometer: none in the log"):
        assert words in shown.words
    order = [shown.words.index(name) for name in ("Compass heading", "GPS speed", "Gyro bias")]
    assert order == sorted(order), "what is wrong first"


def lanes() -> Lanes:
    def lane(name: str, tilt: float, nearest: float | None) -> LaneInSpan:
        return LaneInSpan(name, (LaneError("tilt", "rad", 9, tilt, tilt, tilt, 5.0, 1e-3),), nearest, tilt > 0.05)

    span = LaneSpan(1.0, 9.0, "flight", ("core 0",), (lane("core 0", 0.1, 0.01), lane("core 1", 0.01, 0.99)), "core 1")
    return Lanes((), None, (span,), (), Compared(NOTHING, NOTHING > 0, {}, (), UNKNOWN), ())


def test_a_lane_has_a_column_and_a_quantity_a_row() -> None:
    shown = Tags(lanes_markup(lanes())).words
    assert "core 1 was the right lane" in shown
    assert "tilt, °5.730.570.06" in shown


def test_a_folder_is_there_where_there_is_something_in_it(server: viser.ViserServer) -> None:
    folders = ChecksFolders(server.gui)
    seen = [handle for handle, _ in folders.folders]
    for checks, there in (
        (FlightChecks(), [False, False]),
        (FlightChecks(preflight=RESULT), [False, True]),
        (FlightChecks(lanes(), replace(RESULT, checks=CHECKS[:1])), [True, True]),
        (FlightChecks(), [False, False]),
    ):
        folders.load(checks)
        assert [handle.visible for handle in seen] == there
