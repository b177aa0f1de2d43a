"""`companion COMMAND ...`: parses, runs, and turns errors into one sentence and an exit code."""

from __future__ import annotations

import argparse
import errno
import io
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import NoReturn

from companion.cli import options, unexpected_error
from companion.cli.commands import COMMANDS
from companion.model import CompanionError, SettingsError, nearest_word

_OF_OUTPUT = {errno.ENOSPC, errno.EIO, errno.EFBIG, errno.EBADF, errno.EINVAL, getattr(errno, "EDQUOT", errno.ENOSPC)}
"""Failures to write to stdout. Errors of files have a name; those of a network other numbers, or none."""


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
        if isinstance(error, OSError) and error.filename is None and error.errno in _OF_OUTPUT:
            print(f"companion: the output cannot be written: {error.strerror}", file=sys.stderr)
            options.write_no_more(sys.stdout)
            return 2
        return unexpected_error.report(error, sys.argv[1:] if argv is None else argv)
    return code


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
        print(f"companion {unexpected_error.own_version()}")
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
    for name in (command,) if command in COMMANDS else COMMANDS:
        module, about = import_module(f"companion.cli.{name.replace('-', '_')}"), COMMANDS[name]
        added = commands.add_parser(
            name, help=about.brief, description=about.summary, epilog=f"example: {about.example}"
        )
        added.set_defaults(run=module.run)
        module.add_options(added)
    return top
