"""The IMU's constant errors that explain the flight, and every IMU side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from companion import present
from companion.analysis import PARTS, Calibration, RedundantImu
from companion.model import counted
from companion.present import (
    CALIBRATED,
    QUANTITIES,
    by_best_estimate,
    held_out_gain,
    html_table,
    level_force,
    not_observable,
    palette,
    paragraph,
    redundant_imus_table,
    table,
    text,
    words,
)
from companion.report import traces
from companion.report.subject import AXES, Subject


def calibration(subject: Subject) -> str:
    """Fitted errors with their standard errors, and what they gain."""
    fit = subject.assessment.calibration
    if fit is None:
        return paragraph("Not made: too few windows of 5 s, or none that can be fitted.")
    rows = [[part.title, _values(fit, name), part.unit] for name, part in CALIBRATED.items() if fit.score(name)]
    shown = table(["error", "± one standard error", ""], rows, name="calibration-table", words=3) if rows else ""
    if unknown := not_observable(fit):
        shown += paragraph(f"Not observable in this flight: {', '.join(unknown)}.")
    if by_best := by_best_estimate(fit):
        shown += paragraph(f"By the best estimate rather than the windows: {', '.join(by_best)}.")
    if level := level_force(fit):
        shown += paragraph(f"At 1 g the accelerometer's down axis is off by {level}.")
    if (held_out := held_out_gain(subject.assessment)) is not None:
        shown += paragraph(
            f"Median drift in {counted(held_out.windows, 'window')} of the second half, with the calibration of the "
            f"first: {held_out}."
        )
    if subject.assessment.made_worse:
        warning = "It makes the rest of the flight worse: the errors are not constant. Do not use it."
        shown += paragraph(warning, "warning")
    if panels := _intervals(fit):
        figure = traces.stack(panels, "", type="category", categoryorder="array", categoryarray=list(present.AXES))
        figure["layout"] |= {"showlegend": False, "hovermode": "closest"}
        caption = f"From {fit.windows} windows of {fit.horizon_s:g} s. Bars: ± two standard errors."
        shown += subject.charts.add(figure, caption, rows=0.75 * len(panels))
    return shown


def redundant_imus(subject: Subject) -> str:
    """Every IMU through the same windows."""
    others = subject.examined.redundant_imus
    if len(others) < 2:
        return paragraph("This flight has one IMU message with enough samples.")
    shown = html_table(redundant_imus_table(others), "imus-table")
    known = [other for other in others if other.drift.attitude_deg]
    if not known:
        return shown
    drawn = [q for q in QUANTITIES if q.name != "velocity" and any(getattr(o.drift, q.attribute) for o in known)]
    panels = [traces.Panel(q.title, [_bars(known, q.attribute, subject.colours)]) for q in drawn]
    figure = traces.stack(panels, "", type="category")
    figure["layout"] |= {"hovermode": "closest", "bargap": 0.5, "showlegend": False}
    seconds = others[0].drift.horizon_s
    caption = f"Drift after {seconds:g} s: bar to the median, line to 95 %. This report is about {subject.imu}."
    return shown + subject.charts.add(figure, caption, rows=len(panels))


def _values(fit: Calibration, name: str) -> str:
    """The parameters of a part one after the other, and what those that are not observable go together with."""
    part, place = CALIBRATED[name], PARTS[name]
    words_of = []
    for i, axis in zip(range(place.start, place.stop), part.axes, strict=True):
        value = part.shown(fit.values[i], fit.sigma[i])
        if not fit.observable[i]:
            other = fit.confounded[i]
            value = "not observable" + (f" (not separable from {words(other)})" if other else "")
        words_of.append(f"{axis} {value}".strip())
    return ", ".join(words_of)


def _intervals(fit: Calibration) -> list[traces.Panel]:
    """The vectors that are observable, each with a unit of its own."""
    panels = []
    for name, part in CALIBRATED.items():
        if part.axes is not present.AXES or not fit.score(name):
            continue
        first = PARTS[name].start
        seen = [k for k in range(3) if fit.observable[first + k]]
        points = traces.markers(
            [AXES[k][0] for k in seen],
            [fit.values[first + k] * part.factor for k in seen],
            part.title,
            error_y={
                "array": [2 * fit.sigma[first + k] * part.factor for k in seen],
                "thickness": 1.5,
                "color": palette.css(palette.CURSOR),
            },
            marker={"size": 9, "color": [palette.css(AXES[k][1]) for k in seen]},
            hovertemplate="%{x}: %{y:.3~g} ± %{error_y.array:.2~g} (2σ)",
        )
        panels.append(traces.Panel(f"{part.title},<br>{part.unit}", [points], {"zeroline": True}))
    return panels


def _bars(others: Sequence[RedundantImu], attribute: str, colours: Mapping[str, palette.Rgb]) -> traces.Trace:
    statistics = [getattr(other.drift, attribute) for other in others]
    median = [s.median if s else 0.0 for s in statistics]
    return {
        "type": "bar",
        "x": [text(other.imu) for other in others],
        "y": median,
        "error_y": {
            "array": [s.p95 - m if s else 0.0 for s, m in zip(statistics, median, strict=True)],
            "color": palette.css(palette.DIFFERENCE),
            "symmetric": False,
            "arrayminus": [0.0] * len(median),
        },
        "name": attribute,
        "width": 0.35,
        "marker": {"color": [palette.css(colours[o.imu]) for o in others]},
        "hovertemplate": "%{x}: %{y:.3~g}",
    }
