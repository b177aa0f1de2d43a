"""Charts for a notebook, as plotly's own figures: those of the report."""

from __future__ import annotations

from typing import Any

from companion.analysis import Assessment, Drift, Replay, expected_since_anchor
from companion.estimation import BestEstimate
from companion.installation import missing
from companion.model import DataError, Flight, InputError
from companion.present import palette
from companion.report.drift import drift_chart, error_panels
from companion.report.html_page import laid_out
from companion.report.traces import TIME, stack
from companion.report.track_and_altitude import ground_track


def plot_errors(shown: Replay, assessment: Assessment | None = None) -> Any:
    """The IMU alone minus the autopilot over time; with an assessment, beside the expected error (1σ, 3σ).

    Returns a `plotly.graph_objects.Figure`; so do the others. Raises InputError when plotly is not installed.
    """
    expected = None
    if assessment is not None:
        expected = expected_since_anchor(assessment.comparison, assessment.imu_spec, assessment.autopilot, shown)
    panels = error_panels(shown, expected, palette.IMU)
    return _figure(stack(panels, TIME), 60 + 190 * len(panels))


def plot_path(flight: Flight, shown: Replay | None = None, best: BestEstimate | None = None) -> Any:
    """The ground track of the autopilot, and of the IMU alone and the best estimate where they are given.

    Raises DataError for a flight without a position.
    """
    figure = ground_track(flight, shown, palette.IMU, best)
    if figure is None:
        raise DataError("This flight has no position: there is no path to draw.")
    return _figure(figure, 600)


def plot_drift(table: Drift) -> Any:
    """The drift table: median, 95 % and worst of each error against the seconds on the IMU alone."""
    if not any(row.windows for row in table.rows):
        raise InputError("No window of this table could be used: there is nothing to draw.")
    figure, count = drift_chart(table)
    return _figure(figure, 60 + 190 * count)


def _figure(figure: Any, height: int) -> Any:
    try:
        from plotly import graph_objects  # noqa: PLC0415  (an extra)
    except ImportError:
        raise missing("report", "charts need plotly") from None
    return graph_objects.Figure(laid_out(figure)).update_layout(height=height)
