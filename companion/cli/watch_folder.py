"""`companion watch-folder DIR`: the verdict on each log that comes into a folder, as soon as it is whole."""

from __future__ import annotations

import argparse
import json
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rich.markup import escape

from companion.app.examination import examined_or_not
from companion.app.recording import read_recording
from companion.app.settings import Settings
from companion.cli import live, options, tables
from companion.installation import missing
from companion.logs import looks_like_a_log
from companion.model import CompanionError, DataError, Flight, InputError, SettingsError
from companion.present import clause

_ENDINGS = (".tlog", ".bin", ".log", ".ulg", ".px4log", ".gz", ".xz", ".bz2", ".zst", ".zip")
_SETTLED_S = 3.0  # a telemetry log grows several times a second, a download too
_LOOK_MS = 500

Line = dict[str, Any]


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
        from watchfiles import Change, watch  # noqa: PLC0415  (an extra)
    except ImportError:
        raise missing("watch", "companion watch-folder needs the watchfiles library") from None
    settings, folder = options.settings_of(arguments), Path(arguments.folder)
    if not folder.is_dir():
        raise InputError(f"there is no folder {folder}: name the one that logs come into.")
    if not arguments.settle >= 0:
        raise SettingsError(f"--settle is a number of seconds, got {arguments.settle:g}.")
    command = options.command_of("--run", arguments.each or "")
    there = sorted(path for path in folder.rglob("*") if path.is_file()) if arguments.existing else []
    growing = dict.fromkeys(there, (-1, 0.0))
    live.say(f"Watching {folder}  (Ctrl-C ends it)")
    stop = threading.Event()
    changed = watch(
        folder, step=100, stop_event=stop, rust_timeout=_LOOK_MS, yield_on_timeout=True, raise_interrupt=False
    )
    with live.until_signal(outlive_terminal=False) as ended:
        for changes in changed:
            if ended():
                stop.set()
            came = (Path(name) for change, name in changes if change != Change.deleted)
            growing |= {path: growing.get(path, (-1, 0.0)) for path in came if path.suffix.lower() in _ENDINGS}
            for path in settled(growing, arguments.settle, time.monotonic()):
                for line in verdicts(path, folder, settings):
                    _tell(line, command, as_json=arguments.json)
    return 0


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


def verdicts(path: Path, folder: Path, settings: Settings) -> Iterator[Line]:
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
            yield {**head, "duration_s": round(flight.duration, 1), **_verdict(flight, settings)}
    except (CompanionError, OSError) as error:
        yield {"log": name, "error": str(error)}


def _verdict(flight: Flight, settings: Settings) -> Line:
    try:
        verdict = examined_or_not(flight, settings).verdict
    except DataError as error:
        return {"status": "insufficient_data", "summary": str(error)}
    return {"status": verdict.status, "summary": verdict.summary}


def _tell(line: Line, command: options.Command, *, as_json: bool) -> None:
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
            subprocess.run(command, input=text, text=True, check=False)
        except OSError as error:
            live.say(f"--run {command if isinstance(command, str) else command[0]} cannot be run: {error.strerror}")
