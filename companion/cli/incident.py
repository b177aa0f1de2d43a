"""`companion incident LOG`: the seconds around what went wrong, as a page for a forum post or an issue."""

from __future__ import annotations

import argparse
from pathlib import Path

from companion.analysis import incident
from companion.app import files
from companion.app.examination import assess_imu, unexaminable
from companion.cli import options, parsers
from companion.documents import encode, incident_document
from companion.present import incident_markdown


def add_options(parser: parsers.Parser) -> None:
    """The command's options."""
    parsers.add_log(parser, *parsers.FLIGHT)
    parser.add_argument(
        "--at", type=float, metavar="S", help="seconds of the boot clock (default: what went wrong first and worst)"
    )
    parsers.add(parser, "--json")
    parsers.add_output(parser, "FILE", "write it to FILE.md, or FILE.html with charts (default: print Markdown)")


def run(arguments: argparse.Namespace) -> int:
    """Print the page, or write it."""
    path = options.output(arguments, (".md", ".html"))
    settings, recording, flight = options.one_flight(arguments)
    # without IMU or attitude a log has the rest alone
    assessment = None if unexaminable(flight, settings) is not None else assess_imu(flight, settings)
    shown = incident(flight, assessment, arguments.at)
    verdict = "" if assessment is None else assessment.verdict.summary
    name = Path(arguments.log).name
    if arguments.json:
        print(encode(incident_document(recording.source, flight, shown)))
    if path is not None and path.suffix == ".html":
        from companion.report import incident_html  # noqa: PLC0415  (the charts are slow to import)

        page = incident_html(shown, flight, None if assessment is None else assessment.best, verdict, name)
    else:
        page = incident_markdown(shown, flight, verdict, name)
    if path is not None:
        files.write(path, page)
        options.say(f"written: {path}")
    elif not arguments.json:
        print(page, end="")
    return 0
