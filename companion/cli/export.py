"""`companion export LOG`: a flight for other tools: evo, Foxglove, spreadsheets, notebooks."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from companion.analysis import Replay, ape
from companion.app import files
from companion.app.examination import examine
from companion.cli import options, parsers
from companion.documents import analysis_document
from companion.export import FORMATS, Contents, assessed_replay, tables
from companion.model import DataError, SettingsError


def add_options(parser: parsers.Parser) -> None:
    """The command's options."""
    parsers.add_log(parser, *parsers.JUDGEMENT, "--reanchor")
    folders = ", ".join(name for name, one in FORMATS.items() if one.is_folder)
    parser.add_argument(
        "--format",
        choices=tuple(FORMATS),
        help="; ".join(f"{name}: {one.what}" for name, one in FORMATS.items()) + " (default: what the name ends in)",
    )
    parser.add_argument("-o", "--output", required=True, metavar="PATH", help=f"a folder for {folders}; else a file")
    parser.add_argument("--force", action="store_true", help="replace what is there already")


def run(arguments: argparse.Namespace) -> int:
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
        of_flight = tables(flight, shown, examined.assessment)
        document = partial(analysis_document, recording.source, examined)
        contents = Contents(flight, examined.assessment, shown, of_flight, document)
    with (files.filling if kind.is_folder else files.replacing)(path) as place:
        if contents is not None:
            written = kind.write(place, contents)
        elif kind.bare is not None:
            written = kind.bare(place, tables(flight))
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
