"""`companion series LOG [TABLE]`: values of a flight over time, for programs; without a table which ones there are."""

from __future__ import annotations

import argparse
import csv
import math
import sys

from companion.app.examination import examine
from companion.cli import options, parsers
from companion.documents import encode, series_document
from companion.export import assessed_replay, harmless, listed, tables, thinned
from companion.model import DataError, counted, nearest_word

_EXAMINED = ("reckoning", "best_estimate", "drift", "windows", "findings", "calibration")
"""Tables of an examination, which is made when one of them is requested."""

_MOST_POINTS = 5000


def add_options(parser: parsers.Parser) -> None:
    """The command's options."""
    parsers.add_log(parser, *parsers.FLIGHT)
    examined = ", ".join(_EXAMINED)
    parser.add_argument("table", metavar="TABLE", nargs="?", help=f"a table of the log, or of its analysis: {examined}")
    parser.add_argument("--from", dest="begin", type=float, metavar="S", help="from this time of the boot clock on")
    parser.add_argument("--to", dest="end", type=float, metavar="S", help="up to this time")
    points = parsers.whole(1, _MOST_POINTS, f"from 1 to {_MOST_POINTS}")
    parser.add_argument("--points", type=points, default=500, metavar="N", help="rows at most, evenly (default: 500)")
    parsers.add(parser, "--json")


def run(arguments: argparse.Namespace) -> int:
    """Print the table as CSV or JSON; or a line for each table."""
    settings, recording, flight = options.one_flight(arguments)
    known = tables(flight)
    name = arguments.table
    if name in _EXAMINED:
        examined = examine(flight, settings).assessment
        known = tables(flight, assessed_replay(flight, examined, settings.view.reanchor_s or None), examined)
    if name is not None and name not in known:
        near = nearest_word(name, [*known, *_EXAMINED])
        hint = f" Did you mean {near}?" if near else f" It has: {', '.join(known)}."
        raise DataError(f"{arguments.log} has no table {name}.{hint}")
    if name is None:
        listing, series = [listed(table) for table in known.values()], None
    else:
        listing, series = [], thinned(known[name], (arguments.begin, arguments.end), arguments.points)
    if arguments.json:
        print(encode(series_document(recording.source, flight, listing, series)))
    elif series is None:
        for table in known.values():
            print(f"{table.name}: {counted(len(table), 'row')}: {', '.join(column.name for column in table)}")
    else:
        columns = series["columns"]
        rows = csv.writer(sys.stdout, lineterminator="\n")
        rows.writerow(column["name"] for column in columns)
        rows.writerows(map(_cell, row) for row in zip(*(column["values"] for column in columns), strict=True))
    return 0


def _cell(value: float | str) -> float | str:
    """As the CSV of `companion export` has it."""
    return harmless(value) if isinstance(value, str) else "" if math.isnan(value) else value
