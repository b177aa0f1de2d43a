"""`companion report LOG`: the whole examination of a flight as one HTML file."""

from __future__ import annotations

import argparse
import shlex
import sys
import webbrowser
from pathlib import Path

from companion.app import files
from companion.app.examination import examined_or_not
from companion.cli import options, parsers


def add_options(parser: parsers.Parser) -> None:
    """The command's options."""
    parsers.add_log(parser, *parsers.JUDGEMENT)
    parsers.add_output(parser, "FILE", "where to write it (default: LOG's name, .html, here)")
    parser.add_argument("--open", action="store_true", help="show it in the browser")
    parser.add_argument("--no-playback", action="store_true", help="leave the 3D playback out: a smaller file")


def run(arguments: argparse.Namespace) -> int:
    """Write the report of one flight."""
    from companion.report import report_html  # noqa: PLC0415  (--help needs none of it)

    path = Path(arguments.output or f"{Path(arguments.log).stem}.html")
    files.check(path, force=arguments.force)
    settings, recording, flight = options.one_flight(arguments, every_message=True)
    if arguments.imu is not None:
        flight.imu(arguments.imu)  # one that was requested and is not there is a mistake, not a poor log
    examined = examined_or_not(flight, settings, **options.chosen(arguments))
    command, playback = shlex.join(["companion", *sys.argv[1:]]), not arguments.no_playback
    page = report_html(examined, recording.source, settings, command=command, with_playback=playback)
    files.write(path, page)
    if arguments.open:
        webbrowser.open(path.resolve().as_uri())
    print(f"{path}: {path.stat().st_size:,} bytes. {examined.verdict.summary}")
    return 0
