"""`companion export LOG`: a flight for other tools: evo, Foxglove, spreadsheets, notebooks."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from companion.analysis import Replay, ape
from companion.app import destination
from companion.app.examination import Examination, examine
from companion.app.recording import Source
from companion.cli import options
from companion.documents import analysis_document
from companion.estimation import BestEstimate
from companion.export import (
    Table,
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
from companion.model import DataError, Flight


@dataclass(frozen=True, slots=True)
class _Contents:
    """What there is to be written of a flight."""

    source: Source
    flight: Flight
    examined: Examination
    shown: Replay
    tables: Mapping[str, Table]

    @property
    def best(self) -> BestEstimate | None:
        """Where there is one."""
        return self.examined.assessment.best


def _mcap(path: Path, one: _Contents) -> list[Path]:
    series = [one.tables[series_name(key)] for key in one.flight.series]
    return write_mcap(path, one.flight, one.shown, one.examined.assessment, series)


@dataclass(frozen=True, slots=True)
class Format:
    """One format. `bare` writes the tables of a log that cannot be examined; None where that would be nothing."""

    what: str
    write: Callable[[Path, _Contents], list[Path]]
    bare: Callable[[Path, Mapping[str, Table]], list[Path]] | None = None
    is_folder: bool = False


def _of_tables(what: str, write: Callable[[Path, Mapping[str, Table]], list[Path]]) -> Format:
    return Format(what, lambda path, c: write(path, c.tables), write, is_folder=True)


FORMATS: Mapping[str, Format] = {
    "tum": Format(
        "the trajectories for evo", lambda path, c: write_tum(path, c.flight, c.shown, c.best), is_folder=True
    ),
    "csv": _of_tables("a file for each track", write_csv),
    "parquet": _of_tables("the same, with units and frames", write_parquet),
    "mcap": Format("Foxglove", _mcap),
    "json": Format("everything", lambda path, c: write_json(path, analysis_document(c.source, c.examined), c.tables)),
    "kml": Format("the paths for Google Earth", lambda path, c: write_kml(path, c.flight, c.shown, c.best)),
    "annotations": Format(
        "the findings for PX4's Flight Review (YAML)",
        lambda path, c: write_annotations(path, c.examined.assessment.verdict),
    ),
}


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
    folders = ", ".join(name for name, one in FORMATS.items() if one.is_folder)
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
        choices=tuple(FORMATS),
        help="; ".join(f"{name}: {one.what}" for name, one in FORMATS.items()),
    )
    parser.add_argument("-o", "--output", required=True, metavar="PATH", help=f"a folder for {folders}; else a file")
    parser.add_argument("--force", action="store_true", help="replace what is there already")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write the flight."""
    path, kind = Path(arguments.output), FORMATS[arguments.format]
    (destination.check_folder if kind.is_folder else destination.check)(path, force=arguments.force)
    settings = options.settings_of(arguments)
    recording = options.read(arguments, settings)
    flight = recording.flights[options.choose(recording.flights, arguments)]
    contents: _Contents | None = None
    try:
        examined = examine(
            flight, settings, imu=arguments.imu, imu_model=arguments.imu_model, correction=arguments.correction
        )
        shown = reckoning_of(flight, examined.assessment, settings.view.reanchor_s or None)
    except DataError as error:
        if kind.bare is None:
            raise
        options.say(f"only what the log has: {error}")
    else:
        of_flight = tables(flight, shown, examined.assessment)
        contents = _Contents(recording.source, flight, examined, shown, of_flight)
    with (destination.filling if kind.is_folder else destination.replacing)(path) as place:
        if contents is not None:
            files = kind.write(place, contents)
        elif kind.bare is not None:
            files = kind.bare(place, tables(flight))
    names = ", ".join(file.name for file in files) if kind.is_folder else ""
    print(f"written: {path}" + (f": {names}" if names else ""))
    if arguments.format == "tum" and contents is not None:
        print(_ape_line(contents.shown))
    return 0


def _ape_line(shown: Replay) -> str:
    """What evo_ape will say of the pair."""
    pose_error = ape(shown)
    position = f"{pose_error.position_m.rmse:.6f} m, " if pose_error.position_m else ""
    return f"APE (rmse, not aligned): {position}{pose_error.attitude_deg.rmse:.6f}°"
