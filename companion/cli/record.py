"""`companion record LINK`: attach to a vehicle, ask for its IMU and record everything that it sends."""

from __future__ import annotations

import argparse
import time

from companion.cli import live, options, parsers
from companion.links import Recorder, Session
from companion.model import SettingsError


def add_options(parser: parsers.Parser) -> None:
    """The command's options."""
    live.add_link(parser)
    parser.add_argument("--duration", type=float, metavar="S", help="end after so many seconds")


def run(arguments: argparse.Namespace) -> int:
    """Record until Ctrl-C, SIGTERM, the duration or a full disk; then give the vehicle its message intervals back."""
    settings = options.settings_of(arguments)
    if arguments.duration is not None and not arguments.duration > 0:
        raise SettingsError(f"--duration is a positive number of seconds, got {arguments.duration:g}.")
    choice, patience = live.choice_of(arguments, settings), live.patience_of(arguments)
    with (
        live.until_signal() as ended,
        live.open_link(arguments.link, arguments, settings, patience, ended) as link,
        Recorder(arguments.output) as recorder,
    ):
        session = Session(link, choice=choice, recorder=recorder, remember=True)
        status = live.StatusLine(session)
        live.say(f"Recording {link.address} into {recorder.path}  (Ctrl-C ends it)")
        end = time.monotonic() + arguments.duration if arguments.duration is not None else None
        while not ended() and not recorder.problem and (end is None or time.monotonic() < end):
            if patience.over(link.health.frames):
                break
            session.step()
            session.beside(status.show)
        restored = session.leave()
        session.beside(status.end)
    return live.conclude(link, recorder, restored=restored)
