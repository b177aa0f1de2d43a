"""The IMU's constant errors that explain the flight, and every IMU side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from companion.documents import schema
from companion.model import counted
from companion.present import held_out_gain, palette, paragraph, percent, short, table, text, words
from companion.report import traces
from companion.report.html_page import Section
from companion.report.subject import AXES, Subject

_DEGREES = float(np.degrees(1.0))
_XYZ = tuple(name for name, _ in AXES)
_PARTS = (
    ("gyro bias", "gyro_bias_radps", "mrad/s", 1e3, 2, _XYZ),
    ("accelerometer bias", "accel_bias_mps2", "m/s²", 1.0, 3, _XYZ),
    ("mounting", "mounting_rad", "°", _DEGREES, 2, _XYZ),
    ("lag", "time_offset_s", "ms", 1e3, 1, ("",)),
    ("gyro scale", "gyro_scale", "%", 100.0, 3, _XYZ),
    ("accelerometer scale", "accel_scale", "%", 100.0, 3, _XYZ),
    ("gyro misalignment", "gyro_misalignment_rad", "°", _DEGREES, 2, ("xy", "xz", "yx", "yz", "zx", "zy")),
    ("accelerometer misalignment", "accel_misalignment_rad", "°", _DEGREES, 2, ("yx", "zx", "zy")),
    ("lever arm", "lever_arm_m", "m", 1.0, 3, _XYZ),
)
"""What is fitted: name, key in the document, unit shown, factor to it, decimals, names of its parts."""


def calibration(subject: Subject) -> Section:
    """Fitted errors with their standard errors, and what they gain."""
    title = "Calibration"
    fit = subject.numbers.calibration
    if fit is None:
        return Section("calibration", title, paragraph("Not made: too few windows of 5 s, or none that can be fitted."))
    rows, untold = [], []
    for name, key, unit, factor, digits, axes in _PARTS:
        figure = _part(fit, key)
        if any(figure.observable):
            rows.append([name, _values(figure, factor, digits, axes), unit])
        else:
            untold.append(name)
    shown = table(["error", "± one standard error", ""], rows, name="calibration-table", words=3) if rows else ""
    gain = paragraph(f"Not observable in this flight: {', '.join(untold)}.") if untold else ""
    by_best = [name for name, key, *_ in _PARTS if _told_by_best(_part(fit, key))]
    if by_best:
        gain += paragraph(f"Told by the best estimate rather than the windows: {', '.join(by_best)}.")
    if subject.comparison.has_position and not fit.accel_scale.observable[2]:
        level = fit.level_force_mps2
        gain += paragraph(
            f"At 1 g the accelerometer's down axis is off by {level.value:.3f} ± {level.sigma:.3f} m/s²: bias and "
            "scale together."
        )
    if (held_out := held_out_gain(subject.assessment)) is not None:
        gain += paragraph(
            f"Median drift in {counted(held_out.windows, 'window')} of the second half, with the calibration of the "
            f"first: {held_out}."
        )
    if subject.assessment.made_worse:
        warning = "It makes the rest of the flight worse: the errors are not constant. Do not use it."
        gain += paragraph(warning, "warning")
    figure_of_all = _intervals(fit)
    if figure_of_all is None:
        return Section("calibration", title, shown + gain)
    caption = f"From {fit.windows} windows of {fit.horizon_s:g} s. Bars: ± two standard errors."
    rows_high = 0.75 * len({trace["yaxis"] for trace in figure_of_all["data"]})
    return Section("calibration", title, shown + gain + subject.charts.add(figure_of_all, caption, rows=rows_high))


def redundant_imus(subject: Subject) -> Section:
    """Every IMU through the same windows."""
    title = "Every IMU side by side"
    others = subject.numbers.imus
    if len(others) < 2:
        return Section("imus", title, paragraph("This flight has one IMU message with enough samples."))
    shown = table(
        ["IMU", "Hz", "windows", "median, °", "median, m", "attitude inside 95 %", "position inside 95 %"],
        [
            [
                other.message,
                f"{other.rate_hz:.1f}",
                other.windows,
                short(other.attitude_deg.median if other.attitude_deg else None),
                short(other.position_m.median if other.position_m else None),
                percent(other.inside.get("attitude")),
                percent(other.inside.get("position")),
            ]
            for other in others
        ],
        name="imus-table",
    )
    known = [other for other in others if other.attitude_deg]
    if not known:
        return Section("imus", title, shown)
    panels = [("attitude, °", "attitude_deg")]
    if any(other.position_m for other in known):
        panels.append(("position, m", "position_m"))
    figure = traces.stack(
        [traces.Panel(name, [_bars(known, attribute, subject.colours)]) for name, attribute in panels],
        "",
        type="category",
    )
    figure["layout"] |= {"hovermode": "closest", "bargap": 0.5, "showlegend": False}
    used = subject.numbers.used_imu
    caption = f"Drift after {others[0].horizon_s:g} s: bar to the median, line to 95 %. This report is about {used}."
    return Section("imus", title, shown + subject.charts.add(figure, caption, rows=len(panels)))


def _part(fit: schema.CalibrationObject, key: str) -> schema.FigureObject:
    figure: schema.FigureObject = getattr(fit, key)
    return figure


def _told_by_best(figure: schema.FigureObject) -> bool:
    """Whether any of it that can be told is the best estimate's."""
    return any(np.logical_and(figure.observable, figure.from_best_estimate))


def _values(figure: schema.FigureObject, factor: float, digits: int, axes: Sequence[str]) -> str:
    """The parts of a figure one after the other, and with what those go together that cannot be told."""
    parts = []
    for i, axis in enumerate(axes):
        if figure.observable[i]:
            said = f"{figure.value[i] * factor:.{digits}f} ± {figure.sigma[i] * factor:.{digits}f}"
        else:
            other = figure.confounded[i]
            said = "not observable" + (f" (cannot be told from {words(other)})" if other else "")
        parts.append(f"{axis} {said}".strip())
    return ", ".join(parts)


def _intervals(fit: schema.CalibrationObject) -> traces.Figure | None:
    """The vectors that the flight tells, each with a unit of its own."""
    panels = []
    for name, key, unit, factor, _, axes in _PARTS:
        figure = _part(fit, key)
        if axes is not _XYZ or not any(figure.observable):
            continue
        seen = [k for k in range(3) if figure.observable[k]]
        points = {
            "type": "scatter",
            "mode": "markers",
            "x": [AXES[k][0] for k in seen],
            "y": [figure.value[k] * factor for k in seen],
            "error_y": {
                "array": [2 * figure.sigma[k] * factor for k in seen],
                "thickness": 1.5,
                "color": palette.css(palette.CURSOR),
            },
            "marker": {"size": 9, "color": [palette.css(AXES[k][1]) for k in seen]},
            "name": name,
            "hovertemplate": "%{x}: %{y:.3~g} ± %{error_y.array:.2~g} (2σ)",
        }
        panels.append(traces.Panel(f"{name},<br>{unit}", [points], {"zeroline": True}))
    if not panels:
        return None
    drawn = traces.stack(panels, "", type="category", categoryorder="array", categoryarray=list(_XYZ))
    drawn["layout"] |= {"showlegend": False, "hovermode": "closest"}
    return drawn


def _bars(others: list[schema.RedundantImuObject], attribute: str, colours: Mapping[str, palette.Rgb]) -> traces.Trace:
    statistics = [getattr(other, attribute) for other in others]
    median = [s.median if s else 0.0 for s in statistics]
    return {
        "type": "bar",
        "x": [text(other.message) for other in others],
        "y": median,
        "error_y": {
            "array": [s.p95 - m if s else 0.0 for s, m in zip(statistics, median, strict=True)],
            "color": palette.css(palette.DIFFERENCE),
            "symmetric": False,
            "arrayminus": [0.0] * len(median),
        },
        "name": attribute,
        "width": 0.35,
        "marker": {"color": [palette.css(colours[o.message]) for o in others]},
        "hovertemplate": "%{x}: %{y:.3~g}",
    }
