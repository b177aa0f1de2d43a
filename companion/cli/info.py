"""`companion info LOG`: vehicles, sensors and messages of a log."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from rich.markup import escape
from rich.measure import Measurement
from rich.table import Table

from companion.app.recording import Recording, Source
from companion.cli import many_logs, options, tables
from companion.comparison import phases
from companion.documents import encode, info_document
from companion.model import Flight, Item, SettingsError, counted, inventory, longest_step, used_aiding, used_imus
from companion.present import capitalised, severity_word, vehicle_words

_MOST_SHOWN = 16  # flights
_WIDE = 1000  # columns: more than any table needs


def info_options(parser: options.Parser) -> None:
    """The command's options."""
    options.add_log(parser, takes_several=True)
    options.add(parser, "--json")
    parser.add_argument(
        "--verbose",
        action="store_true",
        help="also: arming, modes, errors and texts of the vehicle; other senders, and why they are not vehicles",
    )
    parser.add_argument(
        "--table",
        action="store_true",
        help="one line per flight instead, with the rate of every sensor (Markdown, 25 columns)",
    )
    options.add(parser, "--core")


def run_info(arguments: argparse.Namespace) -> int:
    """Print what is in the log."""
    if arguments.table or len(arguments.logs) > 1 or Path(arguments.logs[0]).is_dir():
        if given := [f"--{name}" for name in ("json", "verbose") if getattr(arguments, name)]:
            raise SettingsError(f"{' and '.join(given)} is of one log: name one, without --table.")
        return (many_logs.print_sensors if arguments.table else many_logs.print_overview)(arguments)
    arguments.log = arguments.logs[0]
    recording = options.read(arguments, options.settings_of(arguments), every_message=True)
    if arguments.json:
        print(encode(info_document(recording)))
        return 0
    console = tables.console()
    console.lines(_summary(recording.source))
    if not recording.flights:
        console.lines(escape(f"{capitalised(recording.no_flight)}."))
    flights = recording.flights if arguments.verbose else _with_the_most(recording.flights)
    for flight in flights:
        _print_flight(console, flight)
        if arguments.verbose:
            console.lines(*_events(flight))
    if left := len(recording.flights) - len(flights):
        console.lines(f"\n{counted(left, 'more flight')}, with fewer messages: --verbose or --json")
    if left := recording.unread_senders:
        console.lines(f"\n{counted(left, 'more sender')}, with fewer messages than these, not looked at")
    if arguments.verbose or not recording.flights:
        console.lines(*_others(recording))
    return 0


def _with_the_most(flights: Sequence[Flight]) -> Sequence[Flight]:
    """Those with the most messages, in their order."""
    counts = [sum(stats.count for stats in flight.messages.values()) for flight in flights]
    most = sorted(range(len(flights)), key=lambda i: -counts[i])[:_MOST_SHOWN]
    return [flights[i] for i in sorted(most)]


def _events(flight: Flight) -> Iterator[str]:
    lines = [(event.t, event.kind, "" if event.text == event.kind else event.text) for event in flight.events]
    lines += [(text.t, severity_word(text.severity), text.text) for text in flight.texts]
    lines += [(reset.t, "reset", f"{reset.kind}: {reset.text}") for reset in flight.resets]
    lines += [(one.t, "parameter", f"{one.name} = {one.value:g}") for one in flight.parameter_changes]
    return (f"  {t:9.2f} s  {kind:<9} {escape(text)}" for t, kind, text in sorted(lines, key=lambda line: line[0]))


def _others(recording: Recording) -> Iterator[str]:
    if recording.bystanders:
        yield "\n[bold]Other senders, and why they are not vehicles[/]"
    for other in recording.bystanders:
        who = f"{other.sysid}:{other.compid}"
        parts = ", ".join(f"{name} ({count})" for name, count in sorted(recording.source.speakers[who].items()))
        yield f"  {who}: {other.reason}. Sent: {parts}"


def _summary(source: Source) -> str:
    text = f"{escape(str(source.path))}: {counted(source.size_bytes, 'byte')}"
    if source.content_bytes != source.size_bytes:
        text += f" ({source.content_bytes:,} decompressed)"
    text += f", {counted(source.frames, 'frame' if source.format in ('tlog', 'raw') else 'message')}"
    if source.trouble:
        text += f"; {escape(source.trouble)}"
    if source.bad_crc_frames or source.skipped_bytes:
        text += (
            f"; damage: {counted(source.bad_crc_frames, 'frame')} with a wrong checksum, "
            f"{counted(source.skipped_bytes, 'byte')} skipped"
        )
    if source.unknown_frames:
        ids = ", ".join(f"{number} ({count})" for number, count in sorted(source.unknown_frames.items()))
        text += f"; message ids that the dialect does not know: {ids}"
    return text


def _print_flight(console: tables.Console, flight: Flight) -> None:
    vehicle = flight.vehicle
    clock = f"boot clock {flight.start:.1f} to {flight.start + flight.duration:.1f} s"
    named = f"Vehicle {vehicle}, boot {flight.boot}"
    title = tables.wrapped(f"{named}: {vehicle_words(vehicle)}, {flight.duration:.1f} s ({clock})", console.width, 2)
    title[0] = title[0].replace(named, f"[bold]{named}[/]", 1)
    console.lines("\n" + "\n".join(title))
    _print_facts(console, _facts(flight))
    _print_sensors(console, flight)
    table = _table("\nmessage", "\ncount", "\nmean Hz", "longest\ngap s", "\nduplicates")
    table.columns[0].no_wrap, table.columns[0].overflow = False, "fold"  # names of PX4's topics are long
    for name, stats in flight.messages.items():
        rate = "burst" if (stats.rate_hz or 0.0) >= 1e4 else _number(stats.rate_hz, 1)
        gap = _number(stats.longest_gap_s, 2)
        table.add_row(name, f"{stats.count}", rate, gap, f"{stats.duplicates or ''}")
    console.print(table)


def _facts(flight: Flight) -> Iterator[tuple[str, str]]:
    yield "would integrate", imu_line(flight)
    yield "would compare with", reference_line(flight)
    if missed := gap_line(flight):
        yield "gaps", missed
    if used := used_imus(flight):
        yield "estimator used", used
    if used := used_aiding(flight):
        yield "aided by", used
    yield "phases", ", ".join(f"{part.kind} {part.start:.1f}-{part.end:.1f} s" for part in phases(flight))
    if announced := _announced(flight):
        yield "announced", announced
    yield from (("note", note) for note in flight.notes)


def _print_facts(console: tables.Console, facts: Iterable[tuple[str, str]]) -> None:
    for name, text in facts:
        console.lines(*tables.wrapped(f"  {name}: {text}", console.width, 4))


def _print_sensors(console: tables.Console, flight: Flight) -> None:
    """A line for each; notes on them beneath the table, where the terminal is too narrow for it."""
    items = list(inventory(flight))
    whole, narrow = _sensors(items, with_words=True), _sensors(items, with_words=False)
    if Measurement.get(console, console.options.update(max_width=_WIDE), whole).maximum <= console.width:
        console.print(whole)
        return
    console.print(narrow)
    _print_facts(console, ((f"{item.kind} {item.source}", item.about) for item in items if item.about))


def _sensors(items: Sequence[Item], *, with_words: bool) -> Table:
    if with_words:
        table = _table("sensor", "from", "samples", "mean Hz", "gaps", "longest s", "")
    else:
        table = _table("\nsensor", "\nfrom", "\nsamples", "mean\nHz", "\ngaps", "max\ns")
    for item in items:
        gap = _number(item.longest_gap_s, 2)
        cells = (item.kind, escape(item.source), f"{item.samples}", _number(item.rate_hz, 1), f"{item.gaps or ''}", gap)
        table.add_row(*cells, *[escape(item.about)] * with_words)
    return table


def _table(*headings: str) -> Table:
    """Columns of numbers have other headings than these."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in headings:
        text = heading.strip() in ("message", "sensor", "from", "")
        table.add_column(heading, justify="left" if text else "right", no_wrap=not text, overflow="fold")
    return table


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _announced(flight: Flight) -> str:
    """The numbers of jumps and changes of parameters that the vehicle announced; "" for none."""
    kinds = Counter(f"{reset.kind} {'switch' if reset.kind == 'lane' else 'reset'}" for reset in flight.resets)
    parts = [counted(count, kind) for kind, count in sorted(kinds.items())]
    if count := len(flight.parameter_changes):
        parts.append(counted(count, "parameter change"))
    return ", ".join(parts)


def imu_line(flight: Flight) -> str:
    """The IMU and its rate; or that there is none."""
    name = flight.default_imu
    if name is None:
        return "nothing: no IMU message with two samples or more"
    track = flight.imus[name]
    return f"{name} (IMU {track.instance}), {len(track)} samples at {track.rate_hz:.1f} Hz"


def gap_line(flight: Flight) -> str:
    """The gaps of that IMU, and whether the vehicle was armed: a log that pauses while disarmed has lost nothing."""
    switched = [(event.t, event.kind == "armed") for event in flight.events if event.kind in ("armed", "disarmed")]
    if flight.default_imu is None or not switched:
        return ""
    t = flight.imus[flight.default_imu].t
    steps = np.diff(t)
    gaps = np.flatnonzero(steps > longest_step(t))
    before = np.searchsorted([at for at, _ in switched], t[gaps], side="right")
    states = [not switched[0][1], *(armed for _, armed in switched)]  # before the first it was the other way
    armed = np.array([states[i] for i in before], dtype=bool)
    parts = []
    for chosen, words in ((armed, "while armed"), (~armed, "while disarmed, where a log may pause")):
        if chosen.any():
            parts.append(f"{counted(int(chosen.sum()), 'gap')} {words}, the longest {steps[gaps[chosen]].max():.2f} s")
    return "; ".join(parts)


def reference_line(flight: Flight) -> str:
    """The messages that the autopilot's state is taken from."""
    attitude = flight.attitude.source if flight.attitude else "no attitude"
    return f"{attitude}, {flight.position.source if flight.position else 'no position: attitude alone'}"
