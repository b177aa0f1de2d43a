"""The analysis beside the picture: findings that one can jump to, drift, calibration, lanes and pre-flight checks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from html import escape

import numpy as np
import viser

from companion.comparison import Drift, RedundantImu, Statistic, left_out
from companion.model import counted, words
from companion.present import (
    AXES,
    MOST_LINES,
    OUTCOMES,
    QUANTITIES,
    STATISTICS,
    FindingGroup,
    Rgb,
    capitalised,
    flight_lines,
    held_out_gain,
    judgement_lines,
    lane_table,
    palette,
    preflight_headline,
    preflight_table,
    ranked,
    severity_of,
    significant,
)  # fmt: skip
from companion.verdict import Assessment, Finding, Lanes, Preflight
from companion.view.panels.controls import Controls
from companion.view.panels.markup import PALE, badge, block, lines, row, swatch, table, title, unbroken, wrapped
from companion.view.state.moments import short
from companion.view.state.trajectory import AnalysisResult, FlightChecks

ICONS = {"error": viser.Icon.ALERT_OCTAGON, "warning": viser.Icon.ALERT_TRIANGLE, "info": viser.Icon.INFO_CIRCLE}


class FindingsTab:
    """Only the view thread may call it."""

    def __init__(self, controls: Controls, show: Callable[[int, Finding], object]) -> None:
        """show: called with the browser, and the finding that is pressed in it."""
        gui = controls.gui
        self._status = gui.add_html("")
        self._findings = [_FindingCard(controls, show) for _ in range(MOST_LINES)]
        self._more = gui.add_html("", visible=False)
        self._could = gui.add_html("", visible=False)
        with (folder := gui.add_folder("", visible=False, expand_by_default=False)):
            self._flights = folder, gui.add_html("")
        self.checks = ChecksFolders(gui)

    def wait(self, text: str) -> None:
        """Report that the analysis is in progress, or why there is none. `text` may hold anything."""
        _write(self._status, text)

    def load(self, result: AnalysisResult | None, outside: str) -> None:
        """Show the analysis; None: there is none yet. outside: which findings the replay does not reach."""
        verdict = result.assessment.verdict if result else None
        findings = verdict.findings if verdict else ()
        groups, more = ranked(findings)
        for card, group in zip(self._findings, [*groups, *[None] * MOST_LINES], strict=False):
            card.show(group)
        _write(self._more, f"and {more} more, on the timeline" if more else "", outside)
        flights = flight_lines(verdict) if verdict else ()
        folder, each = self._flights
        folder.visible, folder.label = bool(flights), f"{len(flights)} flights in this log"
        _write(each, *map(", ".join, flights))
        if verdict is not None:
            _write(self._status, "" if findings else "Nothing stands out.")
        could = result.assessment.sensitivity if result else None
        smallest = f"The smallest faults that would have shown: {could}." if could and could.smallest else ""
        _write(self._could, smallest, *(f"Not judged: {why}." for why in (could.not_judged if could else ())))


def _write(handle: viser.GuiHtmlHandle, *texts: str) -> None:
    """Each in a line of its own, but for empty ones; without any the place is hidden."""
    handle.visible = any(texts)
    handle.content = block(lines(unbroken(text) for text in texts if text))


def drift_tab(result: AnalysisResult | None, colours: Mapping[str, Rgb]) -> str:
    """Drift, IMUs and calibration; None: there is no analysis yet."""
    if result is None:
        return block("Analysis in progress.")
    assessment = result.assessment
    return (
        drift_table(assessment.drift, assessment, colours[assessment.drift.imu], result.horizon_s)
        + redundant_imus_table(result.redundant_imus, colours)
        + calibration_table(assessment)
    )


class _FindingCard:
    """A button in the colour of its severity that goes to where the worst of a group shows most, and their evidence."""

    def __init__(self, controls: Controls, show: Callable[[int, Finding], object]) -> None:
        self._finding: Finding | None = None
        self._button = controls.gui.add_button("", visible=False)
        self._evidence = controls.gui.add_html("", visible=False)
        controls.on_click_in(self._button, lambda browser: self._finding and show(browser, self._finding))

    def show(self, group: FindingGroup | None) -> None:
        """Show a group; None: there is none."""
        self._button.visible = self._evidence.visible = group is not None
        if group is None:
            return
        finding = self._finding = group.worst
        self._button.label = short(f"{capitalised(severity_of(finding.severity))}: {words(finding.kind)}")
        self._button.icon = ICONS.get(finding.severity, ICONS["info"])
        self._button.color = palette.SEVERITIES[finding.severity]
        when = f"{group.when}: " if group.when else ""
        advice = f'<div style="margin-top:0.3em"><b>What to do:</b> {escape(finding.advice)}</div>'
        self._evidence.content = block(
            f"{when}{unbroken(str(group))}{advice if finding.advice and finding.severity != 'info' else ''}"
        )


def drift_table(drift: Drift, assessment: Assessment, colour: Rgb, horizon_s: float) -> str:
    """Measured median and 95 %, and allowed 1σ, after each horizon; the chosen one stands out."""
    rows = []
    for one, expected in zip(drift.rows, assessment.expected, strict=True):
        chosen = "font-weight:700" if one.horizon_s == horizon_s else ""
        measured = [getattr(one, q.attribute) for q in QUANTITIES]
        sigma = [getattr(expected, q.attribute, None) for q in QUANTITIES]
        for first, key in ((f"{one.horizon_s:g} s", "median"), (counted(one.windows, "window"), "p95")):
            rows.append(row((first, STATISTICS[key], *(_figure(m, key) for m in measured)), chosen))
        of_sigma = ("" if s is None else significant(s) for s in sigma)
        rows.append(row(("", "allowed", *of_sigma), PALE))
        left = left_out(one.excluded)
        if left and chosen:
            rows.append(f'<tr><td colspan="5" style="{PALE}">left out: {escape(left)}</td></tr>')
    note = block(
        "Median and 95 % of the windows; paler, what is allowed (1σ, before the flight's own calibration).",
        "opacity:0.65",
    )
    head = ("after", "", *(q.unit for q in QUANTITIES))
    return title(f"{swatch(colour)}Drift of {escape(drift.imu)}") + table(head, rows) + note


def redundant_imus_table(others: Sequence[RedundantImu], colours: Mapping[str, Rgb]) -> str:
    """Every IMU of the flight through the same windows."""
    if len(others) < 2:
        return ""
    rows = []
    for other in others:
        inside = "-" if not other.inside else f"{min(other.inside.values()):.0%}"
        name = f"{swatch(colours[other.imu])}{escape(other.imu)}"
        figures = (f"{other.rate_hz:.0f}", _figure(other.drift.attitude_deg), _figure(other.drift.position_m), inside)
        rows.append(row((name, *figures)))
    seconds = others[0].drift.horizon_s
    return title(f"Every IMU after {seconds:g} s") + table(("", "Hz", "°", "m", "inside 95 %"), rows)


def calibration_table(assessment: Assessment) -> str:
    """The constant errors that explain the flight best, and whether they help where they were not fitted."""
    fit = assessment.calibration
    if fit is None:
        return title("Calibration") + block("Too few windows to calibrate with.", "opacity:0.65")
    scale = np.array([1e3] * 3 + [1.0] * 3 + [np.degrees(1.0)] * 3 + [1e3])
    values, sigma = fit.values[:10] * scale, fit.sigma[:10] * scale
    rows = []
    for name, part in (("gyro, mrad/s", (0, 1, 2)), ("accel, m/s²", (3, 4, 5)), ("mounting, °", (6, 7, 8))):
        cells = (_measured(values[i], sigma[i], 2) if fit.observable[i] else "not seen" for i in part)
        rows.append(row((name, *cells)))
    lag = _measured(values[9], sigma[9], 1) if fit.observable[9] else "not seen"
    rows.append(row(("lag, ms", lag, "", "")))
    note = f"From {fit.windows} windows of {fit.horizon_s:g} s, ± one standard error."
    if (gain := held_out_gain(assessment)) is not None:
        note += f" With that of the first half, {counted(gain.windows, 'window')} of the second: median drift {gain}."
    worse = (
        "<br><b>It makes the rest of the flight worse: the errors are not constant.</b>"
        if assessment.made_worse
        else ""
    )
    return title("Calibration") + table(("", *AXES), rows) + block(note + worse, "opacity:0.75")


def _figure(statistic: Statistic | None, key: str = "median") -> str:
    return "-" if statistic is None else significant(getattr(statistic, key))


def _measured(value: float, sigma: float, digits: int) -> str:
    """A value and its error, below each other where the panel is too narrow for both."""
    return wrapped(f"{value:.{digits}f} ±&nbsp;{sigma:.{digits}f}")


_COLOURS = {OUTCOMES["go"]: palette.GOOD, OUTCOMES["no_go"]: palette.BAD, OUTCOMES["unknown"]: palette.DOUBTFUL}
_BEFORE = "Before take-off"


class ChecksFolders:
    """A folder for each, shown where there is something in it. Only the view thread may call it."""

    def __init__(self, gui: viser.GuiApi, *, before_takeoff: bool = False) -> None:
        """before_takeoff: whether those checks are what one looks at now, and are unfolded."""
        self.folders = []
        for label, unfolded in (("Lanes of the estimator", True), (_BEFORE, before_takeoff)):
            with (folder := gui.add_folder(label, visible=False, expand_by_default=unfolded)):
                self.folders.append((folder, gui.add_html("")))

    def load(self, checks: FlightChecks) -> None:
        """Show what is known of a flight."""
        lanes = "" if checks.lanes is None else lanes_markup(checks.lanes)
        preflight = "" if checks.preflight is None else preflight_markup(checks.preflight)
        for (folder, text), markup in zip(self.folders, (lanes, preflight), strict=True):
            text.content, folder.visible = markup, bool(markup)
        if checks.preflight is not None:
            self.folders[1][0].label = f"{_BEFORE}: {OUTCOMES[checks.preflight.outcome]}"


def preflight_markup(result: Preflight) -> str:
    """Go or no-go, then a row for each check, what is wrong first; the autopilot's own check at the pointer."""
    notes = [f"Not checked: {one}" for one in result.missing]
    notes += [f"The vehicle says: {one}" for one in result.vehicle_reports]
    head = f"<b>{escape(preflight_headline(result))}</b>"
    rows = []
    for outcome, *cells in preflight_table(result).rows:
        check, sensor, size, limit, own = (escape(str(cell)) for cell in cells)
        sign = badge(str(outcome), _COLOURS[str(outcome)])
        if "±" in size:  # a number and its unit stay together
            size = size.replace(" ", "&nbsp;")
        about = f'<span title="{own}">{sign} {check}</span><br>{_pale(sensor.replace(", ", " and "))}'
        rows.append(row((wrapped(about), wrapped(f"{size}<br>{_pale(limit)}"))))
    return block(lines([head, *map(escape, notes)])) + table(("check", "size, limit"), rows)


def lanes_markup(lanes: Lanes) -> str:
    """Which lane flew and should have flown, each switch, and what each lane was off by: a column for each lane.

    The last one has the standard deviation of the best estimate, from which all of them are counted.
    """
    markup = block("".join(f'<div style="margin-bottom:0.4em">{escape(one)}</div>' for one in judgement_lines(lanes)))
    for span in lanes.spans:
        if span.lanes:
            names, *rows = zip(*lane_table(span).rows, strict=True)
            columns = lane_table(span).columns[1:]
            head = title(f"{escape(capitalised(words(span.what)))}, {span.start_s:.1f}-{span.end_s:.1f} s: error, 95 %")
            cells = (
                (escape(column.title), *_apart([str(cell) for cell in of]))
                for column, of in zip(columns, rows, strict=True)
                if any(of)
            )
            markup += head + table(("", *(wrapped(escape(str(name))) for name in names), "±"), map(row, cells))
    return markup


def _apart(cells: Sequence[str]) -> list[str]:
    """What each lane is off by, and once what is not known of it."""
    sizes = [escape(cell.partition(" ± ")[0]) for cell in cells]
    return [*sizes, next((escape(sigma) for _, _, sigma in (cell.partition(" ± ") for cell in cells) if sigma), "")]


def _pale(markup: str) -> str:
    return f'<span style="{PALE}">{markup}</span>'
