"""`companion fleet PATHS... -o DIR`: every flight of many logs, as tables and a page."""

from __future__ import annotations

import argparse
import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

from companion.cli import options, tables
from companion.fleet import MEMORY_GB, TIMEOUT_S, Fleet, FleetRun, Row, Rows, find_logs, key_of, short_names
from companion.fleet import run_fleet as examine_fleet
from companion.model import counted
from companion.present import words

_NAME_WIDTHS = (15, 33)  # at least, of 60 columns; at most, of 80
_MOST = 10  # lines of each part of the summary: the page has them all


def fleet_options(parser: options.Parser) -> None:
    """The command's options."""
    parser.add_argument("paths", metavar="PATH", nargs="+", help="logs, folders to search for logs, or patterns")
    parser.add_argument(
        "-o", "--output", metavar="DIR", required=True, help="output folder; logs already analysed in it are skipped"
    )
    cluster = parser.add_mutually_exclusive_group()
    count = options.whole(1, 1024, "a number of processes from 1 to 1024")
    cluster.add_argument("--workers", type=count, metavar="N", help="processes to start (default: one per processor)")
    cluster.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler to use instead, as tcp://HOST:8786")
    parser.add_argument("--reports", action="store_true", help="write the report of every flight, linked from the page")
    parser.add_argument("--retry", action="store_true", help="retry logs that ended in an error")
    parser.add_argument(
        "--memory", type=_positive, metavar="GB", default=MEMORY_GB, help=f"for one log (default: {MEMORY_GB:g})"
    )
    parser.add_argument(
        "--timeout", type=_positive, metavar="S", default=TIMEOUT_S, help=f"for one log (default: {TIMEOUT_S:g})"
    )
    options.add(parser, *options.INTEGRATION, "--imu-model", *options.SETTINGS)


def run_fleet(arguments: argparse.Namespace) -> int:
    """Examine, write, and print the summary. 130 after Ctrl-C."""
    settings = options.settings_of(arguments)
    search = find_logs(arguments.paths, dialect=settings.log.dialect)
    for folder, why in search.closed.items():
        options.say(f"cannot be searched: {folder} ({why})")
    options.say_passed_over(search.no_logs)
    requested = FleetRun(
        Path(arguments.output),
        settings,
        imu=arguments.imu,
        imu_model=arguments.imu_model,
        reports=arguments.reports,
        workers=arguments.workers,
        scheduler=arguments.scheduler,
        retry=arguments.retry,
        memory_gb=arguments.memory,
        timeout_s=arguments.timeout,
    )
    began = time.monotonic()
    with _progress() as progress:
        fleet = examine_fleet(requested, search.logs, progress)
    _print(fleet, time.monotonic() - began)
    if fleet.complete:
        return 0
    left = fleet.logs - fleet.examined - fleet.unchanged
    options.say(f"stopped: {counted(left, 'log')} left. Results are kept; run the same command again to resume.")
    return 130


@contextlib.contextmanager
def _progress() -> Iterator[Callable[[int, int], None]]:
    """A bar on stderr, for someone who is watching; called with how many of how many are done."""
    console = Console(stderr=True)
    columns = (BarColumn(), MofNCompleteColumn(), _Rate(), TextColumn("left"), TimeRemainingColumn())
    with Progress("examining", *columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=None, visible=False)
        yield lambda done, of: bar.update(task, completed=done, total=of, visible=True)


class _Rate(ProgressColumn):
    """Logs per second."""

    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text("" if speed is None else f"{speed:.1f}/s")


def _print(fleet: Fleet, seconds: float) -> None:
    console, rows = tables.console(), fleet.rows
    done = f"{fleet.examined} examined, {fleet.unchanged} unchanged ({seconds:.1f} s{_pace(fleet.examined, seconds)})"
    console.lines(f"{counted(fleet.logs, 'log')}: {done}")
    counts = ", ".join(
        counted(count, status) if status == "error" else f"{count} {words(status)}"
        for status, count in rows.count_by_status().items()
    )
    console.lines(*tables.wrapped(f"{counted(len(rows.flights), 'row')}: {counts}", console.width, 2))
    names = short_names([row["log"] for row in rows.flights])
    ratios = rows.worst_ratios()
    if flights := rows.by_concern()[:_MOST]:
        console.print("\n[bold]Look at these first[/]")
        shown = tables.folded_table("\nflight", "\nverdict", "worst ÷\nexpected", "\nbecause", numbers=(2,))
        shown.columns[0].min_width, shown.columns[0].max_width = _NAME_WIDTHS
        for row in flights:
            shown.add_row(
                escape(f"{names[row['log']]}{_which(row, rows)}"),
                words(row["status"]),
                "-" if key_of(row) not in ratios else f"{ratios[key_of(row)]:.1f}",
                escape(_first(rows.reasons(row))),
            )
        console.print(shown)
    if kinds := rows.count_findings():
        console.print("\n[bold]Findings[/]")
        shown = tables.folded_table("finding", "severity", "times", "flights", numbers=(2, 3))
        for kind, severity, times, flights_of in kinds[:_MOST]:
            shown.add_row(escape(words(kind)), severity, str(times), str(flights_of))
        console.print(shown)
    if failed := rows.errors():
        listed = (f"  {escape(names[row['log']])}: {escape(_line(row['error']))}" for row in failed[:_MOST])
        console.lines("\n[bold]Errors[/]", *listed)
        if len(failed) > _MOST:
            console.lines(f"  and {len(failed) - _MOST} more: flights.parquet has them all")
    if fleet.written:
        folder = fleet.written[0].parent
        names_written = ", ".join(path.name for path in fleet.written)
        console.print(f"\nWritten to {folder}: {names_written}", markup=False, highlight=False)


def _pace(logs: int, seconds: float) -> str:
    """The rate: logs a second, or seconds a log, whichever is more than one."""
    if not logs:
        return ""
    return f", {logs / seconds:.1f} logs/s" if logs > seconds else f", {seconds / logs:.1f} s a log"


def _first(kinds: Sequence[str]) -> str:
    more = f" +{len(kinds) - 1}" if len(kinds) > 1 else ""
    return words(kinds[0]) + more if kinds else ""


def _which(flight: Row, rows: Rows) -> str:
    """Vehicle and boot, where the log has more than one flight."""
    several = sum(row["log"] == flight["log"] for row in rows.flights) > 1
    return f" ({flight['vehicle']}, boot {flight['boot']})" if several else ""


def _line(text: str) -> str:
    """At most 160 characters on a line."""
    text = " ".join(text.split())
    return text if len(text) <= 160 else f"{text[:157]}..."


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value <= 1e6:
        raise argparse.ArgumentTypeError(f"must be a positive number, got {text!r}")
    return value
