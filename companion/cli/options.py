"""The options that several commands share; and from them to its settings, its log, the flight of it, and the exit code.

A log that is piped in (`-` in place of its name) is kept in a file while the command runs, for logs are read more than
once.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import re
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn, TextIO, TypeAlias

import msgspec
from rich.console import Console
from rich.markup import escape
from rich.progress import Progress

from companion import installation
from companion.app import files
from companion.app.recording import Recording, Source, read_recording, usable_samples
from companion.app.settings import Settings, load_settings
from companion.model import IMU_MESSAGES, CompanionError, DataError, Flight, InputError, SettingsError, counted
from companion.strapdown import METHODS, MIDDLES

STDIN = "stdin"
"""What a log that is piped in is called."""

_PIECE_BYTES = 1 << 20
_ENDING = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
Handler: TypeAlias = "Callable[[int, FrameType | None], object] | signal.Handlers"
_EXAMPLE = "xz -dc flight.tlog.xz | companion analyze -"


@contextlib.contextmanager
def kept(arguments: argparse.Namespace) -> Iterator[None]:
    """Where a command's log is `-`: stdin in a file of its user's own, which is gone when the command ends.

    The log is called STDIN from then on, and `arguments.piped` is that file.

    Raises InputError for a stdin that has nothing, too much or is a terminal; SettingsError where it is named twice.
    """
    named = [name for name in ("log", "b") if getattr(arguments, name, None) == "-"]
    several = [i for i, name in enumerate(getattr(arguments, "logs", ())) if name == "-"]
    if not named and not several:
        yield
        return
    if len(named) + len(several) > 1:
        raise SettingsError("- stands for the log on stdin, which is read once: name the other one by its path.")
    most_bytes = round(settings_of(arguments).log.max_size_gb * 1e9)
    with handled(_endings()), tempfile.TemporaryDirectory(prefix="companion-") as folder:
        path = Path(folder) / STDIN
        _keep(path, most_bytes)
        arguments.piped = path
        for name in named:
            setattr(arguments, name, STDIN)
        for i in several:
            arguments.logs[i] = STDIN
        try:
            yield
        except CompanionError as error:  # nobody knows that file by its path, nor finds it any more
            error.args = tuple(str(part).replace(str(path), STDIN) for part in error.args)
            raise


def _keep(path: Path, most_bytes: int) -> None:
    """Copy stdin to a file."""
    if sys.stdin is None or sys.stdin.closed:
        raise InputError(f"- is the log on stdin, and stdin is closed: pipe a log in ({_EXAMPLE}), or name a file.")
    if sys.stdin.isatty():
        raise InputError(f"- is the log on stdin, and stdin is a terminal: pipe a log in ({_EXAMPLE}), or name a file.")
    size = 0
    try:
        with path.open("xb") as file:
            while piece := sys.stdin.buffer.read(_PIECE_BYTES):
                size += len(piece)
                if size > most_bytes:
                    raise InputError(
                        f"stdin has more than {most_bytes / 1e9:g} GB: take it as it is with --max-size GB, or save it "
                        "to a file, and name that."
                    )
                file.write(piece)
    except OSError as error:
        raise InputError(
            f"stdin cannot be kept in {path.parent.parent}: {error.strerror or error}. Save it to a file elsewhere, "
            "and name that."
        ) from None
    if not size:
        raise InputError("stdin is empty (0 bytes): the command before the pipe wrote nothing. See its messages.")


@contextlib.contextmanager
def handled(handlers: Mapping[int, Handler]) -> Iterator[None]:
    """Signals handled so meanwhile: number → handler."""
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _endings() -> dict[int, Handler]:
    """SIGTERM and SIGHUP end the command as an error does: what is on the way out is done. One ignored stays so."""
    if threading.current_thread() is not threading.main_thread():  # which alone gets signals
        return {}
    return {number: _end for number in _ENDING if signal.getsignal(number) is signal.SIG_DFL}


def _end(number: int, _frame: FrameType | None) -> NoReturn:
    raise SystemExit(128 + number)


_SETTABLE = {
    "log": ("dialect", "max_size_gb"),
    "integration": ("method", "middle"),
    "drift": ("horizons_s",),
    "view": ("host", "port", "token", "reanchor_s", "map_url"),
}
"""Section → those of its keys that are options too."""


_PAGE_BYTES = 256
_LARGE_BYTES = 20_000_000
_MOST_NAMES = 10  # of files that were passed over


def output(arguments: argparse.Namespace, endings: Sequence[str] = (), more: str = "") -> Path | None:
    """The file that was named to write to. Raises InputError where it cannot be written, or ends in none of these."""
    if not arguments.output:
        return None
    path = Path(arguments.output)
    files.check(path, force=arguments.force)
    if endings and path.suffix not in endings:
        raise InputError(f"cannot write {path}: the name has to end in {' or '.join(endings)}.{more}")
    return path


def chosen(arguments: argparse.Namespace) -> dict[str, Any]:
    """The choice of `JUDGEMENT`, as `companion.app.examination` takes it."""
    return {name: getattr(arguments, name) for name in ("imu", "imu_model", "correction")}


def settings_of(arguments: argparse.Namespace) -> Settings:
    """The settings file with the command line's options put over it. Raises SettingsError for one out of range."""
    given = {name: value for name, value in vars(arguments).items() if value is not None}
    merged = msgspec.to_builtins(load_settings(arguments.config))
    for section, names in _SETTABLE.items():
        merged[section] |= {name: given[name] for name in names if name in given}
    try:
        settings = msgspec.convert(merged, Settings)
    except msgspec.ValidationError as error:
        reason, _, where = str(error).partition(" - at `$.")
        name = where.rstrip("`").partition(".")[2].partition("[")[0]
        option = name.removesuffix("_s").removesuffix("_gb").replace("_", "-")
        raise SettingsError(f"--{option}: {reason[:1].lower()}{reason[1:]}.") from None
    method = settings.integration.method
    if "middle" in given and not METHODS[method].looks_inside:
        others = " and ".join(name for name, one in METHODS.items() if one.looks_inside)
        raise SettingsError(f"--middle is {others}'s, and {method} has no sample in mid-step: leave one of them out.")
    return settings


def log_path(arguments: argparse.Namespace) -> Path:
    """The log that was named."""
    return _path(arguments.log, arguments.piped)


def logs_named(arguments: argparse.Namespace, settings: Settings) -> dict[str, str]:
    """Path → short name of each log that was named, matches a pattern or is in a folder that was named.

    And of each folder that cannot be searched: it is a log that cannot be read.
    """
    from companion.fleet import find_logs, short_names  # noqa: PLC0415  (not needed for one log)

    named = [str(_path(name, arguments.piped)) for name in arguments.logs]
    search = find_logs(named, dialect=settings.log.dialect)
    say_passed_over(search.no_logs)
    paths = [*(log.path for log in search.logs), *search.closed]  # what reads those says why it cannot
    names = short_names(paths)
    return {path: names[path] for path in paths}


def say_passed_over(no_logs: Sequence[str]) -> None:
    """Files that are named like logs, and are none by their content."""
    if no_logs:
        more = f" and {len(no_logs) - _MOST_NAMES} more" if len(no_logs) > _MOST_NAMES else ""
        say(f"passed over, for their content is no log: {', '.join(no_logs[:_MOST_NAMES])}{more}")


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
    """1 where --fail-on applies to a verdict: somebody is suspect, or ("insufficient") one is not consistent."""
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
    _warn_of_damage(recording.source)
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


def _warn_of_damage(source: Source) -> None:
    """Print on stderr what of the log could not be read."""
    if source.trouble:
        say(f"{source.path}: {source.trouble}")
    tail = _PAGE_BYTES if source.format == "dataflash" else 0  # the logger fills up its last page
    if source.bad_crc_frames or source.skipped_bytes > tail:
        say(
            f"damaged log: {source.skipped_bytes:,} of {source.content_bytes:,} bytes skipped, "
            f"{counted(source.bad_crc_frames, 'frame')} with a wrong checksum left out; "
            f"{counted(source.frames, 'good frame')} read"
        )


def write_no_more(stream: TextIO) -> None:
    """Who reads a stream has gone: what is left in its buffer must not fail again at the end."""
    with contextlib.suppress(OSError, ValueError, AttributeError), Path(os.devnull).open("wb") as nothing:
        os.dup2(nothing.fileno(), stream.fileno())


def say(text: str) -> None:
    """A line for the person at the terminal: stderr, so that results on stdout stay clean."""
    print(text, file=sys.stderr)


def _matches(flight: Flight, arguments: argparse.Namespace) -> bool:
    requested = str(arguments.vehicle) if arguments.vehicle is not None else None
    vehicle = requested is None or requested in {str(flight.vehicle), str(flight.vehicle.sysid)}
    return vehicle and arguments.boot in {None, flight.boot}


Parser = argparse.ArgumentParser


def add(parser: Parser, *names: str) -> None:
    """Options of SHARED, in the order in which the help lists them."""
    for name in names:
        parser.add_argument(name, **SHARED[name])


def add_log(parser: Parser, *names: str, takes_link: bool = False, takes_several: bool = False) -> None:
    """A log, with the options that every command has that takes one, and then those that are named.

    takes_link: or a link. takes_several: `arguments.logs` are the logs, folders and patterns.
    """
    log = "a log: .tlog, ArduPilot .bin or .log, PX4 .ulg; demo for the bundled flight; - for stdin"
    link = "; or a link: udpin:HOST:PORT, tcp:HOST:PORT, /dev/ttyACM0[:BAUD]" if takes_link else ""
    if takes_several:
        parser.add_argument("logs", metavar="LOG", nargs="+", help=log)
    else:
        parser.add_argument("log", metavar="LOG|LINK" if takes_link else "LOG", help=log + link)
    parser.set_defaults(piped=None)
    add(parser, *SETTINGS, *names)


def add_output(parser: Parser, metavar: str, help: str, force: str = "replace what is there already") -> None:
    """Where to write."""
    parser.add_argument("-o", "--output", metavar=metavar, help=help)
    parser.add_argument("--force", action="store_true", help=force)


def add_fail_on(parser: Parser, help: str, default: str | None = None) -> None:
    """Which verdict is a failure: see `exit_code`."""
    parser.add_argument("--fail-on", choices=("suspect", "insufficient"), default=default, help=help)


def share(text: str) -> float:
    """A percentage as a share: 0.1 for 10%."""
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*%?\s*", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"must be a percentage like 10%, got {text!r}")
    return float(match[1]) / 100


def whole(least: int, most: int, what: str) -> Callable[[str], int]:
    """The type of an option that is a whole number. what: it must be, in words."""

    def parsed(text: str) -> int:
        if not text.isdigit() or not least <= int(text) <= most:
            raise argparse.ArgumentTypeError(f"must be {what}, got {text!r}")
        return int(text)

    return parsed


def _horizons(text: str) -> tuple[float, ...]:
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if not values or not all(0 < value < math.inf for value in values):
        raise argparse.ArgumentTypeError(f"must be positive seconds like 1,5,10, got {text!r}")
    return values


SHARED: Mapping[str, Mapping[str, Any]] = {
    "--json": {"action": "store_true", "help": "the same as JSON on stdout (docs/json.md)"},
    "--config": {"metavar": "FILE", "help": "settings file; config/default.toml describes every key"},
    "--dialect": {"metavar": "NAME", "help": "MAVLink dialect (default: ardupilotmega)"},
    "--max-size": {
        "dest": "max_size_gb",
        "type": float,
        "metavar": "GB",
        "help": "the most that a compressed log may grow to, and that stdin may have (default: 0.8)",
    },
    "--vehicle": {"metavar": "SYSID[:COMPID]", "help": "the vehicle (default: the one with the most IMU data)"},
    "--boot": {"type": int, "metavar": "N", "help": "the vehicle's N-th boot in the log, from 1"},
    "--core": {
        "type": int,
        "metavar": "N",
        "help": "the EKF core of a .bin to compare with, from 0 (default: the one that flew)",
    },
    "--imu": {
        "metavar": "NAME",
        "help": f"message to integrate: {', '.join(IMU_MESSAGES)}, or a track of an on-board log "
        "(default: depends on the autopilot, and is stated)",
    },
    "--method": {"choices": METHODS, "help": "integrator (default: rk4)"},
    "--middle": {"choices": MIDDLES, "help": "the signal between two samples (default: cubic)"},
    "--imu-model": {
        "metavar": "NAME",
        "help": "part of config/imu, or a .toml file like those (default: what the parameters name, else generic-mems)",
    },
    "--correction": {"metavar": "FILE", "help": "take the errors out that companion calibrate found"},
    "--horizons": {
        "dest": "horizons_s",
        "type": _horizons,
        "metavar": "S,S,...",
        "help": "seconds (default: 1,2,5,10,30)",
    },
    "--reanchor": {
        "dest": "reanchor_s",
        "type": float,
        "metavar": "S",
        "help": "restart from the autopilot's state every S seconds; 0: never (default: 10)",
    },
    "--anchor": {
        "choices": ("autopilot", "rest"),
        "default": "autopilot",
        "help": "rest: align the IMU by itself where the vehicle first stands still, and dead-reckon from there on "
        "(default: autopilot)",
    },
}
"""Option → how argparse takes it."""

SOURCE = ("--config", "--dialect")
"""Where settings come from, and the one that is needed to read messages."""
SETTINGS = (*SOURCE, "--max-size")
"""The same, and the one that is needed to read a log."""
FLIGHT = ("--vehicle", "--boot", "--core")
"""Which of the log's flights, and which of the estimates in an on-board log."""
INTEGRATION = ("--imu", "--method", "--middle")
JUDGEMENT = (*FLIGHT, *INTEGRATION, "--imu-model", "--correction", "--horizons")
"""An examination: flight, IMU, noise model, windows."""
