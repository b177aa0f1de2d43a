"""What the analysis says beside the picture: findings that one can jump to; drift and calibration in verdict_tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from html import escape

import viser

from companion.analysis import Finding
from companion.model import words
from companion.present import MOST_LINES, FindingGroup, Rgb, flight_words, palette, ranked
from companion.view.panels import verdict_tables
from companion.view.panels.controls import Controls
from companion.view.state.marks import short
from companion.view.state.trajectory import AnalysisResult

ICONS = {"error": viser.Icon.ALERT_OCTAGON, "warning": viser.Icon.ALERT_TRIANGLE, "info": viser.Icon.INFO_CIRCLE}


class FindingsTab:
    """Only the view thread may call it."""

    def __init__(self, controls: Controls, jump: Callable[[Finding], object]) -> None:
        """jump: called with the finding that is pressed."""
        gui = controls.gui
        self._status = gui.add_html("")
        self._flights = gui.add_html("", visible=False)
        self._findings = [_FindingCard(controls, jump) for _ in range(MOST_LINES)]
        self._more = gui.add_html("", visible=False)

    def wait(self, text: str) -> None:
        """Say that the analysis is at work, or why there is none. `text` may hold anything."""
        self._status.visible = True
        self._status.content = f'<div style="padding:0.5em 1em;font-size:0.85em">{escape(text)}</div>'

    def load(self, result: AnalysisResult | None, outside: str) -> None:
        """Show what the analysis says; None: nothing yet. outside: which findings the replay does not reach."""
        findings = result.assessment.verdict.findings if result else ()
        groups, more = ranked(findings)
        for row, group in zip(self._findings, [*groups, *[None] * MOST_LINES], strict=False):
            row.show(group)
        said = [f"and {more} more, on the timeline"] if more else []
        said += [outside] if outside else []
        self._more.visible = bool(said)
        self._more.content = f'<div style="padding:0 1em;font-size:0.8em">{"<br>".join(map(escape, said))}</div>'
        flights = result.assessment.verdict.flights if result else ()
        lines = [f"Flight {i}, {flight_words(one)}" for i, one in enumerate(flights, 1)]
        self._flights.visible = bool(lines)
        self._flights.content = f'<div style="padding:0 1em;font-size:0.8em">{"<br>".join(map(escape, lines))}</div>'
        if result is not None:
            self._status.visible = not findings
            self._status.content = '<div style="padding:0.5em 1em;font-size:0.85em">Nothing stands out.</div>'


class DriftTab:
    """Only the view thread may call it."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._tables = gui.add_html("")

    def load(self, result: AnalysisResult | None, colours: Mapping[str, Rgb]) -> None:
        """Show what the analysis says; None: nothing yet."""
        if result is None:
            self._tables.content = '<div style="padding:0.5em 1em;font-size:0.85em">Analysis in progress.</div>'
            return
        assessment = result.assessment
        colour = colours[assessment.drift.imu]
        self._tables.content = (
            verdict_tables.drift_table(assessment.drift, assessment, colour, result.horizon_s)
            + verdict_tables.redundant_imus_table(result.redundant_imus, colours)
            + verdict_tables.calibration_table(assessment)
        )


class _FindingCard:
    """A button in the colour of its severity that jumps to where the worst of a group begins, and their evidence."""

    def __init__(self, controls: Controls, jump: Callable[[Finding], object]) -> None:
        self._finding: Finding | None = None
        self._button = controls.gui.add_button("", visible=False)
        self._evidence = controls.gui.add_html("", visible=False)
        controls.on_click(self._button, lambda: self._finding and jump(self._finding))

    def show(self, group: FindingGroup | None) -> None:
        self._button.visible = self._evidence.visible = group is not None
        if group is None:
            return
        finding = self._finding = group.worst
        self._button.label = short(f"{finding.start_s:.1f} s: {words(finding.kind)}")
        self._button.icon = ICONS.get(finding.severity, ICONS["info"])
        self._button.color = palette.SEVERITIES[finding.severity]
        self._button.hint = finding.advice or None
        start, end = f"{finding.start_s:.1f}", f"{finding.end_s:.1f}"
        when = f" ({start} s)" if start == end else f" ({start} to {end} s)"
        self._evidence.content = (
            f'<div style="padding:0 1em 0.4em;font-size:0.8em;line-height:1.35">'
            f"{escape(str(group))}{when if len(group.findings) == 1 else ''}"
            + (f'<div style="opacity:0.8">{escape(finding.advice)}</div>' if finding.severity != "info" else "")
            + "</div>"
        )
