"""What every command with a live link shares: options, end by a signal, status line; and `companion record LINK`."""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import re
import select
import signal
import stat
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TextIO

from companion.app.settings import Settings
from companion.cli import options
from companion.links import Address, Choice, Link, NotThereError, Recorder, Session, parse_address
from companion.mavlink import load_key
from companion.model import SettingsError, counted

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_HANGUP = getattr(signal, "SIGHUP", None)  # the terminal was closed; Windows has none
_PX4_PORTS = {"QGroundControl": range(18570, 18580), "MAVSDK or ROS": range(14580, 14590)}
"""Who PX4's simulator speaks to from which of its own ports, one for each instance (ROMFS px4-rc.mavlink)."""
_GRACE_S = 5.0  # before a packet is sent that takes a link away
_AGAIN_S, _LOOK_S = 2.0, 0.05  # between attempts to open a link, and between looks whether to end
_TERMINAL_S, _LOG_S = 0.5, 10.0  # between status lines: rewritten on a terminal, added elsewhere


def add_link(parser: argparse.ArgumentParser) -> None:
    """The link, and what may be requested of the vehicle."""
    parser.add_argument(
        "link",
        metavar="LINK",
        help="udpin:HOST:PORT (wait for packets), udpout:, tcp:, tcpin:HOST:PORT, or a device: /dev/ttyACM0[:BAUD]",
    )
    options.add(parser, *options.SOURCE)
    parser.add_argument(
        "--vehicle", metavar="SYSID[:COMPID]", help="the vehicle to ask, or all (default: the first with an IMU)"
    )
    add_request_options(parser)
    add_recording(parser)
    parser.add_argument("--duration", type=float, metavar="S", help="end after so many seconds")


def add_recording(parser: argparse.ArgumentParser | argparse._ArgumentGroup) -> None:
    """Where to record into."""
    output = "a new .tlog to record into (default: YYYY-MM-DD hh-mm-ss.tlog in this folder)"
    parser.add_argument("-o", "--output", metavar="FILE", help=output)


def add_request_options(parser: argparse.ArgumentParser | argparse._ArgumentGroup) -> None:
    """What may be requested of the vehicle."""
    parser.add_argument("--rate", type=float, metavar="HZ", help="how often to ask for the IMU (default: 100)")
    parser.add_argument(
        "--signing-key-file",
        metavar="FILE",
        help="sign what is sent, and drop what is not signed, with the key in this file: 64 hex digits or a passphrase",
    )
    parser.add_argument("--listen-only", action="store_true", help="send nothing at all, ever")
    parser.add_argument(
        "--wait",
        type=float,
        metavar="S",
        help="wait so many seconds for the link and a vehicle on it (inf: for ever), then end with exit code 2; "
        "without it a link that cannot be opened is an error at once, and a silent one is listened to until Ctrl-C",
    )


def refuse_link_options(arguments: argparse.Namespace, *more: str) -> None:
    """Raises SettingsError where a log is given what is for a link. more: further options of the command."""
    names = ("rate", "listen-only", "signing-key-file", "wait", "output", *more)
    if given := [f"--{name}" for name in names if getattr(arguments, name.replace("-", "_"))]:
        raise SettingsError(f"{' and '.join(given)} is for a link, and {arguments.log} is none.")


@contextlib.contextmanager
def session_on(
    address: str, arguments: argparse.Namespace, settings: Settings
) -> Iterator[tuple[Session, Callable[[], bool]]]:
    """A session on a link that is recorded (--no-record: not), and whether to end it, as a function.

    That is after Ctrl-C, SIGTERM or --duration, and where nothing was received in the time of --wait.
    Raises SettingsError for options out of range, InputError for a link or a recording that cannot be opened.
    """
    duration = getattr(arguments, "duration", None)
    if duration is not None and not duration > 0:
        raise SettingsError(f"--duration is a positive number of seconds, got {duration:g}.")
    choice, patience = choice_of(arguments, settings), math.inf if arguments.wait is None else arguments.wait
    if not patience > 0:
        raise SettingsError(f"--wait is a positive number of seconds, or inf, got {patience:g}.")
    until = time.monotonic() + patience
    with (
        until_signal() as ended,
        _open_link(address, arguments, settings, until, ended) as link,
        contextlib.nullcontext() if getattr(arguments, "no_record", False) else Recorder(arguments.output) as recorder,
    ):
        end = math.inf if duration is None else time.monotonic() + duration

        def over() -> bool:
            now = time.monotonic()
            return ended() or now >= end or (not link.health.frames and now > until)

        yield Session(link, choice=choice, recorder=recorder, remember=True), over


def _open_link(
    address: str, arguments: argparse.Namespace, settings: Settings, until: float, ended: Callable[[], bool]
) -> Link:
    """The link that was named; with --wait as soon as it can be opened. ended: whether the user has.

    Raises InputError when it cannot be opened until then, s of `time.monotonic()`.
    """
    if arguments.signing_key_file:
        _warn_of_readers(Path(arguments.signing_key_file))
    key = load_key(arguments.signing_key_file) if arguments.signing_key_file else None
    if not arguments.listen_only and (warning := takes_the_link(parse_address(address))):
        say(warning)
        _pause(_GRACE_S, ended)
        if ended():
            raise SettingsError(f"{address} has been left alone: nothing was sent.")
    reported = False
    while True:
        try:
            return Link(
                address,
                dialect=settings.log.dialect,
                listen_only=arguments.listen_only,
                sysid=settings.live.sysid,
                compid=settings.live.compid,
                signing_key=key,
            )
        except NotThereError as error:
            if arguments.wait is None or ended() or time.monotonic() > until:
                raise
            if not reported:
                reported = True
                say(f"Waiting: {error}")
        _pause(_AGAIN_S, ended)


def _pause(seconds: float, ended: Callable[[], bool]) -> None:
    """Wait, or until the user has ended it."""
    until = time.monotonic() + seconds
    while not ended() and time.monotonic() < until:
        time.sleep(_LOOK_S)


def takes_the_link(address: Address) -> str:
    """Why to think twice before speaking to an address first; "" where there is no reason."""
    program = next((name for name, ports in _PX4_PORTS.items() if address.port in ports), None)
    if address.kind != "udpout" or program is None:
        return ""
    return (
        f"{address} is a port of PX4 that has one partner, the last who spoke to it: {program} would lose the vehicle "
        f"until PX4 starts again. Listen to what PX4 sends to companions instead (udpin:0.0.0.0:14540), or let the "
        f"ground station forward it (see docs/live.md). Ctrl-C within {_GRACE_S:.0f} s leaves it alone."
    )


def _warn_of_readers(key: Path) -> None:
    with contextlib.suppress(OSError):  # what reads it says so
        if os.name == "posix" and key.stat().st_mode & (stat.S_IRGRP | stat.S_IROTH):
            say(f"{key} can be read by others: whoever has the key can command the vehicle. chmod 600 {key}")


def choice_of(arguments: argparse.Namespace, settings: Settings) -> Choice:
    """What the session asks for."""
    live = settings.live
    imu_hz = live.imu_hz if arguments.rate is None else arguments.rate
    if not 1 <= imu_hz <= 1000:
        raise SettingsError(f"--rate is between 1 and 1000 Hz, got {imu_hz:g}.")
    if arguments.vehicle is not None and not re.fullmatch(r"all|\d{1,3}(:\d{1,3})?", arguments.vehicle):
        raise SettingsError(f"--vehicle {arguments.vehicle} is none: say SYSID, SYSID:COMPID (e.g. 1:1) or all.")
    return Choice(arguments.vehicle, imu_hz, live.attitude_hz, live.position_hz)


@contextlib.contextmanager
def until_signal(*, outlive_terminal: bool = True) -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C or SIGTERM has come, as a function: the work in hand is finished first.

    Also in the background of a script, where the shell has had SIGINT ignored: who sends it to a server means it.
    outlive_terminal: a terminal that is closed (SIGHUP) ends nothing: the flight is not over.
    """
    ended: list[int] = []
    handlers: dict[int, options.Handler] = {number: lambda number, _: ended.append(number) for number in _SIGNALS}
    if outlive_terminal and _HANGUP is not None:
        handlers[_HANGUP] = signal.SIG_IGN
    with options.handled(handlers):
        yield lambda: bool(ended)


def say(text: str, end: str = "\n") -> None:
    """A line on stderr, if somebody takes it at once: who records does not wait for a terminal, nor needs one."""
    _write(sys.stderr, text + end)


def say_all(sentences: Iterable[str], before: str = "") -> None:
    """Each on a line of its own."""
    for sentence in sentences:
        say(before + sentence)


def print_line(text: str) -> None:
    """A line on stdout, likewise."""
    _write(sys.stdout, f"{text}\n")


_AT_ONCE: int = getattr(select, "PIPE_BUF", 512)  # bytes that a pipe takes whole; Windows has none that is asked
_LEFT: dict[int, bytes] = {}
"""File → the rest of a line, of which its reader has taken a part so far."""


def _write(stream: TextIO | None, text: str) -> None:
    """Write a line, or nothing of it where it would have to wait: a pipe that nobody reads fills up."""
    if stream is None:
        return
    try:
        if (number := _number(stream)) is None:
            stream.write(text)
            stream.flush()
        elif _takes(number):
            stream.flush()
            rest, line = _left(number, _LEFT.pop(number, b"")), text.encode(stream.encoding, stream.errors or "strict")
            if not rest and (after := _left(number, line)) != line:
                rest = after
            _LEFT[number] = rest
    except (OSError, ValueError):  # its reader has gone, the terminal is closed
        options.write_no_more(stream)


def _number(stream: TextIO) -> int | None:
    """Of the file behind it; None where there is none, or where none can be asked whether it takes anything."""
    try:
        return stream.fileno() if os.name == "posix" else None
    except (OSError, ValueError):
        return None


def _takes(number: int) -> bool:
    """Whether a file takes so many bytes at once; not a pipe that is full, nor a terminal after Ctrl-S."""
    return bool(select.select([], [number], [], 0)[1])


def _left(number: int, line: bytes) -> bytes:
    """Write what a file takes at once. Returns the rest."""
    while line and _takes(number):
        line = line[os.write(number, line[:_AT_ONCE]) :]
    return line


def conclude(session: Session, *, restored: bool) -> int:
    """Say what has been recorded. Returns the exit code: 2 where nothing was received, or not all was recorded.

    restored: whether the vehicle has confirmed that its message intervals are as before. Without that it is 2 as well.
    """
    health, recorder = session.link.health, session.recorder
    if recorder is not None and (health.unsigned or health.wrongly_signed):
        say(
            f"{counted(health.unsigned, 'frame')} without a signature and {health.wrongly_signed:,} with a wrong one "
            "were dropped: they are not in the recording"
        )
    if not health.frames:
        return nothing_received()
    if recorder is not None:
        print_line(f"{recorder.path}: {counted(recorder.size_bytes, 'byte')}, {counted(recorder.frames, 'frame')}")
    return 2 if (recorder is not None and recorder.problem) or not restored else 0


def nothing_received() -> int:
    """Say so. Returns the exit code."""
    say("nothing was received, so nothing is recorded: does the vehicle send to this address?")
    return 2


class StatusLine:
    """What a session does, on stderr: rewritten on a terminal, now and then elsewhere."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._begin = self._shown = time.monotonic()
        self._terminal = sys.stderr is not None and sys.stderr.isatty()

    def show(self) -> None:
        """Say what the session has to say, and the status when it is time."""
        clear = "\r\x1b[K" if self._terminal else ""
        say_all(self._session.reported, clear)
        self._session.reported.clear()
        now = time.monotonic()
        if now - self._shown >= (_TERMINAL_S if self._terminal else _LOG_S):
            self._shown = now
            say(clear + self.text(), end="" if self._terminal else "\n")

    def end(self) -> None:
        """Leave the line."""
        self.show()
        if self._terminal:
            say("")

    def text(self) -> str:
        """One line: time, what arrives of what was requested, loss, recording."""
        session, health = self._session, self._session.link.health
        parts = [f"{time.monotonic() - self._begin:.0f} s"]
        if problem := session.link.problem:
            parts.append(problem)
        if session.rates is not None:
            parts += [
                f"{w.name} {w.received_hz:.0f}/{w.desired_hz:.0f} Hz" for w in session.rates.stream_requests if w.count
            ]
        if health.unsigned or health.wrongly_signed:
            parts.append(f"{health.unsigned + health.wrongly_signed} not signed with our key")
        several = len(session.requested) > 1
        parts += [f"{f'{who} ' * several}lost {100.0 * share:.1f} %" for who, share in session.lost.items()]
        if (clock := session.report().clock) is not None:
            parts.append(f"latency {clock.latency_ms:.0f} ms")
        if session.recorder is not None:
            parts.append(f"{session.recorder.size_bytes / 1e6:.1f} MB")
        return " · ".join(parts)


record_options = add_link


def run_record(arguments: argparse.Namespace) -> int:
    """Record until Ctrl-C, SIGTERM, the duration or a full disk; then give the vehicle its message intervals back."""
    with session_on(arguments.link, arguments, options.settings_of(arguments)) as (session, over):
        assert session.recorder is not None
        status = StatusLine(session)
        say(f"Recording {session.link.address} into {session.recorder.path}  (Ctrl-C ends it)")
        while not over() and not session.recorder.problem:
            session.step()
            session.beside(status.show)
        restored = session.leave()
        session.beside(status.end)
    return conclude(session, restored=restored)
