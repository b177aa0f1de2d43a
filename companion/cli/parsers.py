"""The options that several commands share, as argparse has them."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable, Mapping
from typing import Any

from companion.model import IMU_MESSAGES
from companion.strapdown import METHODS, MIDDLES

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
    """Which verdict is a failure: see `options.exit_code`."""
    parser.add_argument("--fail-on", choices=("suspect", "insufficient"), default=default, help=help)


def add_carrier(parser: Parser) -> None:
    """The IMU of a best estimate."""
    parser.add_argument("--imu", metavar="NAME", help="IMU message that carries the estimate (default: the best)")


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
    "--horizons": {"type": _horizons, "metavar": "S,S,...", "help": "seconds (default: 1,2,5,10,30)"},
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
