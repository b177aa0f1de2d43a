"""`companion completion SHELL`: what a shell needs to complete commands, options and files."""

from __future__ import annotations

import argparse

from companion.cli import parsers

SHELLS = ("bash", "zsh", "tcsh")
_EXAMPLE = "companion completion bash > ~/.local/share/bash-completion/completions/companion"


def add_parser(commands: parsers.Commands) -> None:
    """Register the command."""
    summary = "Print a script with which the shell completes commands, options and files."
    brief = "Completion for bash, zsh or tcsh"
    parser = parsers.add_command(commands, run, "completion", brief, summary, _EXAMPLE)
    parser.add_argument("shell", choices=SHELLS, help="the shell to print it for")


def run(arguments: argparse.Namespace) -> int:
    """Print the script."""
    import shtab  # noqa: PLC0415  (needed for this command alone)

    from companion.cli.main import parser  # noqa: PLC0415  (which imports this module)

    top = parser()
    for command in _parsers(top):
        for action in command._actions:
            if action.metavar in _FILES:
                action.complete = shtab.FILE  # type: ignore[attr-defined]
            elif action.metavar in _FOLDERS:
                action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
    print(shtab.complete(top, shell=arguments.shell))
    return 0


_FILES = ("LOG", "LOG|LINK", "FILE", "PATH", "A", "B")
_FOLDERS = ("DIR",)


def _parsers(top: argparse.ArgumentParser) -> list[argparse.ArgumentParser]:
    """Those of the commands."""
    return [
        parser
        for action in top._actions
        if isinstance(action, argparse._SubParsersAction)
        for parser in action.choices.values()
    ]
