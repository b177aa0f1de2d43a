"""`companion preflight LOG|LINK`: whether a vehicle that stands is fit to fly, a line for each check."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.markup import escape
from rich.table import Table

from companion.app.recording import Recording
from companion.app.sensors import preflight_of
from companion.app.settings import Settings
from companion.cli import live, options, tables
from companion.documents import preflight_document
from companion.fleet import earlier_checks
from companion.links import is_link
from companion.model import DataError, Flight, counted
from companion.present import preflight_headline, preflight_table
from companion.verdict import Ageing, Preflight, ageing

_LINK_S = 30.0
_COLOURS = {"go": "green", "no_go": "red", "unknown": "yellow"}


def preflight_options(parser: options.Parser) -> None:
    """The command's options."""
    options.add_log(parser, *options.FLIGHT, takes_link=True)
    parser.add_argument(
        "--history",
        metavar="FOLDER|PARQUET",
        help="earlier logs of this vehicle, or preflight.parquet of `companion fleet`: says what has changed since",
    )
    options.add(parser, "--json")
    on_link = parser.add_argument_group("on a link")
    live.add_request_options(on_link)
    on_link.add_argument(
        "--duration", type=float, metavar="S", help=f"listen for so many seconds (default: {_LINK_S:g})"
    )
    on_link.add_argument("-o", "--output", metavar="FILE", help="keep the recording in this .tlog")


def run_preflight(arguments: argparse.Namespace) -> int:
    """Print the checks. Exit code: 0 where nothing is no-go, 1 where something is, 2 where nothing can be checked."""
    if is_link(arguments.log) and not Path(arguments.log).is_file():
        return _of_link(arguments)
    live.refuse_link_options(arguments, "duration")
    return _of_log(arguments)


def _of_link(arguments: argparse.Namespace) -> int:
    """Listen for a while, and check what was recorded."""
    with TemporaryDirectory(prefix="companion-") as folder:
        path = Path(arguments.output or Path(folder) / "preflight.tlog")
        recorded = argparse.Namespace(**vars(arguments))
        recorded.link, recorded.output = arguments.log, str(path)
        recorded.duration = _LINK_S if arguments.duration is None else arguments.duration
        with contextlib.redirect_stdout(sys.stderr):  # stdout is for the checks
            code = live.run_record(recorded)
        if code:
            return code
        arguments.log = str(path)
        return _of_log(arguments)


def _of_log(arguments: argparse.Namespace) -> int:
    settings, recording, flight = options.one_flight(arguments)
    result = preflight_of(flight)
    aged = _aged(arguments.history, settings, recording, flight, result) if arguments.history else ()
    tables.show(arguments, _lines(result, aged), lambda: preflight_document(recording.source, flight, result, aged))
    return 1 if result.outcome == "no_go" else 0


def _aged(
    history: str, settings: Settings, recording: Recording, flight: Flight, result: Preflight
) -> tuple[Ageing, ...]:
    """Against the earlier flights of the same vehicle."""
    earlier = earlier_checks(Path(history), settings, recording, flight)
    if not (aged := ageing(result, earlier)):
        raise DataError(
            f"{history} has {counted(len(earlier), 'flight')} of this vehicle that stood before taking off: three are "
            "needed to say what has changed."
        )
    return aged


def _lines(result: Preflight, aged: tuple[Ageing, ...]) -> Iterator[str | Table]:
    colour = _COLOURS[result.outcome]
    yield f"[bold {colour}]{escape(preflight_headline(result))}[/]"
    yield from (f"Not checked: {escape(one)}" for one in result.missing)
    yield from (f"The vehicle says: {escape(report)}" for report in result.vehicle_reports)
    yield ""
    table = preflight_table(result, aged)
    shown = tables.folded_table(*(column.title for column in table.columns))
    for row in table.rows:
        shown.add_row(*(escape(str(cell)) for cell in row))
    yield shown
