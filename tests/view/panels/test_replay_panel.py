"""The numbers of the instant."""

from __future__ import annotations

import calendar
import re
from dataclasses import replace

import numpy as np

from companion.model import Epoch, Event, Series
from companion.view import ReplayChoice
from companion.view.panels.replay_panel import errors_table, flight_data
from companion.view.panels.strip import Bands, bands
from companion.view.state.trajectory import Envelope
from tests.view.circles import BOOT, make_flight, recompute


def cells(markup: str) -> list[list[str]]:
    """The words of each row of the tables."""
    rows = re.findall(r"<tr.*?</tr>", markup)
    return [[re.sub("<[^>]*>", "", cell) for cell in re.findall(r"<td>(.*?)</td>", row)] for row in rows]


def test_an_error_stands_beside_what_is_allowed_and_how_many_sigma_that_is() -> None:
    """Root mean square of a vector whose axes have 1, 2 and 2 m: 3 m."""
    display = recompute(make_flight(), ReplayChoice())
    allowed = Envelope(np.array([display.start, display.end]), *(np.full(2, s) for s in (2.0, 0.5, 3.0)))
    sample = replace(
        display.at(display.start + 5.0), covariance=np.diag([1.0, 4.0, 4.0]), position_m=7.5, tilt_deg=3.0,
        heading_deg=-4.0, velocity_mps=0.25,
    )  # fmt: skip
    rows = {name: rest for name, *rest in cells(errors_table(sample, replace(display, expected=allowed)))}
    assert rows["attitude"] == ["5.00°", "2.00°", "2.5"]
    assert rows["velocity"] == ["0.25 m/s", "0.50 m/s", "0.5"]
    assert rows["position"] == ["7.50 m", "3.00 m", "2.5"]
    assert rows["· height"][1] == "2.00 m"
    assert cells(errors_table(sample, display))[1] == ["attitude", "5.00°", "–", "–"]


def test_what_the_vehicle_does_at_the_instant() -> None:
    """21:05:10 UTC is 100 s after the boot, and the log begins a second before that."""
    booted = calendar.timegm((2026, 11, 28, 21, 3, 30))
    told = ((BOOT, "mode", "<b>AUTO"), (BOOT, "armed", "armed"), (BOOT + 30.0, "disarmed", "disarmed"))
    events = tuple(Event(*one) for one in told)
    flight = replace(make_flight(), epoch=Epoch(float(booted), "GPS"), events=events)
    display = recompute(flight, ReplayChoice())

    def at(t: float) -> str:
        return flight_data(display.at(t), flight, bands(flight, display), has_position=True)

    early, late = at(BOOT + 20.0), at(BOOT + 40.0)
    assert "28 November 2026, 21:05:30" in early
    assert 'In the log</td><td><span style="white-space:normal">0:21.0<' in early
    assert "&lt;b&gt;AUTO" in early
    assert (", armed" in early, ", disarmed" in late) == (True, True)
    speed = float(np.hypot(*display.at(BOOT + 20.0).velocity_ref[:2]))
    assert f"{speed:.1f} m/s" in early


def test_the_battery_is_that_of_the_last_report() -> None:
    values = np.array([[16.0, 10.0, 0.9], [15.5, np.nan, 0.84]])
    battery = Series(BOOT + np.array([10.0, 20.0]), values, ("voltage_v", "current_a", "remaining"), "SYS_STATUS", 0)
    flight = replace(make_flight(), series={"battery": battery})
    display = recompute(flight, ReplayChoice())

    def at(t: float) -> list[list[str]]:
        return [row for row in cells(flight_data(display.at(t), flight, Bands(), has_position=False, of_log=False))
                if row[0] == "Battery"]  # fmt: skip

    assert at(BOOT + 15.0) == [["Battery", "16.0 V, 10.0 A, 90 %"]]
    assert at(BOOT + 25.0) == [["Battery", "15.5 V, 84 %"]], "a current that is not measured is not shown"
    assert at(BOOT + 5.0) == at(BOOT + 40.0) == [], "nothing is known yet, nor any more"
