"""`companion COMMAND ...`: the commands; parses, runs, and turns errors into one sentence and an exit code.

What nobody foresaw becomes one sentence too, with a report to send in.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import io
import platform
import sys
import tempfile
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import NoReturn

from companion.cli import options
from companion.installation import own_version
from companion.model import CompanionError, SettingsError, nearest_word

_OF_OUTPUT = {errno.ENOSPC, errno.EIO, errno.EFBIG, errno.EBADF, errno.EINVAL, getattr(errno, "EDQUOT", errno.ENOSPC)}
"""Failures to write to stdout. Errors of files have a name; those of a network other numbers, or none."""
_OF_NAMES = {errno.EACCES, errno.EPERM, errno.ENAMETOOLONG, errno.ELOOP, errno.EROFS}
"""What is wrong with a path that was named, not with us: no right to look there, or a name that no file can have."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command. Returns the exit code: 0, 2 (the user can mend it), 70 (a fault of ours), 130 (Ctrl-C)."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a redirect on Windows is cp1252, which has no line of the tables
    try:
        code = _run(list(sys.argv[1:] if argv is None else argv))
        if sys.stdout is not None:  # closed by the caller (>&-)
            sys.stdout.flush()
    except CompanionError as error:
        print(f"companion: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # the reader of our output has gone (| head)
        options.write_no_more(sys.stdout)
        return 141
    except Exception as error:  # noqa: BLE001  (the border of the program)
        if isinstance(error, OSError) and (sentence := _mendable(error)):
            print(f"companion: {sentence}", file=sys.stderr)
            if error.filename is None:
                options.write_no_more(sys.stdout)
            return 2
        return report_unexpected(error, sys.argv[1:] if argv is None else argv)
    return code


def _mendable(error: OSError) -> str:
    """The sentence for an error that the user can mend; "" for any other."""
    if error.filename is None:
        return f"the output cannot be written: {error.strerror}" if error.errno in _OF_OUTPUT else ""
    return f"{error.filename}: {error.strerror}. Name another path." if error.errno in _OF_NAMES else ""


def _run(given: list[str]) -> int:
    if given[:1] == ["help"] and not given[2:]:
        given = [*given[1:], "--help"] if given[1:] else []
    if not given:
        print(overview())
        return 0
    _check_command(given[0])
    arguments, unknown = parser(given[0]).parse_known_args(given)
    if unknown:
        raise SettingsError(_no_such(unknown[0], arguments.command))
    with options.kept(arguments):
        code: int = arguments.run(arguments)
    return code


def _check_command(given: str) -> None:
    """Raises SettingsError for a word that is no command: what was probably meant."""
    if given.startswith("-") or given in COMMANDS:
        return
    if near := nearest_word(given, COMMANDS):
        raise SettingsError(f"There is no command {given}. Did you mean companion {near}?")
    from companion.links import is_link, meant_link  # noqa: PLC0415  (not needed for a command that there is)

    if link := given if is_link(given) else meant_link(given):
        raise SettingsError(f"There is no command {given}. Did you mean companion view {link}?")
    log = (
        f"Did you mean companion analyze {given}?" if given and Path(given).exists() else "All commands: companion help"
    )
    raise SettingsError(f"There is no command {given}. {log}")


def _no_such(given: str, command: str) -> str:
    """The message for an argument that a command does not have."""
    actions = commands_of(parser(command))[command]._actions
    options = [option.strip("-") for action in actions for option in action.option_strings]
    near = nearest_word(given.partition("=")[0].strip("-"), options) if given.startswith("--") else ""
    hint = f"Did you mean --{near}?" if near else f"See companion help {command}"
    return f"companion {command} does not take {given}. {hint}"


def commands_of(top: argparse.ArgumentParser) -> Mapping[str, argparse.ArgumentParser]:
    """Name → the parser of a command."""
    return next(action.choices for action in top._actions if isinstance(action, argparse._SubParsersAction))


def overview() -> str:
    """Every command with one line, for who does not know them yet: it fits a terminal of 24 lines and 80 columns."""
    lines = [f"  {name:<11}{command.brief}" for name, command in COMMANDS.items() if not command.is_helper]
    helpers = ", ".join(name for name, command in COMMANDS.items() if command.is_helper)
    return "\n".join(
        ["Does this IMU agree with this autopilot, and if not, which of them is wrong?", "", *lines]
        + [f"  and        {helpers}", ""]
        + ["Try:   companion analyze demo    (demo: the bundled flight; else a log's path)"]
        + ["More:  companion help COMMAND"]
    )


class _Parser(argparse.ArgumentParser):
    """Its errors are a sentence, not a screen of options."""

    def error(self, message: str) -> NoReturn:
        command = self.prog.removeprefix("companion").strip()
        self.exit(2, f"{self.prog}: {message}. See companion help{f' {command}' * bool(command)}\n")


class _Version(argparse.Action):
    """Looks the version up when needed, which takes a moment."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(f"companion {own_version()}")
        parser.exit()


def parser(command: str = "") -> argparse.ArgumentParser:
    """The parser with the options of a command, or of every command where the name is of none.

    A command's module is loaded when it is needed: all of them take as long to load as a short flight to analyse.
    """
    top = _Parser(
        prog="companion",
        description="Does this IMU agree with this autopilot, and if not, which of them is wrong?",
        epilog="Try: companion analyze demo. Options of a command: companion help COMMAND",
    )
    top.add_argument("--version", action=_Version, nargs=0, help="show program's version number and exit")
    commands = top.add_subparsers(title="commands", metavar="COMMAND", dest="command", required=True)
    names = (command,) if command in COMMANDS else () if command == "--version" else COMMANDS
    for name in names:
        about, own = COMMANDS[name], name.replace("-", "_")
        module = import_module(f"companion.cli.{about.module or own}")
        added = commands.add_parser(
            name, help=about.brief, description=about.summary, epilog=f"example: {about.example}"
        )
        added.set_defaults(run=getattr(module, f"run_{own}"))
        getattr(module, f"{own}_options")(added)
    return top


@dataclass(frozen=True, slots=True)
class Command:
    """A command: its options and its run in a module of this package, loaded when it is needed."""

    brief: str
    summary: str
    example: str
    is_helper: bool = False  # one that serves other programs: the list has its name alone
    module: str = ""  # where it is; "": in one of its own name


COMMANDS = {
    "info": Command(
        "What a log has: vehicles, sensors, messages, rates, gaps",
        "What is in a log: vehicles, boots, sensors, messages, rates, gaps.",
        "companion info flight.tlog",
    ),
    "analyze": Command(
        "The verdict: do IMU and autopilot agree, or which is wrong?",
        "Do IMU and autopilot agree? How far the IMU drifts by itself, how far it should, and who is wrong.",
        "companion analyze flight.tlog --imu RAW_IMU --horizons 1,5,10",
    ),
    "report": Command(
        "One HTML file with verdict, charts and 3D replay",
        "One HTML file with the verdict, the charts and the 3D playback of a flight: to mail, to print, to keep.",
        "companion report flight.tlog -o report.html",
        module="outputs",
    ),
    "calibrate": Command(
        "The IMU errors that best explain a flight, each with its σ",
        "The IMU's biases, scale, axes, mounting, lever arm and lag that best explain a flight, with their errors.",
        "companion calibrate flight.tlog -o imu.toml",
        module="outputs",
    ),
    "smooth": Command(
        "Best estimate of the trajectory from all sensors, without the EKF",
        "Where it really was: the best estimate of the trajectory from all sensors, independent of the EKF.",
        "companion smooth flight.tlog -o best.tum",
    ),
    "lanes": Command(
        "Which EKF lane should have been flown, and was each switch right?",
        "Every lane of the estimator against the best estimate: which should have been flown, each switch judged.",
        "companion lanes flight.bin",
        module="smooth",
    ),
    "incident": Command(
        "The last seconds before it went wrong, with the probable causes",
        "The seconds around a crash, loss of control, failsafe, fault or lane switch, as a page to post.",
        "companion incident flight.bin -o incident.html",
        module="outputs",
    ),
    "preflight": Command(
        "Before take-off: is each sensor fit to fly? Go or no-go by line",
        "A vehicle that stands for 20 to 60 s, in a log or on a link: each sensor against its limit, go or no-go.",
        "companion preflight flight.bin, companion preflight udpin:0.0.0.0:14550",
    ),
    "noise": Command(
        "IMU noise: Allan deviation at rest, spectra in flight",
        "How noisy the IMUs are: Allan deviation at rest, spectra and vibration in flight.",
        "companion noise flight.tlog -o imu.yaml",
    ),
    "compare": Command(
        "Two flights side by side: which drifts more?",
        "Two flights, or one before and after a change, side by side: which drifts more, and is that significant?",
        "companion compare flight.tlog --correction-b imu.toml",
    ),
    "view": Command(
        "A flight in the browser, in 3D: a log, or a live link",
        "See the flight twice in the browser: as the autopilot had it and as the IMU alone would have it. "
        "A log is replayed; a link is shown live, and recorded.",
        "companion view flight.tlog --open, companion view udpin:0.0.0.0:14550",
    ),
    "export": Command(
        "A flight for evo, Foxglove, maps, spreadsheets, notebooks",
        "A flight for other tools: evo, Foxglove, spreadsheets, notebooks.",
        "companion export flight.tlog --format mcap -o flight.mcap",
        module="outputs",
    ),
    "series": Command(
        "Values of a flight over time, as CSV or JSON",
        "Values of a flight over time, as CSV or JSON, evenly thinned out; without a table which ones there are.",
        "companion series flight.tlog attitude --from 70 --to 80 --json",
        is_helper=True,
        module="outputs",
    ),
    "fleet": Command(
        "Every flight of many logs: tables and one page",
        "Every flight of many logs, on all processors or a Dask cluster: tables in Parquet, and a page.",
        "companion fleet logs/ -o results",
    ),
    "check": Command(
        "Pass or fail for CI: JUnit XML, exit code, a baseline",
        "Every flight of some logs as a test that passes or fails, for continuous integration: exit code, JUnit XML, "
        "and whether drift or detectable faults are worse than a baseline's.",
        "companion check logs/ --junit companion.xml --baseline hover.json",
    ),
    "record": Command(
        "Record a link into a .tlog, at the rates that are needed",
        "Attach to a vehicle or simulator, ask for its IMU, and record a telemetry log until Ctrl-C.",
        "companion record udpin:0.0.0.0:14550 -o flight.tlog",
        module="live",
    ),
    "watch": Command(
        "Judge a vehicle while it flies: one JSON line a second",
        "Judge a vehicle while it flies, without a page: one JSON line a second on stdout, and a recording.",
        "companion watch /dev/ttyACM0 --fail-on suspect | jq .status",
    ),
    "watch-folder": Command(
        "The verdict on each log that comes into a folder",
        "The verdict on each log that comes into a folder, of a ground station or a card, as soon as it is whole.",
        "companion watch-folder ~/Documents/QGroundControl",
        is_helper=True,
        module="watch",
    ),
    "simulate": Command(
        "A simulated vehicle, on a link or into a .tlog",
        "Fly a simulated vehicle whose truth is known, on a link or into a telemetry log.",
        "companion simulate udpout:127.0.0.1:14550 --duration 120",
        is_helper=True,
        module="senders",
    ),
    "replay": Command(
        "Send a recorded log to a link, for testing clients",
        "Send a telemetry log's packets to a link at their own pace: for testing clients, never for a vehicle.",
        "companion replay flight.tlog udpout:127.0.0.1:14550",
        is_helper=True,
        module="senders",
    ),
    "mcp": Command(
        "Let an assistant ask about the logs in a folder (MCP)",
        "An MCP server on stdin and stdout: assistants ask about the logs in a folder, and get the documented JSON.",
        "companion mcp ~/logs",
        is_helper=True,
    ),
    "doctor": Command(
        "What this installation lacks, and how to install it",
        "What this installation has and lacks: libraries, extras, demo flight, serial ports, folders, terminal.",
        "companion doctor",
        is_helper=True,
    ),
    "completion": Command(
        "Completion for bash, zsh or tcsh",
        "Print a script with which the shell completes commands, options and files.",
        "companion completion bash > ~/.local/share/bash-completion/completions/companion",
        is_helper=True,
        module="doctor",
    ),
}
"""Name → command, in the order in which they are listed."""


_EXIT_CODE = 70  # EX_SOFTWARE of sysexits.h


def report_unexpected(error: BaseException, arguments: Sequence[str]) -> int:
    """Write the report and print its path. Returns the exit code."""
    what = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    if isinstance(error, MemoryError):
        what = f"there is not enough memory ({what})"
    try:
        path = _write_report(error, arguments)
    except Exception:  # noqa: BLE001  (there is nobody behind this border)
        path = None
    where = f"Send in {path} and, if you may, the log" if path else "The report of it cannot be written"
    with contextlib.suppress(OSError, ValueError, AttributeError):  # stderr is closed
        print(f"companion: internal error (a bug in companion): {what}. {where}.", file=sys.stderr, flush=True)
    return _EXIT_CODE


def _write_report(error: BaseException, arguments: Sequence[str]) -> Path | None:
    """The report, in a new file of the folder for temporary ones that only its owner can read."""
    trace = "".join(traceback.format_exception(error))
    about = f"companion {own_version()}, Python {platform.python_version()}, {platform.platform()}"
    text = f"{about}\ncommand: {' '.join(map(repr, arguments))}\n\n{trace}"
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="companion-report-", suffix=".txt", delete=False, encoding="utf-8", errors="replace"
        ) as file:
            file.write(text)
    except OSError:
        return None
    return Path(file.name)
