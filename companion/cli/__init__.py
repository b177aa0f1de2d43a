"""The command line: the only place that prints and exits."""

from companion.cli.main import main
