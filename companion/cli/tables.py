"""What `analyze` and `calibrate` show in a terminal of 80 columns."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from companion.analysis import Assessment, Drift, Expected, RedundantImu, Statistic, Verdict, left_out
from companion.present import MOST_LINES, QUANTITIES, STATISTICS, clause, fixed, flight_words, ranked, span, words

_STATUS = {
    "consistent": "green",
    "imu_suspect": "red",
    "autopilot_suspect": "red",
    "insufficient_data": "yellow",
}
_NO_BREAK = "\N{NO-BREAK SPACE}"
_NUMBER_AND_UNIT = re.compile(r"(?<=\d) (?=(?:m|s|Hz|%|ms|m/s|m/s²|mrad/s|mrad|µT)(?![\w/]))")
SIGNS = {"error": "[red]✗[/]", "warning": "[yellow]![/]", "info": "·"}


class _Console(Console):
    def on_broken_pipe(self) -> None:
        """Leave it to `main`: rich would exit with 1, which means "suspect" here."""
        raise BrokenPipeError


def console() -> Console:
    """For results: no emoji codes in names like 1:100:, no folding of long lines."""
    return _Console(soft_wrap=True, emoji=False)


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


def drift_table(table: Drift) -> Table:
    """The drift as a rich table: median, 95 % and worst of the windows of each horizon."""
    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False)
    shown.add_column("\nafter", justify="right", no_wrap=True)
    shown.add_column("\nwindows", justify="right", no_wrap=True)
    for quantity in QUANTITIES:
        shown.add_column(f"{quantity.title:^{len(_line(*STATISTICS))}}\n{_line(*STATISTICS.values())}", no_wrap=True)
    for row in table.rows:
        shown.add_row(
            f"{row.horizon_s:g} s",
            f"{row.windows}",
            *(_cell(getattr(row, quantity.attribute)) for quantity in QUANTITIES),
        )
    return shown


def expected_table(assessment: Assessment) -> Table:
    """What the drift should be: 1σ, and what it is made of."""
    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False)
    shown.add_column("\nafter", justify="right", no_wrap=True)
    shown.add_column(f"{'expected, 1σ':^18}\n{_line(*(q.unit for q in QUANTITIES))}", no_wrap=True)
    shown.add_column("\nmostly", no_wrap=True)
    for row, expected in zip(assessment.drift.rows, assessment.expected, strict=True):
        if expected is None:
            continue
        sigma = [getattr(expected, quantity.attribute) for quantity in QUANTITIES]
        shown.add_row(
            f"{row.horizon_s:g} s", _line(*("-" if s is None else fixed(s) for s in sigma)), largest(expected)
        )
    return shown


def agreement_table(assessment: Assessment) -> Table:
    """The share of windows inside the 95 % bound: of the IMU as it is, and as the verdict judges it."""
    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False)
    shown.add_column("\nafter", justify="right", no_wrap=True)
    heading = _line("n", *(quantity.name[:3] + "." for quantity in QUANTITIES))
    for title in ("the IMU as it is", "known errors removed"):
        shown.add_column(f"{title:^{len(heading)}}\n{heading}", no_wrap=True)
    for row, expected in zip(assessment.drift.rows, assessment.expected, strict=True):
        judged = assessment.agreements[row.horizon_s]
        shown.add_row(
            f"{row.horizon_s:g} s",
            _shares(row.windows, expected.inside if expected else {}),
            _shares(judged.windows, judged.inside),
        )
    return shown


def _shares(windows: int, inside: Mapping[str, float]) -> str:
    shares = (inside.get(quantity.name) for quantity in QUANTITIES)
    return _line(f"{windows}", *("-" if share is None else f"{share:.0%}" for share in shares))


def redundant_imus_table(others: Sequence[RedundantImu]) -> Table:
    """The IMUs of a flight side by side."""
    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False)
    shown.add_column("IMU", no_wrap=True)
    for heading in ("Hz", "windows", "median °", "median m", "inside 95 %: att.", "pos."):
        shown.add_column(heading, justify="right", no_wrap=True)
    for other in others:
        row = other.drift
        cells = [None if s is None else s.median for s in (row.attitude_deg, row.position_m)]
        shares = [other.inside.get(name) for name in ("attitude", "position")]
        shown.add_row(
            escape(other.imu),
            f"{other.rate_hz:.1f}",
            f"{row.windows}",
            *("-" if cell is None else fixed(cell) for cell in cells),
            *("-" if share is None else f"{share:.0%}" for share in shares),
        )
    return shown


def left_out_lines(table: Drift) -> Iterator[str]:
    """A line for each horizon that has windows which were not used."""
    for row in table.rows:
        if row.excluded:
            yield f"Left out of the windows of {row.horizon_s:g} s: {left_out(row.excluded)}"


def largest(expected: Expected) -> str:
    """The largest cause of the position's budget, or of the attitude's where there is no position."""
    shares = expected.shares.get("position", expected.shares["attitude"])
    name = max(shares, key=lambda cause: shares[cause])
    return f"{words(name)} {shares[name]:.0%}"


def _cell(statistic: Statistic | None) -> str:
    if statistic is None:
        return _line(*("-" for _ in STATISTICS))
    return _line(*(fixed(getattr(statistic, key)) for key in STATISTICS))


def _line(*parts: str) -> str:
    """Numbers under one another, whatever their length: columns within a column."""
    return "".join(f"{part:>6}" for part in parts)
