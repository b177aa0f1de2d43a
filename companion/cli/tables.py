"""Tables and text of the commands, in a terminal of 80 columns."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Collection, Iterator

import rich.console
from rich import box
from rich.markup import escape
from rich.table import Table

from companion import present
from companion.analysis import Drift, Verdict, left_out
from companion.present import MOST_LINES, clause, fixed, flight_words, ranked, span, words

_STATUS = {
    "consistent": "green",
    "imu_suspect": "red",
    "autopilot_suspect": "red",
    "insufficient_data": "yellow",
}
_NO_BREAK = "\N{NO-BREAK SPACE}"
_NUMBER_AND_UNIT = re.compile(r"(?<=\d) (?=(?:m|s|Hz|%|ms|m/s|m/s²|mrad/s|mrad|µT)(?![\w/]))")
SIGNS = {"error": "[red]✗[/]", "warning": "[yellow]![/]", "info": "·"}


class Console(rich.console.Console):
    """A terminal, a pipe or a file."""

    def on_broken_pipe(self) -> None:
        """Leave it to `main`: rich would exit with 1, which means "suspect" here."""
        raise BrokenPipeError

    def lines(self, *parts: str | Table) -> None:
        """Each on a line of its own, as it is."""
        for part in parts:
            self.print(part, highlight=False, no_wrap=isinstance(part, Table) or None)


def console() -> Console:
    """For results: no emoji codes in names like 1:100:, no folding of long lines."""
    return Console(soft_wrap=True, emoji=False)


def verdict_lines(verdict: Verdict, *, most: int = MOST_LINES) -> Iterator[str]:
    """The verdict, each flight by itself where there are several, and the findings under it."""
    yield f"{status_text(verdict.status)}  {escape(clause(verdict.summary))}"
    for i, flight in enumerate(verdict.flights, 1):
        yield f"  Flight {i}, {escape(flight_words(flight))}"
    groups, left = ranked(verdict.findings, most)
    for group in groups:
        one = group.findings[0]
        named = f"{span(one)}: {words(one.kind)}. " if len(group.findings) == 1 else ""
        yield f"  {SIGNS[one.severity]} {named}{escape(str(group))}"
        if one.severity != "info":
            yield f"      {escape(group.worst.advice)}"
    if left:
        yield f"  and {left} more: --json has them all"


def wrapped(text: str, width: int, hanging: int) -> list[str]:
    """Text in lines of rich markup; all but the first are indented. A number and its unit stay together."""
    kept = _NUMBER_AND_UNIT.sub(_NO_BREAK, text)
    lines = textwrap.wrap(kept, width, subsequent_indent=" " * hanging, break_long_words=False, break_on_hyphens=False)
    return [escape(line.replace(_NO_BREAK, " ")) for line in lines] or [""]


def status_text(status: str) -> str:
    """CONSISTENT, IMU SUSPECT, ... in its colour."""
    return f"[bold {_STATUS[status]}]{words(status).upper()}[/]"


def table(*headings: str, left: int = 0) -> Table:
    """A table whose first `left` columns are text."""
    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False)
    for i, heading in enumerate(headings):
        shown.add_column(heading, justify="left" if i < left else "right", no_wrap=True)
    return shown


def folded_table(*headings: str, numbers: Collection[int] = ()) -> Table:
    """A table of text, which is folded where it is too wide, never cut; numbers: the columns that are some."""
    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    for i, heading in enumerate(headings):
        number = i in numbers
        shown.add_column(heading, justify="right" if number else "left", no_wrap=number, overflow="fold")
    return shown


def rendered(of: present.Table) -> Table:
    """A table of results; the columns of a group are columns within one of the terminal's."""
    groups = list(of.groups)
    has_groups = any(title for title, _ in groups)
    shown = table()
    for title, places in groups:
        names = [of.columns[i].title for i in places]
        head = _line(*(n if len(n) <= _WIDTH else f"{n[:3]}." for n in names)) if title else names[0]
        is_text = title or of.columns[places[0]].is_text
        heading = f"{title:^{len(head)}}\n{head}" if has_groups else head
        shown.add_column(heading, justify="left" if is_text else "right", no_wrap=True)
    for row in of.rows:
        cells = [_cell(cell) for cell in row]
        shown.add_row(*(_line(*(cells[i] for i in places)) if title else cells[places[0]] for title, places in groups))
    return shown


_WIDTH = 6
"""Characters of a number in a group: whatever its length, they stand under one another."""


def _cell(cell: present.Cell) -> str:
    return "-" if cell is None else fixed(cell) if isinstance(cell, float) else escape(str(cell))


def _line(*parts: str) -> str:
    return "".join(f"{part:>{_WIDTH}}" for part in parts)


def left_out_lines(drift: Drift) -> Iterator[str]:
    """A line for each horizon that has windows which were not used."""
    for row in drift.rows:
        if row.excluded:
            yield f"Left out of the windows of {row.horizon_s:g} s: {left_out(row.excluded)}"
