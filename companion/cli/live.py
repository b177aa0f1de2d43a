"""What every command with a live link shares: its options, its end by a signal, its status line."""

from __future__ import annotations

import argparse
import contextlib
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator

from companion.cli import options
from companion.errors import SettingsError
from companion.mavlink import Choice, Link, Recorder, Session, load_key
from companion.settings import Settings

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_TERMINAL_S, _LOG_S = 0.5, 10.0  # between status lines: rewritten on a terminal, added elsewhere


def add_link(parser: argparse.ArgumentParser) -> None:
    """The link, and what may be asked of the vehicle."""
    parser.add_argument(
        "link",
        metavar="LINK",
        help="udpin:HOST:PORT (wait for packets), udpout:, tcp:, tcpin:HOST:PORT, or a device: /dev/ttyACM0[:BAUD]",
    )
    parser.add_argument("--config", metavar="FILE", help="settings file; config/default.toml describes every key")
    parser.add_argument("--dialect", metavar="NAME", help="MAVLink dialect (default: ardupilotmega)")
    parser.add_argument(
        "--vehicle", metavar="SYSID[:COMPID]", help="the vehicle to ask, or all (default: the first heard)"
    )
    add_manners(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help=OUTPUT)


OUTPUT = "a new .tlog to record into (default: YYYY-MM-DD hh-mm-ss.tlog in this folder)"


def add_manners(parser: argparse.ArgumentParser | argparse._ArgumentGroup) -> None:
    """What may be asked of the vehicle."""
    parser.add_argument("--rate", type=float, metavar="HZ", help="how often to ask for the IMU (default: 100)")
    parser.add_argument(
        "--signing-key-file",
        metavar="FILE",
        help="sign what is sent, and drop what is not signed, with the key in this file: 64 hex digits or a passphrase",
    )
    parser.add_argument("--listen-only", action="store_true", help="send nothing at all, ever")


def open_link(address: str, arguments: argparse.Namespace, settings: Settings) -> Link:
    """The link that was named."""
    return Link(
        address,
        dialect=settings.log.dialect,
        listen_only=arguments.listen_only,
        sysid=settings.live.sysid,
        compid=settings.live.compid,
        signing_key=load_key(arguments.signing_key_file) if arguments.signing_key_file else None,
    )


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
def until_told() -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C or SIGTERM has come, as a function: the work in hand is finished first."""
    told: list[int] = []
    before = {number: signal.signal(number, lambda number, _: told.append(number)) for number in _SIGNALS}
    try:
        yield lambda: bool(told)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def conclude(link: Link, recorder: Recorder) -> None:
    """Say what has been recorded."""
    health = link.health
    if health.unsigned or health.wrongly_signed:
        options.say(
            f"{health.unsigned:,} frames without a signature and {health.wrongly_signed:,} with a wrong one were "
            "dropped: they are not in the recording"
        )
    if not link.health.frames:
        options.say("nothing was received, so nothing is recorded: does the vehicle send to this address?")
        return
    print(f"{recorder.path}: {recorder.size_bytes:,} bytes, {link.health.frames:,} frames", flush=True)


class StatusLine:
    """What a session does, on stderr: rewritten on a terminal, now and then elsewhere."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._begin = self._shown = time.monotonic()
        self._terminal = sys.stderr.isatty()

    def show(self) -> None:
        """Say what the session has to say, and the status when it is time."""
        for sentence in self._session.said:
            options.say(f"\r\x1b[K{sentence}" if self._terminal else sentence)
        self._session.said.clear()
        now = time.monotonic()
        if now - self._shown >= (_TERMINAL_S if self._terminal else _LOG_S):
            self._shown = now
            print(f"\r\x1b[K{self.text()}" if self._terminal else self.text(), end="" if self._terminal else "\n",
                  file=sys.stderr, flush=True)  # fmt: skip

    def end(self) -> None:
        """Leave the line."""
        self.show()
        if self._terminal:
            options.say("")

    def text(self) -> str:
        """One line: time, what arrives of what was asked, loss, recording."""
        session, health = self._session, self._session.link.health
        parts = [f"{time.monotonic() - self._begin:.0f} s"]
        if problem := session.link.problem:
            parts.append(problem)
        if session.rates is not None:
            parts += [f"{w.name} {w.received_hz:.0f}/{w.wanted_hz:.0f} Hz" for w in session.rates.wishes if w.count]
        lost = sum(health.lost.values())
        if health.unsigned or health.wrongly_signed:
            parts.append(f"{health.unsigned + health.wrongly_signed} not signed with our key")
        if health.frames:
            parts.append(f"lost {lost / (lost + health.frames):.1%}")
        if (clock := session.report().clock) is not None:
            parts.append(f"latency {clock.latency_ms:.0f} ms")
        if session.recorder is not None:
            parts.append(f"{session.recorder.size_bytes / 1e6:.1f} MB")
        return " · ".join(parts)
