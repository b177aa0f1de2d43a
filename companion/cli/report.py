"""`companion report LOG`: the whole examination of a flight as one HTML file."""

from __future__ import annotations

import argparse
import gc
import shlex
import sys
from dataclasses import replace
from pathlib import Path

from companion.app import destination
from companion.app.examination import comparison_of, examine, imus_of, unexaminable
from companion.app.resources import begun
from companion.cli import options


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    parser = options.add_command(
        commands,
        "report",
        "One HTML file with verdict, charts and 3D replay",
        "One HTML file with the verdict, the charts and the 3D playback of a flight: to mail, to print, to keep.",
        "companion report flight.tlog -o report.html",
    )
    options.add_judgement(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help="where to write it (default: LOG's name, .html, here)")
    parser.add_argument("--force", action="store_true", help="replace FILE when it is there already")
    parser.add_argument("--no-playback", action="store_true", help="leave the 3D playback out: a smaller file")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write the report of one flight.

    Nothing big in it refers to itself: to look for such circles, again and again among the 20,000 messages of a
    playback, is a fiftieth of the work.
    """
    collecting = gc.isenabled()
    gc.disable()
    try:
        return _written(arguments)
    finally:
        if collecting:
            gc.enable()


def _written(arguments: argparse.Namespace) -> int:
    from companion.report import bare_html, made_apart, report_html  # noqa: PLC0415  (--help needs none of it)

    path = Path(arguments.output or f"{Path(arguments.log).stem}.html")
    destination.check(path, force=arguments.force)
    settings, recording, flight = options.one_flight(arguments, every_message=True)
    if arguments.imu is not None:
        flight.imu(arguments.imu)  # one that was asked for and is not there is a mistake, not a poor log
    command = shlex.join(["companion", *sys.argv[1:]])
    if (lacking := unexaminable(flight, settings)) is not None:
        summary = lacking.verdict.summary
        page = bare_html(lacking, recording.source, settings, command=command)
    else:
        chosen = {"imu": arguments.imu, "imu_model": arguments.imu_model, "correction": arguments.correction}
        begin = comparison_of(flight, settings, **chosen)
        with_playback = not arguments.no_playback
        apart = begun(lambda: made_apart(flight, *begin, settings, with_playback=with_playback))
        imus = begun(lambda: imus_of(flight, settings, imu_model=arguments.imu_model))
        examined = replace(examine(flight, settings, **chosen), beside=imus)
        summary = examined.assessment.verdict.summary
        page = report_html(
            examined, recording.source, settings, command=command, with_playback=with_playback, apart=apart
        )
    with destination.replacing(path) as part:
        part.write_text(page, encoding="utf-8")
    print(f"{path}: {path.stat().st_size:,} bytes. {summary}")
    return 0
