"""A flight, or what was found in it, as a file: `companion export`, `series`, `report`, `calibrate` and `incident`."""

from __future__ import annotations

import argparse
import csv
import math
import shlex
import sys
import webbrowser
from functools import partial
from pathlib import Path

from companion.app import files
from companion.app.correction import correction_text
from companion.app.examination import assess_imu, examine, examined_or_not, unexaminable
from companion.cli import options, tables
from companion.comparison import Replay, ape
from companion.documents import analysis_document, encode, incident_document, series_document
from companion.export import FORMATS, Contents, assessed_replay, csv_cell, listed, thinned
from companion.export import tables as tables_of
from companion.model import DataError, SettingsError, counted, nearest_word
from companion.present import incident_markdown
from companion.verdict import incident


def export_options(parser: options.Parser) -> None:
    """The command's options."""
    options.add_log(parser, *options.JUDGEMENT, "--reanchor")
    folders = ", ".join(name for name, one in FORMATS.items() if one.is_folder)
    parser.add_argument(
        "--format",
        choices=tuple(FORMATS),
        help="; ".join(f"{name}: {one.what}" for name, one in FORMATS.items()) + " (default: what the name ends in)",
    )
    parser.add_argument("-o", "--output", required=True, metavar="PATH", help=f"a folder for {folders}; else a file")
    parser.add_argument("--force", action="store_true", help="replace what is there already")


def run_export(arguments: argparse.Namespace) -> int:
    """Write the flight."""
    path = Path(arguments.output)
    kind = FORMATS[arguments.format or _by_name(path)]
    (files.check_folder if kind.is_folder else files.check)(path, force=arguments.force)
    settings, recording, flight = options.one_flight(arguments)
    contents: Contents | None = None
    try:
        examined = examine(flight, settings, **options.chosen(arguments))
        shown = assessed_replay(flight, examined.assessment, settings.view.reanchor_s or None)
    except DataError as error:
        if kind.bare is None:
            raise
        options.say(f"only what the log has: {error}")
    else:
        of_flight = tables_of(flight, shown, examined.assessment)
        document = partial(analysis_document, recording.source, examined)
        contents = Contents(flight, examined.assessment, shown, of_flight, document)
    with (files.filling if kind.is_folder else files.replacing)(path) as place:
        if contents is not None:
            written = kind.write(place, contents)
        elif kind.bare is not None:
            written = kind.bare(place, tables_of(flight))
    names = ", ".join(file.name for file in written) if kind.is_folder else ""
    print(f"written: {path}" + (f": {names}" if names else ""))
    if kind.name == "tum" and contents is not None:
        print(_ape_line(contents.shown))
    return 0


def _by_name(path: Path) -> str:
    """The format that a file's name ends in. Raises SettingsError for one that ends in none."""
    name = path.suffix.removeprefix(".").lower()
    if name in FORMATS and not FORMATS[name].is_folder:
        return name
    endings = ", ".join(f".{known}" for known, one in FORMATS.items() if not one.is_folder)
    raise SettingsError(f"the format of {path} is not known: give --format, or a name that ends in {endings}.")


def _ape_line(shown: Replay) -> str:
    """The result of evo_ape for the pair."""
    pose_error = ape(shown)
    position = f"{pose_error.position_m.rmse:.6f} m, " if pose_error.position_m else ""
    return f"APE (rmse, not aligned): {position}{pose_error.attitude_deg.rmse:.6f}°"


_EXAMINED = ("reckoning", "best_estimate", "drift", "windows", "findings", "calibration")
"""Tables of an examination, which is made when one of them is requested."""

_MOST_POINTS = 5000


def _number(text: str) -> float:
    """A number: nan is none, and nothing is before or after it."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise argparse.ArgumentTypeError(f"must be a number, got {text!r}")
    return value


def series_options(parser: options.Parser) -> None:
    """The command's options."""
    options.add_log(parser, *options.FLIGHT)
    examined = ", ".join(_EXAMINED)
    parser.add_argument("table", metavar="TABLE", nargs="?", help=f"a table of the log, or of its analysis: {examined}")
    parser.add_argument("--from", dest="begin", type=_number, metavar="S", help="from this time of the boot clock on")
    parser.add_argument("--to", dest="end", type=_number, metavar="S", help="up to this time")
    points = options.whole(1, _MOST_POINTS, f"from 1 to {_MOST_POINTS}")
    parser.add_argument("--points", type=points, default=500, metavar="N", help="rows at most, evenly (default: 500)")
    options.add(parser, "--json")


def run_series(arguments: argparse.Namespace) -> int:
    """Print the table as CSV or JSON; or a line for each table."""
    settings, recording, flight = options.one_flight(arguments)
    known = tables_of(flight)
    name = arguments.table
    if name in _EXAMINED:
        examined = examine(flight, settings).assessment
        known = tables_of(flight, assessed_replay(flight, examined, settings.view.reanchor_s or None), examined)
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
        rows.writerows(map(csv_cell, row) for row in zip(*(column["values"] for column in columns), strict=True))
    return 0


def report_options(parser: options.Parser) -> None:
    """The command's options."""
    options.add_log(parser, *options.JUDGEMENT)
    options.add_output(parser, "FILE", "where to write it (default: LOG's name, .html, here)")
    parser.add_argument("--open", action="store_true", help="show it in the browser")
    parser.add_argument("--no-playback", action="store_true", help="leave the 3D playback out: a smaller file")


def run_report(arguments: argparse.Namespace) -> int:
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


def calibrate_options(parser: options.Parser) -> None:
    """The command's options."""
    options.add_log(parser, *options.FLIGHT, *options.INTEGRATION, "--imu-model")
    force = "replace FILE when it is there already, and write it when the flight is no good for it"
    options.add_output(parser, "FILE", "write the correction for analyze --correction", force)


def run_calibrate(arguments: argparse.Namespace) -> int:
    """Print the calibration; write it where requested."""
    path = options.output(arguments)
    settings, _, flight = options.one_flight(arguments)
    assessment = assess_imu(flight, settings, imu=arguments.imu, imu_model=arguments.imu_model)
    if assessment.calibration is None:
        raise DataError(f"no calibration: {assessment.verdict.summary}")
    calibrated = tables.calibration_lines(assessment)
    tables.console().lines(*tables.verdict_lines(assessment.verdict, most=3), "", *calibrated)
    if path is None:
        return 0
    if not arguments.force and (assessment.verdict.status == "insufficient_data" or assessment.made_worse):
        raise DataError(
            "not written: this flight does not determine the IMU's constant errors (see above). "
            "Write it all the same: --force"
        )
    files.write(path, correction_text(assessment.calibration, f"{arguments.log} ({assessment.drift.imu})"))
    options.say(f"written: {path}")
    return 0


def incident_options(parser: options.Parser) -> None:
    """The command's options."""
    options.add_log(parser, *options.FLIGHT)
    parser.add_argument(
        "--at", type=float, metavar="S", help="seconds of the boot clock (default: what went wrong first and worst)"
    )
    options.add(parser, "--json")
    options.add_output(parser, "FILE", "write it to FILE.md, or FILE.html with charts (default: print Markdown)")


def run_incident(arguments: argparse.Namespace) -> int:
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
