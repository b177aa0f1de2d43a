"""`companion export LOG`: a flight for other tools: evo, Foxglove, spreadsheets, notebooks."""

from __future__ import annotations

import argparse
from pathlib import Path

from companion.analysis import Replay, ape
from companion.app import destination
from companion.app.examination import examine
from companion.cli import options
from companion.documents import analysis_document
from companion.export import (
    reckoning_of,
    series_name,
    tables,
    write_annotations,
    write_csv,
    write_json,
    write_kml,
    write_mcap,
    write_parquet,
    write_tum,
)
from companion.model import DataError

_FOLDERS = ("tum", "csv", "parquet")  # the others are one file


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    parser = options.add_command(
        commands,
        "export",
        "A flight for evo, Foxglove, maps, spreadsheets, notebooks",
        "A flight for other tools: evo, Foxglove, spreadsheets, notebooks.",
        "companion export flight.tlog --format mcap -o flight.mcap",
    )
    options.add_judgement(parser)
    parser.add_argument(
        "--reanchor",
        dest="reanchor_s",
        type=float,
        metavar="S",
        help="start the IMU again from the autopilot's state every S seconds; 0 lets it run free (default: 10)",
    )
    parser.add_argument(
        "--format",
        required=True,
        choices=("tum", "csv", "parquet", "mcap", "json", "kml", "annotations"),
        help="tum: the trajectories for evo; csv, parquet: a file for each track; mcap: Foxglove; json: everything; "
        "kml: the paths for Google Earth; annotations: the findings for PX4's Flight Review (YAML)",
    )
    parser.add_argument(
        "-o", "--output", required=True, metavar="PATH", help="a folder for tum, csv and parquet; else a file"
    )
    parser.add_argument("--force", action="store_true", help="replace what is there already")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write the flight."""
    path, kind = Path(arguments.output), arguments.format
    (destination.check_folder if kind in _FOLDERS else destination.check)(path, force=arguments.force)
    settings = options.settings_of(arguments)
    recording = options.read(arguments, settings)
    flight = recording.flights[options.choose(recording.flights, arguments)]
    try:
        examined = examine(
            flight, settings, imu=arguments.imu, imu_model=arguments.imu_model, correction=arguments.correction
        )
        shown = reckoning_of(flight, examined.assessment, settings.view.reanchor_s or None)
    except DataError as error:
        if kind not in {"csv", "parquet"}:
            raise
        options.say(f"only what the log has: {error}")
        contents = tables(flight)
    else:
        contents = tables(flight, shown, examined.assessment)
    with (destination.filling if kind in _FOLDERS else destination.replacing)(path) as place:
        match kind:
            case "tum":
                files = write_tum(place, flight, shown, examined.assessment.best)
            case "csv":
                files = write_csv(place, contents)
            case "parquet":
                files = write_parquet(place, contents)
            case "mcap":
                series = [contents[series_name(key)] for key in flight.series]
                files = write_mcap(place, flight, shown, examined.assessment, series)
            case "kml":
                files = write_kml(place, flight, shown, examined.assessment.best)
            case "annotations":
                files = write_annotations(place, examined.assessment.verdict)
            case _:
                files = write_json(place, analysis_document(recording.source, examined), contents)
    names = ", ".join(file.name for file in files) if kind in _FOLDERS else ""
    print(f"written: {path}" + (f": {names}" if names else ""))
    if kind == "tum":
        print(_ape_line(shown))
    return 0


def _ape_line(shown: Replay) -> str:
    """What evo_ape will say of the pair."""
    pose_error = ape(shown)
    position = f"{pose_error.position_m.rmse:.6f} m, " if pose_error.position_m else ""
    return f"APE (rmse, not aligned): {position}{pose_error.attitude_deg.rmse:.6f}°"
