"""Options that several commands share, and what follows from them."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import msgspec
import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import Progress

from companion import installation
from companion.app import destination
from companion.app.recording import Recording, Source, read_recording, usable_samples
from companion.app.settings import Settings, load_settings
from companion.cli.stdin import STDIN
from companion.model import IMU_MESSAGES, DataError, Flight, InputError, SettingsError, counted
from companion.strapdown import METHODS, MIDDLES

_SETTABLE = (
    ("log", "dialect", "dialect"),
    ("log", "max_size_gb", "max_size"),
    ("integration", "method", "method"),
    ("integration", "middle", "middle"),
    ("drift", "horizons_s", "horizons"),
    ("view", "host", "host"),
    ("view", "port", "port"),
    ("view", "token", "token"),
    ("view", "reanchor_s", "reanchor_s"),
    ("view", "map_url", "map_url"),
)
"""Options that are settings too: section, key, name of the option."""


Parser = argparse.ArgumentParser

_PAGE_BYTES = 256
_LARGE_BYTES = 20_000_000


Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
Run = Callable[[argparse.Namespace], int]


def add_command(commands: Commands, run: Run, name: str, brief: str, summary: str, example: str) -> Parser:
    """A command. brief: what it does, in one line of a list; summary: the same in a sentence or two."""
    parser = commands.add_parser(name, help=brief, description=summary, epilog=f"example: {example}")
    parser.set_defaults(run=run)
    return parser


def add_log_command(
    commands: Commands,
    run: Run,
    name: str,
    brief: str,
    summary: str,
    example: str,
    *,
    takes_link: bool = False,
    takes_several: bool = False,
) -> Parser:
    """A command that takes a log, with the options that every such command has.

    takes_link: or a link. takes_several: `arguments.logs` are the logs, folders and patterns.
    """
    parser = add_command(commands, run, name, brief, summary, example)
    log = "a log: .tlog, ArduPilot .bin or .log, PX4 .ulg; demo for the bundled flight; - for stdin"
    link = "; or a link: udpin:HOST:PORT, tcp:HOST:PORT, /dev/ttyACM0[:BAUD]" if takes_link else ""
    if takes_several:
        parser.add_argument("logs", metavar="LOG", nargs="+", help=log)
    else:
        parser.add_argument("log", metavar="LOG|LINK" if takes_link else "LOG", help=log + link)
    parser.set_defaults(piped=None)
    add_settings(parser)
    return parser


def add_json(parser: Parser) -> None:
    """The results for programs."""
    parser.add_argument("--json", action="store_true", help="the same as JSON on stdout (docs/json.md)")


def add_output(parser: Parser, metavar: str, help: str, force: str = "replace what is there already") -> None:
    """Where to write."""
    parser.add_argument("-o", "--output", metavar=metavar, help=help)
    parser.add_argument("--force", action="store_true", help=force)


def output(arguments: argparse.Namespace) -> Path | None:
    """The file that was named to write to. Raises InputError where it cannot be written."""
    if not arguments.output:
        return None
    path = Path(arguments.output)
    destination.check(path, force=arguments.force)
    return path


def add_reanchor(parser: Parser) -> None:
    """How long the IMU is integrated alone."""
    parser.add_argument(
        "--reanchor",
        dest="reanchor_s",
        type=float,
        metavar="S",
        help="restart from the autopilot's state every S seconds; 0: never (default: 10)",
    )


def add_source(parser: Parser) -> None:
    """Where settings come from, and the one that is needed to read messages."""
    parser.add_argument("--config", metavar="FILE", help="settings file; config/default.toml describes every key")
    parser.add_argument("--dialect", metavar="NAME", help="MAVLink dialect (default: ardupilotmega)")


def add_settings(parser: Parser) -> None:
    """The same, and the one that is needed to read a log."""
    add_source(parser)
    parser.add_argument(
        "--max-size",
        type=float,
        metavar="GB",
        help="the most that a compressed log may grow to, and that stdin may have (default: 0.8)",
    )


def add_flight_choice(parser: Parser) -> None:
    """Which of the log's flights."""
    parser.add_argument(
        "--vehicle", metavar="SYSID[:COMPID]", help="the vehicle (default: the one with the most IMU data)"
    )
    parser.add_argument("--boot", type=int, metavar="N", help="the vehicle's N-th boot in the log, from 1")
    add_core(parser)


def add_core(parser: Parser) -> None:
    """Which of the estimates in an on-board log."""
    parser.add_argument(
        "--core",
        type=int,
        metavar="N",
        help="the EKF core of a .bin to compare with, from 0 (default: the one that flew)",
    )


def add_integration(parser: Parser) -> None:
    """Which IMU, integrated how."""
    parser.add_argument(
        "--imu",
        metavar="NAME",
        help=f"message to integrate: {', '.join(IMU_MESSAGES)}, or a track of an on-board log "
        "(default: depends on the autopilot, and is stated)",
    )
    parser.add_argument("--method", choices=METHODS, help="integrator (default: rk4)")
    parser.add_argument("--middle", choices=MIDDLES, help="the signal between two samples (default: cubic)")


def add_imu_model(parser: Parser) -> None:
    """What the IMU is expected to be like."""
    parser.add_argument(
        "--imu-model",
        metavar="NAME",
        help="part of config/imu, or a .toml file like those (default: what the parameters name, else generic-mems)",
    )


def add_judgement(parser: Parser) -> None:
    """How a flight is examined: which IMU of which flight, what it should be like, over which windows."""
    add_flight_choice(parser)
    add_integration(parser)
    add_imu_model(parser)
    parser.add_argument("--correction", metavar="FILE", help="take the errors out that companion calibrate found")
    parser.add_argument("--horizons", type=_horizons, metavar="S,S,...", help="seconds (default: 1,2,5,10,30)")


def chosen(arguments: argparse.Namespace) -> dict[str, Any]:
    """What `add_judgement` has the user choose of an IMU, as `companion.app.examination` takes it."""
    return {name: getattr(arguments, name) for name in ("imu", "imu_model", "correction")}


def add_anchor(parser: Parser) -> None:
    """Where dead reckoning starts from."""
    parser.add_argument(
        "--anchor",
        choices=("autopilot", "rest"),
        default="autopilot",
        help="rest: align the IMU by itself where the vehicle first stands still, and dead-reckon from there on "
        "(default: autopilot)",
    )


def most_bytes(arguments: argparse.Namespace) -> int:
    """What a log on stdin may have."""
    return round(settings_of(arguments).log.max_size_gb * 1e9)


def settings_of(arguments: argparse.Namespace) -> Settings:
    """The settings file with the command line's options put over it. Raises SettingsError for one out of range."""
    given = {name: value for name, value in vars(arguments).items() if value is not None}
    merged = msgspec.to_builtins(load_settings(arguments.config))
    for section, name, option in _SETTABLE:
        if option in given:
            merged[section][name] = given[option]
    try:
        settings = msgspec.convert(merged, Settings)
    except msgspec.ValidationError as error:
        reason, _, where = str(error).partition(" - at `$.")
        section, _, name = where.rstrip("`").partition(".")
        option = (
            next(o for s, n, o in _SETTABLE if s == section and name.split("[")[0] == n)
            .removesuffix("_s")
            .replace("_", "-")
        )
        raise SettingsError(f"--{option}: {reason[:1].lower()}{reason[1:]}.") from None
    method = settings.integration.method
    if "middle" in given and not METHODS[method].looks_inside:
        others = " and ".join(name for name, one in METHODS.items() if one.looks_inside)
        raise SettingsError(f"--middle is {others}'s, and {method} has no sample in mid-step: leave one of them out.")
    return settings


def log_path(arguments: argparse.Namespace) -> Path:
    """The log that was named."""
    return _path(arguments.log, arguments.piped)


def log_paths(arguments: argparse.Namespace) -> list[str]:
    """The logs, folders and patterns that were named."""
    return [str(_path(name, arguments.piped)) for name in arguments.logs]


def _path(name: str, piped: Path | None) -> Path:
    """A log by its name; demo is the bundled one, and piped what came from stdin."""
    if name == STDIN and piped is not None:
        return piped
    path = installation.log_path(name)
    if not path.exists():
        from companion.links import is_link, meant_link  # noqa: PLC0415  (what they load is needed for links alone)

        if link := name if is_link(name) else meant_link(name):
            raise InputError(f"There is no file {name}. If a link is meant: companion view {link} or record {link}")
    return path


def exit_code(fail_on: str | None, statuses: Iterable[str]) -> int:
    """1 where --fail-on says so of the verdicts: somebody is suspect, or ("insufficient") one is not consistent."""
    if fail_on == "suspect":
        return int(any(status.endswith("suspect") for status in statuses))
    return int(fail_on == "insufficient" and any(status != "consistent" for status in statuses))


def read(arguments: argparse.Namespace, settings: Settings, *, every_message: bool = False) -> Recording:
    """The log that was named; every_message: see `read_recording`."""
    path = log_path(arguments)
    with _progress(path) as progress:
        recording = read_recording(
            path,
            every_message=every_message,
            core=getattr(arguments, "core", None),
            progress=progress,
            **settings.log.options,
        )
    if path == arguments.piped:
        recording = replace(recording, source=replace(recording.source, path=Path(STDIN), kept_in=path))
    warn_of_damage(recording.source)
    return recording


def one_flight(arguments: argparse.Namespace, *, every_message: bool = False) -> tuple[Settings, Recording, Flight]:
    """The settings, the log that was named, and the flight of it that was requested: see `choose`."""
    settings = settings_of(arguments)
    recording = read(arguments, settings, every_message=every_message)
    return settings, recording, recording.flights[choose(recording, arguments)]


@contextlib.contextmanager
def _progress(path: Path) -> Iterator[Callable[[int], None] | None]:
    """A bar on stderr while a large file is read by someone who is watching."""
    size = path.stat().st_size if path.is_file() else 0
    if size < _LARGE_BYTES or not sys.stderr.isatty():
        yield None
        return
    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(f"reading {escape(path.name)}", total=size)
        yield lambda read: bar.advance(task, read)


def choose(recording: Recording, arguments: argparse.Namespace) -> int:
    """Index of the flight that was requested, by default the one with the most IMU samples beside an attitude.

    Raises DataError when the log has no such vehicle or boot; lists what it has.
    """
    flights = recording.flights
    if not flights:
        raise DataError(f"{arguments.log}: {recording.no_flight}. See what it has with: companion info {arguments.log}")
    matching = [i for i, flight in enumerate(flights) if _matches(flight, arguments)]
    if not matching:
        requested = " ".join(
            f"--{name} {value}" for name in ("vehicle", "boot") if (value := getattr(arguments, name)) is not None
        )
        have = "; ".join(f"--vehicle {f.vehicle} --boot {f.boot}" for f in flights)
        raise DataError(f"no flight in {arguments.log} matches {requested}. It has: {have}.")
    chosen = max(matching, key=lambda i: usable_samples(flights[i]))
    if len(matching) > 1:
        flight = flights[chosen]
        others = "; ".join(f"--vehicle {flights[i].vehicle} --boot {flights[i].boot}" for i in matching if i != chosen)
        say(f"{len(matching)} flights: using vehicle {flight.vehicle}, boot {flight.boot}. Others: {others}")
    return chosen


def warn_of_damage(source: Source) -> None:
    """Say on stderr what of the log could not be read."""
    if source.trouble:
        say(f"{source.path}: {source.trouble}")
    tail = _PAGE_BYTES if source.format == "dataflash" else 0  # the logger fills up its last page
    if source.bad_crc_frames or source.skipped_bytes > tail:
        say(
            f"damaged log: {source.skipped_bytes:,} of {source.content_bytes:,} bytes skipped, "
            f"{counted(source.bad_crc_frames, 'frame')} with a wrong checksum left out; "
            f"{counted(source.frames, 'good frame')} read"
        )


def say(text: str) -> None:
    """A line for the person at the terminal: stderr, so that results on stdout stay clean."""
    print(text, file=sys.stderr)


def other_port(requested: int, served: int) -> str:
    """The message where another port than the one that was requested is served on; nothing where any would do."""
    return f"port {requested} is taken: using {served}" if requested not in (0, served) else ""


def _matches(flight: Flight, arguments: argparse.Namespace) -> bool:
    requested = str(arguments.vehicle) if arguments.vehicle is not None else None
    vehicle = requested is None or requested in {str(flight.vehicle), str(flight.vehicle.sysid)}
    return vehicle and arguments.boot in {None, flight.boot}


def _horizons(text: str) -> tuple[float, ...]:
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if not values or not all(np.isfinite(v) and v > 0 for v in values):
        raise argparse.ArgumentTypeError(f"must be positive seconds like 1,5,10, got {text!r}")
    return values
