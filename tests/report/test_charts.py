"""Figures are written as plotly would write them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
from plotly import graph_objects

from companion.app.recording import read_recording
from companion.report import TIME, Charts, Panel, curve, laid_out, stack
from companion.report.incident import _panels
from companion.verdict import Incident
from companion.verdict.incident import Moment
from tests.recordings import BUNDLED


def test_a_figure_is_the_one_that_plotly_makes_of_it() -> None:
    t = np.array([[0.0, 1.0], [2.0, np.nan], [4.0, 5.0]])
    panels = [
        Panel(
            f"panel <{i}>",
            [
                curve(t[:, 0], t[:, 1], "line </script>", (1, 2, 3), customdata=t[:, 1].astype(np.float32)),
                {"type": "bar", "x": ["a", "b"], "y": [np.float64(1.5), float("nan")], "marker": {"color": ["red"]}},
            ],
        )
        for i in range(3)
    ]
    figure = stack(panels, TIME, spans=[(0.0, 1.0)], range=[0, np.float64(5.0)])
    charts = Charts()
    charts.add(figure, "caption")
    charts.add(figure, "caption")
    ours = json.loads(charts.json())
    theirs = json.loads(graph_objects.Figure(laid_out(figure)).to_json())
    theirs["layout"]["template"] = {}  # plotly lists the kinds of traces in it, without a setting
    assert ours == [theirs, theirs]


def test_whole_numbers_are_lists_and_an_empty_line_is_empty() -> None:
    charts = Charts()
    charts.add({"data": [{"type": "bar", "x": np.arange(2), "y": np.zeros(0)}], "layout": {}}, "caption")
    (figure,) = json.loads(charts.json())
    assert (figure["data"][0]["x"], figure["data"][0]["y"]) == ([0, 1], [])


def test_samples_of_a_vehicle_that_has_run_for_weeks_are_apart() -> None:
    t = 40 * 86400.0 + np.arange(0.0, 10.0, 0.01)
    assert len(np.unique(curve(t, t, "a line", (1, 2, 3))["x"])) == len(t)


def test_a_receiver_without_a_speed_does_not_stand_still() -> None:
    flight = replace(read_recording(BUNDLED / "copter-demo-100hz.tlog").flights[0], imus={})
    gps = flight.gps[0]
    middle = float(gps.t[len(gps) // 2])
    lost = np.where((gps.t > middle)[:, None], np.nan, 5.0 * np.ones_like(gps.velocity))
    incident = Incident(Moment(middle, "requested", ""), middle - 10.0, middle + 10.0, (), (), (), None, (), ())
    panels = _panels(incident, replace(flight, gps=(replace(gps, velocity=lost),)), None)
    (speed,) = [panel for panel in panels if panel.title == "speed, m/s"]
    (receiver,) = [line for line in speed.traces if line["name"] == "GPS"]
    assert receiver["y"].min() > 1.0
