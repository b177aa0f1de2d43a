"""Drift against horizon, both logarithmic: measured and expected."""

from __future__ import annotations

import numpy as np

from companion.analysis import Assessment
from companion.model import Array
from companion.present import Rgb, palette
from companion.view.charts.chart import DASHED, DOTTED
from companion.view.charts.log_charts import LineStyle

LEAST = 1e-6  # of any unit that is shown
QUANTITIES = {
    "Attitude, ° after so many s": "attitude_deg",
    "Velocity, m/s": "velocity_mps",
    "Position, m": "position_m",
}


def drift_lines(assessment: Assessment, quantity: str) -> tuple[Array, ...] | None:
    """Horizons, median, 95 %, expected 1σ and 3σ of a quantity of the drift table; None with fewer than two rows."""
    rows: list[tuple[float, ...]] = []
    for row, expected in zip(assessment.drift.rows, assessment.expected, strict=True):
        measured, sigma = getattr(row, quantity), getattr(expected, quantity, None)
        if measured is not None and sigma is not None:
            rows.append((row.horizon_s, measured.median, measured.p95, sigma, 3 * sigma))
    if len(rows) < 2:
        return None
    return tuple(np.maximum(column, LEAST) for column in np.array(sorted(rows)).T)


def drift_styles(colour: Rgb) -> tuple[LineStyle, ...]:
    """The lines of `drift_lines`, in the colour of the IMU."""
    return (
        ("median", colour, 2.2, None),
        ("95 %", colour, 1.2, None),
        ("expected 1σ", palette.CURSOR, 1.4, DASHED),
        ("3σ", palette.CURSOR, 1.4, DOTTED),
    )
