"""What the analysis says beside the picture: findings that one can jump to; drift and calibration in verdict_tables."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

import viser

from companion.analysis import Finding
from companion.model import words
from companion.present import Rgb, palette
from companion.view.panels import verdict_tables
from companion.view.state import events
from companion.view.state.insight import Insight
from companion.view.state.marks import short

MOST_FINDINGS = 10
ICONS = {"error": viser.Icon.ALERT_OCTAGON, "warning": viser.Icon.ALERT_TRIANGLE, "info": viser.Icon.INFO_CIRCLE}


class FindingsTab:
    """Only the view thread may call it."""

    def __init__(self, gui: viser.GuiApi, post: events.Post) -> None:
        self._status = gui.add_html("")
        self._findings = [_FindingCard(gui, i, post) for i in range(MOST_FINDINGS)]
        self._more = gui.add_html("", visible=False)

    def wait(self, text: str) -> None:
        """Say that the analysis is at work, or why there is none. `text` may hold anything."""
        self._status.visible = True
        self._status.content = f'<div style="padding:0.5em 1em;font-size:0.85em">{escape(text)}</div>'

    def load(self, insight: Insight | None, outside: str) -> None:
        """Show what the analysis says; None: nothing yet. outside: which findings the replay does not reach."""
        findings = insight.assessment.verdict.findings if insight else ()
        for row, finding in zip(self._findings, [*findings, *[None] * MOST_FINDINGS], strict=False):
            row.show(finding)
        more = len(findings) - MOST_FINDINGS
        said = [f"and {more} more, on the timeline"] if more > 0 else []
        said += [outside] if outside else []
        self._more.visible = bool(said)
        self._more.content = f'<div style="padding:0 1em;font-size:0.8em">{"<br>".join(map(escape, said))}</div>'
        if insight is not None:
            self._status.visible = not findings
            self._status.content = '<div style="padding:0.5em 1em;font-size:0.85em">Nothing stands out.</div>'


class DriftTab:
    """Only the view thread may call it."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._tables = gui.add_html("")

    def load(self, insight: Insight | None, colours: Mapping[str, Rgb]) -> None:
        """Show what the analysis says; None: nothing yet."""
        if insight is None:
            self._tables.content = '<div style="padding:0.5em 1em;font-size:0.85em">Analysis in progress.</div>'
            return
        assessment = insight.assessment
        colour = colours[assessment.drift.imu]
        self._tables.content = (
            verdict_tables.drift_table(assessment.drift, assessment, colour, insight.horizon_s)
            + verdict_tables.redundant_imus_table(insight.redundant_imus, colours)
            + verdict_tables.calibration_table(assessment)
        )


class _FindingCard:
    """A button in the colour of its severity that jumps to where a finding begins, and its evidence."""

    def __init__(self, gui: viser.GuiApi, index: int, post: events.Post) -> None:
        self._button = gui.add_button("", visible=False)
        self._evidence = gui.add_html("", visible=False)

        @self._button.on_click
        async def _(_: object) -> None:
            post(events.JumpToFinding(index))

    def show(self, finding: Finding | None) -> None:
        self._button.visible = self._evidence.visible = finding is not None
        if finding is None:
            return
        self._button.label = short(f"{finding.start_s:.1f} s: {words(finding.kind)}")
        self._button.icon = ICONS.get(finding.severity, ICONS["info"])
        self._button.color = palette.SEVERITIES[finding.severity]
        self._button.hint = finding.advice or None
        start, end = f"{finding.start_s:.1f}", f"{finding.end_s:.1f}"
        when = f"{start} s" if start == end else f"{start} to {end} s"
        self._evidence.content = (
            f'<div style="padding:0 1em 0.4em;font-size:0.8em;line-height:1.35">'
            f"{escape(finding.evidence)} ({when})"
            + (f'<div style="opacity:0.8">{escape(finding.advice)}</div>' if finding.severity != "info" else "")
            + "</div>"
        )
