"""The verdict on recordings whose truth is known: `python benchmarks/accuracy/labelled.py [FOLDER] [--labels FILE]`.

Without FOLDER: ../shared/tlogs beside the checkout. With --rate 4 every flight is first thinned to what a ground
station records by default: IMU and attitude at 4 Hz. Anyone can run it on labelled recordings of their own: the format
of the labels is documented in benchmarks/accuracy/labels.toml.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import get_args

import msgspec

from benchmarks.accuracy.answer import Answer, answer
from benchmarks.accuracy.changes import slower_attitude
from benchmarks.accuracy.cutting import thinned
from benchmarks.accuracy.labels import SHARED, Label, Outcome, details, load_labels, name_of, outcome, recordings
from benchmarks.accuracy.parallel import Failed, each
from benchmarks.accuracy.reliability import Claim, reliability
from companion.app.recording import read_recording
from companion.model import CompanionError, Flight

HERE = Path(__file__).resolve().parent
OUTCOMES: tuple[Outcome, ...] = get_args(Outcome)

Answers = dict[str, Answer | Failed]  # "SYSID/BOOT" → what was said of the flight


@dataclass(frozen=True, slots=True)
class Row:
    """One label, and what was said."""

    log: str
    flight: str  # SYSID/BOOT, "" where there is none
    group: str
    truth: str
    outcome: Outcome
    said: Answer | None
    details: dict[str, bool]  # cause, sensor, axis, onset, size: right or not, where the side is right
    delay_s: float | None  # of the onset that was said
    note: str = ""


def answers(path: Path, rate_hz: float | None = None) -> Answers:
    """What is said of each flight of a recording. A flight that the analysis fails on does not hide the others.

    rate_hz: to which IMU and attitude are thinned first.
    """
    by_flight: Answers = {}
    for flight in read_recording(path).flights:
        name = f"{flight.vehicle.sysid}/{flight.boot}"
        try:
            by_flight[name] = answer(flight if rate_hz is None else _slower(flight, rate_hz))
        except Exception as error:  # noqa: BLE001  (a failure is a row)
            by_flight[name] = Failed(f"{type(error).__name__}: {error}")
    return by_flight


def _slower(flight: Flight, rate_hz: float) -> Flight:
    """The flight with IMU and attitude at a rate; the attitude as it is where it is slower already."""
    thin = thinned(flight, rate_hz)
    return slower_attitude(thin, rate_hz) or thin


def rows(log: str, labels: Sequence[Label], said: Answers | Failed) -> list[Row]:
    """A recording's flights and labels side by side. Flights that no label speaks of are left out."""
    own = [label for label in labels if label.matches(log)]
    if isinstance(said, Failed) or not said:
        reason = said.reason if isinstance(said, Failed) else "no flight in it"
        named = [label for label in own if label.flight] or own[:1]
        return [_row(log, label.flight, label, Failed(reason)) for label in named]
    outcomes = []
    for flight, what in said.items():
        label = next((label for label in own if label.flight in {"", flight}), None)
        if label is not None:
            outcomes.append(_row(log, flight, label, what))
    lacking = [label for label in own if label.flight and label.flight not in said]
    return outcomes + [_row(log, label.flight, label, Failed("no such flight was found")) for label in lacking]


def _row(log: str, flight: str, label: Label, what: Answer | Failed) -> Row:
    said = None if isinstance(what, Failed) else what
    result = outcome(label, said)
    named = said is not None and said.side == label.truth
    delay = None
    if said is not None and named and said.onset is not None and label.onset is not None:
        delay = said.onset - label.onset
    return Row(
        log,
        flight,
        label.group or log.partition("/")[0],
        label.truth,
        result,
        said,
        details(label, said) if said is not None and named else {},
        delay,
        what.reason if isinstance(what, Failed) else "",
    )


def run(
    folder: Path, labels: Sequence[Label], *, rate_hz: float | None = None, workers: int | None, timeout: float
) -> list[Row]:
    """Every labelled recording below a folder."""
    paths = [path for path in recordings(folder) if any(label.matches(name_of(path, folder)) for label in labels)]
    outcomes: list[Row] = []
    for index, said in each(partial(answers, rate_hz=rate_hz), paths, workers=workers, timeout=timeout):
        outcomes += rows(name_of(paths[index], folder), labels, said)
    return sorted(outcomes, key=lambda row: (row.group, row.log, row.flight))


def table(outcomes: Iterable[Row]) -> str:
    """How often each outcome came up, by group and in all, as a Markdown table."""
    counts: dict[str, Counter[Outcome]] = defaultdict(Counter)
    for row in outcomes:
        counts[row.group][row.outcome] += 1
        counts["**all**"][row.outcome] += 1
    lines = [f"| group | flights | {' | '.join(OUTCOMES)} |", "|---" * (len(OUTCOMES) + 2) + "|"]
    for group in sorted(counts, key=lambda name: (name == "**all**", name)):
        count = counts[group]
        lines.append(f"| {group} | {count.total()} | {' | '.join(str(count[o] or '') for o in OUTCOMES)} |")
    return "\n".join(lines)


def _stated(outcomes: Iterable[Row]) -> Iterator[Claim]:
    """Verdicts that say who is wrong, or that nobody is."""
    for row in outcomes:
        if row.said is not None and row.said.side != "cannot_tell":
            owner, named, _ = Path(row.log).name.partition("__")
            whose, right = owner if named else row.group, row.outcome == "right"
            yield Claim(whose, row.said.stated, right, accuses=row.said.side != "none")


def wrong_reason(row: Row) -> bool:
    """Whether the right side is named, but for a cause or at a time that is not the fault's."""
    return not (row.details.get("cause", True) and row.details.get("onset", True))


def detail_table(outcomes: Iterable[Row]) -> str:
    """Of the faults whose side is named: how often the rest is right too."""
    right: Counter[str] = Counter()
    known: Counter[str] = Counter()
    for row in outcomes:
        right.update(name for name, good in row.details.items() if good)
        known.update(row.details.keys())
    return ", ".join(f"{name} {right[name]} of {known[name]}" for name in known) or "none"


def _line(row: Row) -> str:
    said = row.note if row.said is None else f"{row.said.side} {row.said.cause}: {row.said.summary}"
    wrong = [name for name, good in row.details.items() if not good]
    return (
        f"{row.outcome:12} {row.log} {row.flight} [{row.truth}] {said}"
        + (f" (onset {row.delay_s:+.1f} s)" if row.delay_s is not None else "")
        + (f" (not right: {', '.join(wrong)})" if wrong else "")
    )


def main() -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, default=SHARED, help="with the recordings")
    parser.add_argument("--labels", type=Path, default=HERE / "labels.toml", help="what is known of them")
    parser.add_argument("--rate", type=float, metavar="HZ", help="thin IMU and attitude of every flight to this first")
    parser.add_argument("--workers", type=int, help="processes, default: one for each processor")
    parser.add_argument("--timeout", type=float, default=120.0, help="seconds for one recording")
    parser.add_argument("--json", type=Path, help="write every row there")
    chosen = parser.parse_args()
    try:
        labels = load_labels(chosen.labels)
    except CompanionError as error:
        parser.error(str(error))
    outcomes = run(chosen.folder, labels, rate_hz=chosen.rate, workers=chosen.workers, timeout=chosen.timeout)
    if not outcomes:
        parser.error(f"no recording below {chosen.folder} is named in {chosen.labels}")
    print(*map(_line, outcomes), sep="\n")
    print(f"\n{table(outcomes)}\n\nOf the faults whose side is named, right: {detail_table(outcomes)}")
    print(f"Right side for a wrong reason (cause or time): {sum(map(wrong_reason, outcomes))}")
    print(f"\n{reliability(_stated(outcomes))}")
    if chosen.json:
        chosen.json.write_bytes(msgspec.json.format(msgspec.json.encode(outcomes)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
