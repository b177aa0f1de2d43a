"""Whether a verdict stays where it has to: `python benchmarks/accuracy/invariance.py [LOG ...]`.

What is no different flight may get no different verdict: see changes.py, and the on-board log of a flight beside what
came over the link. "Cannot tell" is no flip: with less to see less is told. Sizes have to agree within 1σ.

A window of 40 s that slides through a flight is a different one. What is said of it has to be right, or honest, or of a
fault that is below what the window says that it would have shown. Without arguments: recordings of ../shared/tlogs with
and without faults.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import msgspec
import numpy as np

from benchmarks.accuracy.answer import Answer, answer
from benchmarks.accuracy.changes import CHANGES, TWIN
from benchmarks.accuracy.cutting import cut
from benchmarks.accuracy.imperfect import is_off
from benchmarks.accuracy.injected import NO_LOGS, logs_of
from benchmarks.accuracy.labelled import HERE
from benchmarks.accuracy.labels import PACKED, SHARED, Label, is_below, load_labels, name_of
from benchmarks.accuracy.parallel import Failed, each
from companion.app.recording import read_recording
from companion.model import AttitudeTrack, Flight, PositionTrack

STANDARD = (
    "sitl/copter-demo-100hz.tlog",
    "sitl/copter-biased-imu-100hz.tlog",
    "ap_faults/gyrbias_z.tlog.xz",
    "ap_witness/gyro1_z_15mrad.tlog.xz",
    "ap_witness/clean_cruise.tlog.xz",
    "px4_faults/q_accel_step.tlog.xz",
    "px4_faults/q_gps_creep.tlog.xz",
    "ap_turn3/l_imu2gyr.tlog.xz",
    "dataflash/sitl__copter-demo.BIN",
    "real/JAParedes__ulogPX4QuadcopterAnimation__TestFlight1.ulg",
)
QUICK = ("sitl/copter-demo-100hz.tlog", "px4_faults/q_accel_step.tlog.xz")

ON_BOARD = {
    "sitl/copter-demo-100hz.tlog": "dataflash/sitl__copter-demo.BIN",
    "sitl/copter-hover-nodrift-100hz.tlog": "dataflash/sitl__copter-hover-nodrift.BIN",
    "sitl/copter-imu1-fail-100hz.tlog": "dataflash/sitl__copter-imu1-fail.BIN",
    "ap_faults/gyrbias_z.tlog": "ap_faults/gyrbias_z.bin.xz",
    "ap_witness/gyro1_z_15mrad.tlog": "ap_witness/gyro1_z_15mrad.BIN.xz",
    "px4/px4_square_lownoise.tlog": "px4/px4_square_lownoise.ulg",
    "px4_faults/q_accel_step.tlog": "px4_faults/q_accel_step.ulg.xz",
    "px4_faults/q_gps_creep.tlog": "px4_faults/q_gps_creep.ulg.xz",
    "px4_faults/q_two_imu.tlog": "px4_faults/q_two_imu.ulg.xz",
    "px4_turn3/gyro_sat06.tlog": "px4_turn3/gyro_sat06.ulg.xz",
}
"""What came over the link → the vehicle's own log of the same flight, by ../shared/tlogs/README.md."""

AS_IT_IS, BOARD, WINDOW = "as it is", "its on-board log", "a window of 40 s"

_WINDOW_S, _SLIDE_S = 40.0, 10.0
_QUANTITY = {"gps": "gps", "compass": "compass"}  # of a sensor's error, among the smallest sizes; else the cause's name

Outcome = Literal["right", "cannot tell", "not shown", "no change", "wrong", "missed"]


@dataclass(frozen=True, slots=True)
class Row:
    """A flight with one change, and what is said of it."""

    log: str  # below ../shared/tlogs
    change: str
    said: Answer | None  # None: the analysis failed
    begin: float | None = None  # s, of a window
    outcome: Outcome | None = None  # of a window
    note: str = ""


@dataclass(frozen=True, slots=True)
class Case:
    """One change of one recording."""

    path: Path
    change: str
    label: Label | None


def judged(case: Case) -> list[Row]:
    """The longest flight of a recording, changed; no row where it cannot be."""
    name, path = name_of(case.path), case.path
    if case.change == BOARD:
        path = SHARED / ON_BOARD[_unpacked(name)]
    flight = max(read_recording(path).flights, key=lambda one: one.duration)
    if case.change == WINDOW:
        return _windows(name, flight, case.label)
    if case.change == BOARD:
        return [Row(name, BOARD, answer(flight))]
    change = CHANGES[case.change]
    changed = change.of(flight)
    if changed is None:
        return []
    with change.world():
        return [Row(name, case.change, answer(changed))]


def _unpacked(name: str) -> str:
    return next((name.removesuffix(suffix) for suffix in PACKED if name.endswith(suffix)), name)


def _windows(name: str, flight: Flight, label: Label | None) -> list[Row]:
    """Every window of a flight. One that the analysis fails on does not hide the others."""
    rows = []
    for begin in np.arange(flight.start, flight.start + flight.duration - _WINDOW_S, _SLIDE_S).tolist():
        piece, said, note = cut(flight, begin, begin + _WINDOW_S), None, ""
        try:
            said = answer(piece)
        except Exception as error:  # noqa: BLE001  (a failure is a row)
            note = f"{type(error).__name__}: {error}"
        result = None
        if said is not None and label is not None:
            result = of_window(label, said, begin, begin + _WINDOW_S, off=_is_off(piece, said))
        rows.append(Row(name, WINDOW, said, begin, result, note))
    return rows


def of_window(label: Label, said: Answer, begin: float, end: float, *, off: bool) -> Outcome:
    """What is said of a window (s, boot clock) of a labelled flight against the label.

    Nothing is missed where the fault neither begins nor ends in the middle half of the window, for which detectable
    sizes are stated. off: whether the autopilot's estimate is, by the simulator's truth.
    """
    onset = -np.inf if label.onset is None else label.onset
    over = np.inf if label.end is None else label.end
    faulty = label.truth in ("imu", "autopilot") and onset < end and over > begin
    if said.side == "cannot_tell":
        return "cannot tell"
    if said.side == "none":
        quarter = 0.25 * (end - begin)
        if not faulty:
            return "right"
        if not any(begin + quarter <= t <= end - quarter for t in (onset, over)):
            return "no change"
        sizes = label.hidden or _size_of(label)
        return "not shown" if sizes and is_below(sizes, said) else "missed"
    right = said.side == label.truth if faulty else said.side == "autopilot" and off
    accepted = faulty and {said.side, f"{said.side}:{said.cause}"} & set(label.accept)
    return "right" if right or accepted else "wrong"


def _size_of(label: Label) -> dict[str, float]:
    if label.size is None or not label.cause:
        return {}
    return {_QUANTITY.get(label.sensor, label.cause[0]): label.size}


def _is_off(flight: Flight, said: Answer) -> bool:
    """Whether the autopilot's estimate is off by more than one in order, by the simulator's truth."""
    truth, attitude, position = flight.truth, flight.attitude, flight.position
    if said.side != "autopilot" or truth is None or attitude is None or position is None:
        return False
    known = np.isfinite(np.hstack([truth.q_ned_frd, truth.velocity, truth.position])).all(axis=1)
    known &= np.diff(truth.t, prepend=-np.inf) > 0
    if known.sum() < 2:
        return False
    t = truth.t[known]
    really = AttitudeTrack(t, truth.q_ned_frd[known], np.zeros((len(t), 3)))
    there = PositionTrack(t, truth.position[known], truth.velocity[known])
    return is_off(flight, replace(flight, attitude=really, position=there), said)


def flips(rows: Sequence[Row]) -> list[Row]:
    """Those of one flight of which another status is told than as it is, but for "cannot tell"; or another cause."""
    first = _first(rows)
    if first is None or first.side == "cannot_tell":
        return []
    return [
        row
        for row in _changed(rows)
        if row.said is not None
        and row.said.side != "cannot_tell"
        and (row.said.side, row.said.cause) != (first.side, first.cause)
    ]


def sized(rows: Sequence[Row]) -> list[tuple[Row, bool]]:
    """Those of one flight of which the same is told as of the flight as it is: whether its size is, within 1σ.

    By the larger σ of both: what is left out may tell no more than it.
    """
    first = _first(rows)
    if first is None or first.size is None or first.sigma is None:
        return []
    out = []
    for row in _changed(rows):
        said = row.said
        if said is None or said.size is None or said.sigma is None:
            continue
        if (said.side, said.cause) == (first.side, first.cause):
            out.append((row, abs(said.size - first.size) <= max(said.sigma, first.sigma)))
    return out


def _first(rows: Sequence[Row]) -> Answer | None:
    return next((row.said for row in rows if row.change == AS_IT_IS), None)


def _changed(rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if row.change not in (AS_IT_IS, WINDOW)]


def table(rows: Sequence[Row]) -> str:
    """By change: of how many flights the verdict flips, cannot be told any more, and its size stays; as Markdown."""
    of_log = {log: [row for row in rows if row.log == log] for log in dict.fromkeys(row.log for row in rows)}
    count: Counter[tuple[str, str]] = Counter()
    for own in of_log.values():
        first = _first(own)
        for row in _changed(own):
            if first is None or row.said is None:
                count[row.change, "failed"] += 1
                continue
            count[row.change, "flights"] += 1
            count[row.change, "told"] += first.side != "cannot_tell"
            count[row.change, "cannot tell"] += row.said.side == "cannot_tell" != first.side
        for row in flips(own):
            count[row.change, "flips"] += 1
        for row, good in sized(own):
            count[row.change, "sized"] += 1
            count[row.change, "within"] += good
    for (_, what), number in list(count.items()):
        count["**all**", what] += number
    lines = ["| change | flights | flips | cannot tell any more | size within 1σ | failed |", "|---" * 6 + "|"]
    for change in (*CHANGES, BOARD, "**all**"):
        if change == AS_IT_IS or not count[change, "flights"] + count[change, "failed"]:
            continue
        told = count[change, "told"]
        shares = (_share(count[change, what], told) for what in ("flips", "cannot tell"))
        size = f"{count[change, 'within']} of {count[change, 'sized']}" if count[change, "sized"] else ""
        parts = (change, str(count[change, "flights"]), *shares, size, str(count[change, "failed"] or ""))
        lines.append(f"| {' | '.join(parts)} |")
    return "\n".join(lines)


def _share(part: int, whole: int) -> str:
    return f"{part} ({part / whole:.0%})" if whole else ""


def window_table(rows: Sequence[Row]) -> str:
    """Of every recording: how often what was said of a window, as Markdown."""
    outcomes: tuple[Outcome, ...] = get_args(Outcome)
    own = [row for row in rows if row.change == WINDOW]
    lines = [f"| {WINDOW} of | windows | {' | '.join(outcomes)} |", "|---" * (2 + len(outcomes)) + "|"]
    for log in (*dict.fromkeys(row.log for row in own), "**all**"):
        these = [row.outcome for row in own if log in (row.log, "**all**")]
        lines.append(f"| {log} | {len(these)} | {' | '.join(str(these.count(one) or '') for one in outcomes)} |")
    return "\n".join(lines) if own else ""


def _words(row: Row) -> str:
    at = "" if row.begin is None else f" from {row.begin:.0f} s"
    said = row.note if row.said is None else f"{row.said.side} {row.said.cause}: {row.said.summary}"
    return f"{row.log}, {row.change}{at}: {said}"


def main() -> int:
    """Print what flips, and the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", type=Path)
    parser.add_argument("--quick", action="store_true", help="two recordings")
    parser.add_argument("--only", action="append", choices=(*CHANGES, BOARD, WINDOW), help="this change; repeatable")
    parser.add_argument("--labels", type=Path, default=HERE / "labels.toml", help="what is known of them")
    parser.add_argument("--workers", type=int, help="processes, default: one for each processor")
    parser.add_argument("--timeout", type=float, default=1800.0, help="seconds for one recording and change")
    parser.add_argument("--json", type=Path, help="write every row there")
    chosen = parser.parse_args()
    paths = logs_of(chosen.logs, QUICK if chosen.quick else STANDARD)
    if not paths:
        parser.error(NO_LOGS)
    labels = load_labels(chosen.labels)
    names = [AS_IT_IS, *(name for name in (*CHANGES, BOARD, WINDOW) if name != AS_IT_IS)]
    if chosen.only:
        names = [name for name in names if name in (AS_IT_IS, *chosen.only)]
    todo = [case for path in paths for case in cases(path, names, labels)]
    rows: list[Row] = []
    for done, (index, result) in enumerate(each(judged, todo, workers=chosen.workers, timeout=chosen.timeout), 1):
        case = todo[index]
        name = name_of(case.path)
        new = [Row(name, case.change, None, note=result.reason)] if isinstance(result, Failed) else result
        rows += new
        print(
            *(f"{done} of {len(todo)}: {_words(row)}" for row in new), sep="\n", end="\n" * bool(new), file=sys.stderr
        )
    for path in paths:
        own = [row for row in rows if row.log == name_of(path)]
        bad = [row for row in own if row.outcome in ("wrong", "missed") or row.said is None]
        lines = [_words(row) for row in own if row.change == AS_IT_IS]
        lines += [f"  flips: {_words(row)}" for row in flips(own)]
        lines += [f"  {row.outcome or 'failed'}: {_words(row)}" for row in bad]
        print("\n".join(lines))
    print(f"\n{table(rows)}\n\n{window_table(rows)}")
    if chosen.json:
        chosen.json.write_bytes(msgspec.json.format(msgspec.json.encode(rows)))
    return 0


def cases(path: Path, names: Sequence[str], labels: Sequence[Label]) -> list[Case]:
    """Every change of a recording; its on-board log where there is one, its windows where there is a label.

    An IMU that is wrong gets no twin, which would be as wrong.
    """
    label = next((one for one in labels if one.matches(name_of(path))), None)
    possible = {
        BOARD: ON_BOARD.get(_unpacked(name_of(path))) is not None,
        WINDOW: label is not None,
        TWIN: label is None or label.truth != "imu",
    }
    return [Case(path, name, label) for name in names if possible.get(name, True)]


if __name__ == "__main__":
    sys.exit(main())
