"""The verdict in tables, as HTML. Every text is escaped: some of it comes from the vehicle."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape

import numpy as np

from companion.analysis import Assessment, Drift, RedundantImu, Statistic, left_out
from companion.model import counted
from companion.present import AXES, QUANTITIES, STATISTICS, Rgb, held_out_gain, palette, significant


def swatch(colour: Rgb, opacity: float = 1.0, shape: str = "width:0.8em;height:0.8em;border-radius:50%") -> str:
    """A spot in a source's colour; one that can be seen through has an edge in it, which is seen on a dark page too."""
    return (
        f'<span style="display:inline-block;{shape};margin-right:0.5em;vertical-align:middle;box-sizing:border-box;'
        f'border:2px solid {palette.css(colour)};background:{palette.rgba(colour, opacity)}"></span>'
    )


def drift_table(table: Drift, expected: Assessment, colour: Rgb, horizon_s: float) -> str:
    """Measured median and 95 %, and expected 1σ, after each horizon; the chosen one stands out."""
    head = ("after", "", *(q.unit for q in QUANTITIES))
    rows = []
    for row, should in zip(table.rows, expected.expected, strict=True):
        chosen = "font-weight:700" if row.horizon_s == horizon_s else ""
        measured = [getattr(row, q.attribute) for q in QUANTITIES]
        sigma = [getattr(should, q.attribute, None) for q in QUANTITIES]
        for first, key in ((f"{row.horizon_s:g} s", "median"), (counted(row.windows, "window"), "p95")):
            rows.append(_row((first, STATISTICS[key], *(_figure(m, key) for m in measured)), chosen))
        told = ("" if s is None else significant(s) for s in sigma)
        rows.append(_row(("", "expected", *told), f"opacity:{palette.QUIET}"))
        left = left_out(row.excluded)
        if left and chosen:
            rows.append(f'<tr><td colspan="5" style="opacity:{palette.QUIET}">left out: {escape(left)}</td></tr>')
    note = "Median and 95 % of the windows; paler, the expected 1σ."
    return _title(f"{swatch(colour)}Drift of {escape(table.imu)}") + _table(head, rows) + _small(note, 0.65)


def redundant_imus_table(others: Sequence[RedundantImu], colours: Mapping[str, Rgb]) -> str:
    """Every IMU of the flight through the same windows."""
    if len(others) < 2:
        return ""
    rows = []
    for other in others:
        inside = "-" if not other.inside else f"{min(other.inside.values()):.0%}"
        name = f"{swatch(colours[other.imu])}{escape(other.imu)}"
        figures = (f"{other.rate_hz:.0f}", _figure(other.drift.attitude_deg), _figure(other.drift.position_m), inside)
        rows.append(_row((name, *figures), ""))
    seconds = others[0].drift.horizon_s
    return _title(f"Every IMU after {seconds:g} s") + _table(("", "Hz", "°", "m", "inside 95 %"), rows)


def calibration_table(assessment: Assessment) -> str:
    """The constant errors that explain the flight best, and whether they help where they were not fitted."""
    fit = assessment.calibration
    if fit is None:
        return _title("Calibration") + _small("Too few windows to calibrate with.", 0.65)
    scale = np.array([1e3] * 3 + [1.0] * 3 + [np.degrees(1.0)] * 3 + [1e3])
    values, sigma = fit.values[:10] * scale, fit.sigma[:10] * scale
    rows = []
    for name, part in (("gyro, mrad/s", (0, 1, 2)), ("accel, m/s²", (3, 4, 5)), ("mounting, °", (6, 7, 8))):
        cells = (_measured(values[i], sigma[i], 2) if fit.observable[i] else "not seen" for i in part)
        rows.append(_row((name, *cells), ""))
    lag = _measured(values[9], sigma[9], 1) if fit.observable[9] else "not seen"
    rows.append(_row(("lag, ms", lag, "", ""), ""))
    note = f"From {fit.windows} windows of {fit.horizon_s:g} s, ± one standard error."
    if (gain := held_out_gain(assessment)) is not None:
        note += f" With that of the first half, {counted(gain.windows, 'window')} of the second: median drift {gain}."
    worse = (
        "<br><b>It makes the rest of the flight worse: the errors are not constant.</b>"
        if assessment.made_worse
        else ""
    )
    return _title("Calibration") + _table(("", *AXES), rows) + _small(note + worse, 0.75)


def _figure(statistic: Statistic | None, key: str = "median") -> str:
    return "-" if statistic is None else significant(getattr(statistic, key))


def _measured(value: float, sigma: float, digits: int) -> str:
    """A value and its error, below each other where the panel is too narrow for both."""
    return f'<span style="white-space:normal">{value:.{digits}f} ±&nbsp;{sigma:.{digits}f}</span>'


def _row(cells: Iterable[object], style: str) -> str:
    first, *rest = cells
    return f'<tr style="{style}"><td>{first}</td>{"".join(f"<td>{cell}</td>" for cell in rest)}</tr>'


def _table(head: Sequence[str], rows: Sequence[str]) -> str:
    first, *rest = head
    top = f'<tr style="opacity:{palette.QUIET}"><td>{first}</td>{"".join(f"<td>{cell}</td>" for cell in rest)}</tr>'
    return (
        "<style>.companion-table td{text-align:right;padding:0 0 0 0.4em;white-space:nowrap}"
        ".companion-table td:first-child{text-align:left;padding:0}</style>"
        '<div style="padding:0 1em;overflow-x:auto"><table class="companion-table" style="width:100%;font-size:0.76em;'
        f'font-variant-numeric:tabular-nums;border-spacing:0">{top}{"".join(rows)}</table></div>'
    )


def _title(markup: str) -> str:
    return f'<div style="padding:0.7em 1em 0.1em;font-size:0.85em;font-weight:600">{markup}</div>'


def _small(markup: str, opacity: float = 1.0) -> str:
    return f'<div style="padding:0.2em 1em;font-size:0.8em;line-height:1.4;opacity:{opacity}">{markup}</div>'
