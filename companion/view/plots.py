"""Charts over time with a line at the current instant: how far both are apart, and what the IMU read."""

from __future__ import annotations

import math

import numpy as np
import viser

from companion.tracks import Array, ImuTrack
from companion.view import events, palette
from companion.view.chart import STYLE, Chart, Drawing
from companion.view.controls import button_row
from companion.view.moment import Footage, Moment


class Plots:
    """The charts of the errors, and the charts of the IMU's readings. Only the view thread may call it."""

    def __init__(self, gui: viser.GuiApi, post: events.Post) -> None:
        shown = {"Errors": events.PickCharts(imu=False), "IMU readings": events.PickCharts(imu=True)}
        button_row(gui, "Show", shown, post, "Drag over a chart to zoom in, double-click to see all of it again")
        gui.add_html(STYLE)
        self._errors = [
            Chart(gui, "Attitude error, °", "deg", [("tilt", palette.DIFFERENCE), ("heading", palette.HEADING)]),
            Chart(gui, "Velocity error, m/s", "m/s", [("apart", palette.DIFFERENCE)]),
            Chart(gui, "Position error, m", "m", [("apart", palette.DIFFERENCE)]),
        ]
        axes = list(zip(("forward", "right", "down"), palette.AXES, strict=True))
        self._readings = [Chart(gui, "Gyro, °/s", "deg/s", axes), Chart(gui, "Accelerometer, m/s²", "m/s²", axes)]
        self._charts = [*self._errors, *self._readings]
        self._drawings: list[Drawing] = []
        self._show_readings = self._has_position = False
        self._now = math.nan

    def load(self, film: Footage, imu: ImuTrack, part: tuple[float, float]) -> None:
        """Draw another reckoning, between two times (s, boot clock). `imu`: the readings that it was made from."""
        replay, expected = film.replay, film.envelope
        known = replay.reference_valid.astype(np.float64)

        def error(values: tuple[Array, ...], sigma: Array | None) -> Drawing:
            envelope = () if sigma is None else (sigma, 3 * sigma)
            return Drawing(replay.t, values + envelope, known, envelope=sigma is not None)

        self._drawings = [
            error((film.tilt_deg, film.heading_deg), expected.attitude_deg if expected else None),
            error((film.velocity_mps,), expected.velocity_mps if expected else None),
            error((film.position_m,), expected.position_m if expected else None),
            Drawing(imu.t, tuple(np.degrees(imu.gyro.T))),
            Drawing(imu.t, tuple(imu.accel.T)),
        ]
        self._has_position = replay.has_position
        self.choose_part(part)
        self.pick(imu=self._show_readings)

    def choose_part(self, part: tuple[float, float]) -> None:
        """Show what lies between two times (s, boot clock), thinned anew: the shorter, the finer."""
        for chart, drawing in zip(self._charts, self._drawings, strict=True):
            chart.load(drawing, part)
        self._now = math.nan  # equal to nothing: the next line is sent

    def pick(self, *, imu: bool) -> None:
        """Show the IMU's readings, or the errors."""
        self._show_readings = imu
        for i, chart in enumerate(self._errors):
            chart.set_visible(not imu and (i == 0 or self._has_position))
        for chart in self._readings:
            chart.set_visible(imu)
        self._now = math.nan

    def relayout(self) -> None:
        """Make every browser lay its charts out again; see Chart.relayout."""
        for chart in self._charts:
            chart.relayout()

    def show(self, moment: Moment) -> None:
        """Move the line to `moment`. A line that stands still costs nothing."""
        if moment.t == self._now:
            return
        self._now = moment.t
        said = ((moment.tilt_deg, moment.heading_deg), (moment.velocity_mps,), (moment.position_m,))
        for chart, values in zip(self._errors, said, strict=True):
            chart.show(moment.t, values)
        for chart in self._readings:
            chart.show(moment.t)
