"""The lanes of the estimator and the checks before take-off: what `companion lanes` and `companion preflight` print."""

from __future__ import annotations

from html import escape

import viser

from companion.analysis import Lanes, Preflight
from companion.present import (
    OUTCOMES,
    capitalised,
    judgement_lines,
    lane_table,
    palette,
    preflight_headline,
    preflight_table,
    words,
)
from companion.view.panels.markup import PALE, badge, block, lines, row, table, title, wrapped
from companion.view.state.sending import update
from companion.view.state.trajectory import FlightChecks

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
            update(text, content=markup)
            update(folder, visible=bool(markup))
        if checks.preflight is not None:
            update(self.folders[1][0], label=f"{_BEFORE}: {OUTCOMES[checks.preflight.outcome]}")


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
    """Which lane flew and should have flown, each switch, and what each lane was off by: a column for each lane."""
    markup = block("".join(f'<div style="margin-bottom:0.4em">{escape(one)}</div>' for one in judgement_lines(lanes)))
    for span in lanes.spans:
        if span.lanes:
            names, *rows = zip(*lane_table(span).rows, strict=True)
            columns = lane_table(span).columns[1:]
            head = title(f"{escape(capitalised(words(span.what)))}, {span.start_s:.1f}-{span.end_s:.1f} s: error, 95 %")
            cells = (
                (escape(column.title), *(wrapped(escape(str(cell))) for cell in of))
                for column, of in zip(columns, rows, strict=True)
                if any(of)
            )
            markup += head + table(("", *(wrapped(escape(str(name))) for name in names)), map(row, cells))
    return markup


def _pale(markup: str) -> str:
    return f'<span style="{PALE}">{markup}</span>'
