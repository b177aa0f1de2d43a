"""`companion watch LINK`: the verdict on a link without a page: JSON lines, a recording, an exit code. For services.

`companion watch-folder DIR`: the verdict on each log that comes into a folder, as soon as it is whole.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shlex
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from rich.markup import escape

from companion.app.examination import examined_or_not
from companion.app.recording import read_recording
from companion.app.running_verdict import Assignment, RunningVerdict
from companion.app.settings import Settings
from companion.cli import live, options, tables
from companion.installation import missing
from companion.links import Session, announce
from companion.logs import looks_like_a_log
from companion.model import CompanionError, DataError, Flight, InputError, SettingsError
from companion.present import clause
from companion.verdict import LiveVerdict

_LINE_S = 1.0  # between two lines where nothing changes
_QUIET_S = 10.0  # between two announcements, at least
_FORGOTTEN_S = 5.0  # from when on a change is no news any more: the announcement speaks of what holds then
_WORDS = {
    "consistent": "IMU and autopilot agree",
    "imu_suspect": "IMU SUSPECT",
    "autopilot_suspect": "AUTOPILOT SUSPECT",
    "lost": "control lost",
}
"""What is announced; other states are nobody's business in flight."""


Command: TypeAlias = "str | list[str]"
"""A command line as `Popen` takes it: its words; on Windows, which splits it by rules of its own, the text."""


def command_of(option: str, text: str) -> Command:
    """The command line that an option has. Raises SettingsError for one that is none."""
    if sys.platform == "win32":
        return text
    try:
        return shlex.split(text)
    except ValueError as error:
        raise SettingsError(f"{option} {text} is not a command: {error}.") from None


def watch_options(parser: options.Parser) -> None:
    """The command's options."""
    live.add_link(parser)
    parser.set_defaults(wait=float("inf"))
    parser.add_argument("--imu", metavar="MESSAGE", help="IMU message to judge (default: the best that comes)")
    parser.add_argument("--no-record", action="store_true", help="record nothing")
    options.add_fail_on(
        parser,
        "exit with code 1 when there was an alarm (suspect), or no consistent verdict without one (insufficient)",
    )
    parser.add_argument(
        "--on-change",
        metavar="CMD",
        help="run this command when the verdict changes, with the JSON line on its stdin; never waited for",
    )
    parser.add_argument(
        "--announce",
        action="store_true",
        help="send changes of the verdict to ground stations as STATUSTEXT, one in 10 s at most (off by default)",
    )


def run_watch(arguments: argparse.Namespace) -> int:
    """Watch until Ctrl-C, SIGTERM or the duration; then give the vehicle its message intervals back."""
    settings = options.settings_of(arguments)
    if arguments.announce and arguments.listen_only:
        raise SettingsError("--announce sends, and --listen-only sends nothing at all: leave one of them out.")
    command = command_of("--on-change", arguments.on_change or "")
    with (
        live.session_on(arguments.link, arguments, settings) as (session, over),
        RunningVerdict(Assignment(settings, imu=arguments.imu, vehicle=arguments.vehicle)) as verdict,
    ):
        session.link.announces = arguments.announce
        session.listen(lambda frames, received: verdict.receive([(frames, received)]))
        lines = _Lines(session, verdict, command, announces=arguments.announce)
        while not over():
            session.step()
            session.beside(lines.show)
        last = lines.last  # before the end makes it old, and the closed link silent
        verdict.close()  # what it still judges would only hold up the end
        restored = session.leave()
        live.say_all(session.reported)
    if not session.link.health.frames:
        return live.nothing_received()
    if not restored or (session.recorder is not None and session.recorder.problem):
        return 2
    statuses = [one.so_far[0] for one in last]
    if arguments.fail_on == "insufficient":  # an old verdict is none
        statuses += [one.now[0] for one in last if one.is_stale]
    return options.exit_code(arguments.fail_on, statuses)


class _Lines:
    """What is printed on stdout: of each vehicle a line when its verdict changes, and one a second."""

    def __init__(self, session: Session, verdict: RunningVerdict, command: Command, *, announces: bool) -> None:
        self._session, self._verdict = session, verdict
        self._command, self._announces = command, announces
        self._due = 0.0
        self._changes: dict[str, _Changes] = {}  # of each vehicle
        self._seen: dict[str, LiveVerdict] = {}

    @property
    def last(self) -> list[LiveVerdict]:
        """What holds now, of every vehicle."""
        silent = bool(self._session.link.problem)
        return [self._verdict.read(vehicle, silent=silent) for vehicle in self._verdict.vehicles]

    def show(self) -> None:
        """Say what is new."""
        live.say_all(self._session.reported)
        self._session.reported.clear()
        now, all_verdicts = time.monotonic(), self.last
        due = now >= self._due
        if due:
            self._due = now + _LINE_S
        for live_verdict in all_verdicts:
            vehicle = live_verdict.vehicle
            before = self._seen.get(vehicle)
            new = before is None or (before.newest, before.now[0]) != (live_verdict.newest, live_verdict.now[0])
            if not (new or due):
                continue
            if before is None and vehicle and any(self._seen):
                live.say(f"vehicle {vehicle} is judged")
            self._seen[vehicle] = live_verdict
            line = _line(self._session, live_verdict)
            changed = self._of(vehicle).take(line, several=len(all_verdicts) > 1)
            if changed or due:
                live.print_line(json.dumps({**line, "changed": changed}, ensure_ascii=False, allow_nan=False))

    def _of(self, vehicle: str) -> _Changes:
        """Whom to tell of a vehicle's changes; what was said before it was known who it is counts for the first."""
        if vehicle not in self._changes:
            first = self._changes.pop("", None)
            self._changes[vehicle] = first or _Changes(self._session, self._command, announces=self._announces)
        return self._changes[vehicle]


class _Changes:
    """Tells others when the verdict on a vehicle changes: a command, the ground stations."""

    def __init__(self, session: Session, command: Command, *, announces: bool) -> None:
        self._session, self._command, self._announces = session, command, announces
        self._status = ""
        self._announced, self._announced_at = "", -_QUIET_S
        self._running: list[subprocess.Popen[str]] = []

    def take(self, line: dict[str, Any], *, several: bool = False) -> bool:
        """Whether the status is another than before. several: whether other vehicles are judged too."""
        self._running = [process for process in self._running if process.poll() is None]
        changed = bool(line["status"] != self._status)
        self._status = line["status"]
        if changed and self._command:
            self._start(json.dumps(line, ensure_ascii=False))
        self._announce(line, f" ({line['vehicle']})" if several else "")
        return changed

    def _start(self, text: str) -> None:
        try:
            process = subprocess.Popen(self._command, stdin=subprocess.PIPE, text=True, start_new_session=True)
        except OSError as error:
            name = self._command if isinstance(self._command, str) else self._command[0]
            live.say(f"--on-change {name} cannot be run: {error.strerror}")
            return
        self._running.append(process)
        if process.stdin is not None:
            with contextlib.suppress(OSError):  # it has ended without reading
                process.stdin.write(text)  # less than a pipe holds, so nobody is waited for
                process.stdin.close()

    def _announce(self, line: dict[str, Any], of: str) -> None:
        status, now = line["status"], time.monotonic()
        if not self._announces or status not in _WORDS or status == self._announced:
            return
        if status == "consistent" and not self._announced:
            self._announced = status  # that all is well from the beginning is no news
            return
        if now - self._announced_at < _QUIET_S or line["age_s"] > _FORGOTTEN_S:
            return
        self._announced, self._announced_at = status, now
        words = announce(f"{_WORDS[status]}{of}", alarm=status != "consistent")
        self._session.link.send(words, aboard=int(line["vehicle"].partition(":")[0] or 0) or None)


def _line(session: Session, live_verdict: LiveVerdict) -> dict[str, Any]:
    """What there is to say of a vehicle, in plain values."""
    report = session.report()
    (now, text), (status, text_so_far) = live_verdict.now, live_verdict.so_far
    return {
        "time": round(time.time(), 3),
        "vehicle": live_verdict.vehicle,
        "status": now,
        "text": text,
        "last_status": live_verdict.status,
        "age_s": round(live_verdict.age_s, 1),
        "status_so_far": status,
        "text_so_far": text_so_far,
        "alarms": [
            {"status": alarm.status, "text": alarm.text, "first": round(alarm.first, 1), "last": round(alarm.last, 1)}
            for alarm in live_verdict.alarms
        ],
        "link": report.link,
        "problem": report.problem,
        "received_hz": {one.name: round(one.received_hz, 1) for one in report.arriving},
        "lost": {who: round(share, 4) for who, share in report.lost_by.items()},
        "recording": report.recording,
        "recorded_bytes": report.recorded_bytes,
        "recording_problem": report.recording_problem,
    }


_ENDINGS = (".tlog", ".bin", ".log", ".ulg", ".px4log", ".gz", ".xz", ".bz2", ".zst", ".zip")
_SETTLED_S = 3.0  # a telemetry log grows several times a second, a download too
_LOOK_MS = 500
_CLOCK_S = 0.1  # by which the times of files may be behind
_ADDED = 1  # watchfiles.Change.added

LogLine = dict[str, Any]


def watch_folder_options(parser: options.Parser) -> None:
    """The command's options."""
    parser.add_argument("folder", metavar="DIR", help="the folder that logs come into, with all below it")
    parser.add_argument("--existing", action="store_true", help="judge the logs that are there already too")
    parser.add_argument(
        "--settle",
        type=float,
        metavar="S",
        default=_SETTLED_S,
        help=f"a log is whole when it has not grown for so long (default: {_SETTLED_S:g})",
    )
    parser.add_argument(
        "--run",
        dest="each",
        metavar="CMD",
        help="run this command for each verdict, with its JSON line on stdin; it is waited for",
    )
    parser.add_argument("--json", action="store_true", help="a JSON line for each verdict instead of text")
    options.add(parser, *options.SETTINGS)


def run_watch_folder(arguments: argparse.Namespace) -> int:
    """Watch until Ctrl-C or SIGTERM."""
    try:
        import watchfiles  # noqa: PLC0415  (an extra)
    except ImportError:
        raise missing("watch", "companion watch-folder needs the watchfiles library") from None
    settings, folder = options.settings_of(arguments), Path(arguments.folder)
    if not folder.is_dir():
        raise InputError(f"there is no folder {folder}: name the one that logs come into.")
    if not os.access(folder, os.R_OK | os.X_OK):
        raise InputError(f"the folder {folder} cannot be searched: you may not read it.")
    if not arguments.settle >= 0:
        raise SettingsError(f"--settle is a number of seconds, got {arguments.settle:g}.")
    command = command_of("--run", arguments.each or "")
    there = sorted(_files(folder)) if arguments.existing else []
    growing = dict.fromkeys(there, (-1, 0.0))
    live.say(f"Watching {folder}  (Ctrl-C ends it)")
    stop = threading.Event()
    wake = partial(
        watchfiles.watch, step=100, stop_event=stop, rust_timeout=_LOOK_MS, yield_on_timeout=True, raise_interrupt=False
    )
    with live.until_signal(outlive_terminal=False) as ended:
        for came in _came(folder, wake):
            if ended():
                stop.set()
            growing |= {path: growing.get(path, (-1, 0.0)) for path in came if path.suffix.lower() in _ENDINGS}
            for path in settled(growing, arguments.settle, time.monotonic()):
                for line in verdicts(path, folder, settings):
                    _tell_of_log(line, command, as_json=arguments.json)
    return 0


def _came(folder: Path, wake: Callable[[Path], Iterable[Iterable[tuple[int, str]]]]) -> Iterator[list[Path]]:
    """What has come or grown, again and again; nothing where nothing has. A folder that comes is what is in it.

    wake: of watchfiles, which ends at a name that is not UTF-8: then the folder is looked through.
    """
    since = time.time()
    while True:
        try:
            for changes in wake(folder):
                since = time.time()
                yield [file for change, name in changes for file in _files(Path(name), below=change == _ADDED)]
        except RuntimeError:
            time.sleep(1e-3 * _LOOK_MS)
            before, since = since, time.time()
            yield [path for path in _files(folder) if path.stat().st_ctime > before - _CLOCK_S]
        else:
            return


def _files(path: Path, *, below: bool = True) -> Iterator[Path]:
    """The file itself, or those in a folder and below it."""
    return (one for one in (path, *(path.rglob("*") if below else ())) if one.is_file())


def settled(growing: dict[Path, tuple[int, float]], settle_s: float, now: float) -> list[Path]:
    """Take out those that are as large as `settle_s` ago; growing: path → size (-1: not looked at), and since when."""
    whole = []
    for path, (size, since) in list(growing.items()):
        try:
            new = path.stat().st_size
        except OSError:  # a temporary name of a download
            del growing[path]
            continue
        if new != size:
            growing[path] = new, now
        elif now - since >= settle_s:
            del growing[path]
            whole.append(path)
    return whole


def verdicts(path: Path, folder: Path, settings: Settings) -> Iterator[LogLine]:
    """A line for each flight of a log, or the error; nothing where the content is no log's."""
    name = str(path.relative_to(folder))
    try:
        if path.stat().st_size == 0 or not looks_like_a_log(path, dialect=settings.log.dialect):
            return
        recording = read_recording(path, **settings.log.options)
        if not recording.flights:
            yield {"log": name, "error": recording.no_flight}
        for flight in recording.flights:
            head = {"log": name, "vehicle": str(flight.vehicle), "boot": flight.boot}
            yield {**head, "duration_s": round(flight.duration, 1), **_verdict_on(flight, settings)}
    except (CompanionError, OSError) as error:
        yield {"log": name, "error": str(error)}
    except Exception as error:  # noqa: BLE001  (one bad log is a line, whatever it breaks)
        yield {"log": name, "error": f"{type(error).__name__}: {error}"}


def _verdict_on(flight: Flight, settings: Settings) -> LogLine:
    try:
        verdict = examined_or_not(flight, settings).verdict
    except DataError as error:
        return {"status": "insufficient_data", "summary": str(error)}
    return {"status": verdict.status, "summary": verdict.summary}


def _tell_of_log(line: LogLine, command: Command, *, as_json: bool) -> None:
    text = json.dumps(line, ensure_ascii=False)
    if as_json:
        live.print_line(text)
    elif "error" in line:
        tables.console().lines(escape(f"{line['log']}: not read: {line['error']}"))
    else:
        status, summary = tables.status_text(line["status"]), escape(clause(line["summary"]))
        head = escape(f"{line['log']}, vehicle {line['vehicle']}, boot {line['boot']}, {line['duration_s']:.0f} s")
        tables.console().lines(f"{status}  {head}: {summary}")
    if command:
        try:
            subprocess.run(command, input=text.encode("utf-8", "replace"), check=False)
        except OSError as error:
            live.say(f"--run {command if isinstance(command, str) else command[0]} cannot be run: {error.strerror}")
