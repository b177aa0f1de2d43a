"""`companion completion SHELL`: what a shell needs to complete commands, options and files."""

from __future__ import annotations

import argparse

from companion.cli import parsers

SHELLS = ("bash", "zsh", "tcsh")
_FILES = ("LOG", "LOG|LINK", "FILE", "PATH", "A", "B")
_FOLDERS = ("DIR",)


def add_options(parser: parsers.Parser) -> None:
    """The command's options."""
    parser.add_argument("shell", choices=SHELLS, help="the shell to print it for")


def run(arguments: argparse.Namespace) -> int:
    """Print the script."""
    import shtab  # noqa: PLC0415  (needed for this command alone)

    from companion.cli.main import commands_of, parser  # noqa: PLC0415  (which imports this module)

    top = parser()
    for command in commands_of(top).values():
        for action in command._actions:
            if action.metavar in _FILES:
                action.complete = shtab.FILE  # type: ignore[attr-defined]
            elif action.metavar in _FOLDERS:
                action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
    print(shtab.complete(top, shell=arguments.shell))
    return 0
