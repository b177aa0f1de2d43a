"""`companion replay LOG LINK`: a recorded telemetry log on a link again, for those who test clients."""

from __future__ import annotations

import argparse
import contextlib
import time
from collections.abc import Callable
from pathlib import Path

from companion.cli import live, options, parsers
from companion.links import Address, Port, open_port, parse_address, play
from companion.logs import log_format
from companion.mavlink import load_dialect
from companion.model import DataError, InputError, SettingsError

_WAITING = ("udpin", "tcpin", "tcp")  # links on which the peer has to send or listen first


def add_options(parser: parsers.Parser) -> None:
    """The command's options."""
    parsers.add_log(parser)
    parser.add_argument(
        "link", metavar="LINK", help="udpout:HOST:PORT, udpin:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT"
    )
    parser.add_argument("--speed", type=float, default=1.0, metavar="X", help="times the pace of the log (default: 1)")
    parser.add_argument(
        "--everybody",
        action="store_true",
        help="send the frames of ground stations, companion computers and others too, with their commands: for closed "
        "networks only",
    )


def run(arguments: argparse.Namespace) -> int:
    """Play the log to its end, or until Ctrl-C."""
    if not 0 < arguments.speed <= 1000:
        raise SettingsError(f"--speed lies above 0 and up to 1000, got {arguments.speed:g}.")
    address = parse_address(arguments.link)
    if address.kind == "serial":
        raise SettingsError(
            f"replay does not send to a serial port: there may be a vehicle on {address.device}. Use a UDP or TCP link."
        )
    settings = options.settings_of(arguments)
    path = options.log_path(arguments)
    if log_format(path) != "mavlink":
        raise InputError(f"{path} is not a telemetry log: only a .tlog holds packets that can be sent again.")
    senders = None if arguments.everybody else _vehicles(arguments, path)
    with contextlib.closing(open_port(address)) as port, live.until_signal() as ended:
        _wait(port, address, ended)
        options.say(f"Replaying {path} on {address} at {arguments.speed:g} times its pace  (Ctrl-C ends it)")
        dialect = load_dialect(settings.log.dialect)
        played = play(path, port, dialect, senders=senders, speed=arguments.speed, stop=ended)
    names = ", ".join(f"{name} {count:,}" for name, count in played.sent.most_common())
    print(f"sent {played.sent.total():,} frames, {played.bytes:,} bytes: {names}")
    if played.unheard:
        options.say(f"{played.unheard:,} frames more were due while nobody was there to hear them")
    if played.left_out:
        others = ", ".join(f"{who} ({count:,})" for who, count in played.left_out.most_common())
        options.say(f"left out, for they are not the autopilot's (--everybody sends them too): frames of {others}")
    return 0


def _vehicles(arguments: argparse.Namespace, path: Path) -> set[tuple[int, int]]:
    """The autopilots in the log. Not their companion computers: those send commands to an autopilot."""
    vehicles = [flight.vehicle for flight in options.read(arguments, options.settings_of(arguments)).flights]
    autopilots = {(vehicle.sysid, vehicle.compid) for vehicle in vehicles}
    if not autopilots:
        raise DataError(f"no vehicle found in {path}. To send the messages of others: --everybody.")
    return autopilots


def _wait(port: Port, address: Address, ended: Callable[[], bool]) -> None:
    """Until there is somebody to send to, where a link needs that."""
    if address.kind not in _WAITING:
        return
    if port.problem:
        options.say(f"{address}: {port.problem}; waiting")
    while port.problem and not ended():
        port.wait(0.05)
        port.read()
        time.sleep(0.01)
