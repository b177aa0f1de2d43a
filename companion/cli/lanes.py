"""`companion lanes LOG`: which lane of the estimator should have been flown, and whether each switch was right."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from rich.table import Table

from companion.analysis import Lanes
from companion.app.examination import assess_imu, lanes_of
from companion.cli import options, parsers, tables
from companion.documents import lanes_document
from companion.estimation import BestEstimate
from companion.present import capitalised, lane_lines, lane_table, words

_WIDTH = 100


def add_options(parser: parsers.Parser) -> None:
    """The command's options."""
    parsers.add_log(parser, *parsers.FLIGHT)
    parsers.add_carrier(parser)
    parsers.add(parser, "--json")


def run(arguments: argparse.Namespace) -> int:
    """Print every lane against the best estimate."""
    settings, recording, flight = options.one_flight(arguments)
    own = assess_imu(flight, settings, imu=arguments.imu)
    lanes, best = lanes_of(flight, settings, own)
    tables.show(arguments, _lines(lanes, best), lambda: lanes_document(recording.source, flight, best, lanes))
    return 0


def _lines(lanes: Lanes, best: BestEstimate) -> Iterator[str | Table]:
    yield f"By the best estimate of {best.imu.source}, {best.t[0]:.1f}-{best.t[-1]:.1f} s, without the estimator's own"
    for line in lane_lines(lanes):
        yield from tables.wrapped(line, _WIDTH, 2)
    for span in lanes.spans:
        if span.lanes:
            title = capitalised(words(span.what))
            yield f"\n[bold]{title}, {span.start_s:.1f}-{span.end_s:.1f} s[/]: error, 95 %, ± of the best estimate"
            yield tables.rendered(lane_table(span))
