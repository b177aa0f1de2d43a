"""Faults injected into real, healthy flights: `python benchmarks/accuracy/injected.py [LOG_OR_FOLDER ...]`.

Without arguments: the standard set of ../shared/tlogs beside the checkout. With them: every flight of those logs,
which have to be healthy; logs of one vehicle lie in one folder, or begin with the same `OWNER__`.

A faulty sensor is followed by the small EKF (ekf.py), whose estimate replaces the recorded one; where the IMU was
logged below 50 Hz, the difference that the fault makes to the EKF is put on the recorded estimate instead, because the
real one had the full rate. A verdict of *consistent* on an estimator that stays within what is harmless, of what it was
without the fault, is "misled nobody". Shares are means over vehicles of the means over their flights.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeVar

import msgspec
import numpy as np

from benchmarks.accuracy import ekf
from benchmarks.accuracy.answer import Answer, answer
from benchmarks.accuracy.cutting import cut, thinned
from benchmarks.accuracy.estimated import replaced, shifted
from benchmarks.accuracy.faults import FAULTS, STATED, Fault, Stated
from benchmarks.accuracy.labels import SHARED, recordings
from benchmarks.accuracy.parallel import Failed, each
from benchmarks.accuracy.power import detectable_table, table
from benchmarks.accuracy.reliability import Claim, reliability
from companion.app.recording import read_recording
from companion.comparison.reference import attitude_error, length
from companion.constants import harm, healthy
from companion.estimation import hypothesis_of
from companion.model import CompanionError, DataError, Flight

STANDARD = (
    "sitl/copter-demo-100hz.tlog",
    "sitl/copter-square-100hz.tlog",
    "ap_witness/clean_cruise.tlog.xz",
    "px4/px4_square_lownoise.ulg",
    "px4/px4_hover_250hz.tlog",
    "real/JAParedes__ulogPX4QuadcopterAnimation__TestFlight1.ulg",
    "real/zlite__PX4_flight_review__3DRFlight_1.ulg.xz",
    "real/zlite__PX4_flight_review__3DRFlight_2.ulg.xz",
    "real/srikanthgoli1__rrc_fault_tolerant_control__good_prop_hover_1.BIN",
    "real/srikanthgoli1__rrc_fault_tolerant_control__good_prop_straight_line_1.BIN",
    "real/spark404__dataflashlog__log.bin",
    "dataflash/sitl__copter-hover-nodrift.BIN",
)
QUICK = (STANDARD[0], STANDARD[5], STANDARD[8])
_SIMULATORS = {
    "sitl": "ArduPilot SITL",
    "ap_witness": "ArduPilot SITL",
    "dataflash": "ArduPilot SITL",
    "px4": "PX4 SIH",
}

NO_LOGS = "there is no such log. Name healthy logs or folders of them."

_LONGEST_S = 100.0  # of a flight that is used
_SHORTEST_S = 25.0
_ONSETS = (0.35, 0.5, 0.65)  # as a share of the flight
_UNSTATED: tuple[Result, ...] = ("cannot tell", "failed")
_EARLY_S = 10.0  # what is said to have begun longer before the fault is not the fault
_ESTIMATES = {False: "none, recorded estimate", True: "none, the EKF's estimate"}  # whether it follows the sensors
_SLOW_HZ, FAST_HZ, _LOW_HZ = 50.0, 95.0, 25.0

Result = Literal["found", "wrong", "missed", "misled nobody", "cannot tell", "early", "failed", "clear", "false alarm"]
_RIGHT: tuple[Result, ...] = ("found", "clear", "misled nobody")


@dataclass(frozen=True, slots=True)
class Case:
    """A flight at one rate, and the faults to inject into it."""

    log: str
    flight: int  # of the log
    vehicle: str
    thin: bool  # to 25 Hz
    faults: tuple[tuple[int, int, float], ...]  # fault, size, onset as a share of the flight; fault -1: untouched


@dataclass(frozen=True, slots=True)
class Drawn:
    """A flight at one rate, and a draw of axes and signs."""

    log: str
    flight: int  # of the log
    vehicle: str
    thin: bool  # to 25 Hz
    seed: int


One = TypeVar("One", Case, Drawn)


@dataclass(frozen=True, slots=True)
class Row:
    """One fault in one flight, and what was said."""

    vehicle: str
    log: str
    rate: str  # "full" or "25 Hz"
    fault: str
    size: float
    result: Result
    said: str  # side and cause
    stated: float | None  # probability, where the verdict states one
    cause_right: bool
    delay_s: float | None  # of the onset that was said
    cpu_s: float


def logs_of(asked: Sequence[Path], standard: Sequence[str]) -> list[Path]:
    """The logs that are there: those asked for and those in the folders among them, by default the standard ones."""
    named = asked or [SHARED / name for name in standard]
    return [p for one in named for p in (recordings(one) if one.is_dir() else [one]) if p.exists()]


def vehicle_of(path: Path) -> str:
    """Whose flight it is: by the simulator, the owner before `__`, or the folder."""
    if path.parent.name in _SIMULATORS and SHARED in path.parents:
        return _SIMULATORS[path.parent.name]
    owner, named, _ = path.name.partition("__")
    return owner if named else path.parent.name


def flown(flight: Flight) -> Flight | None:
    """The part of a flight that is used: the estimator aligned, at most 100 s; None where there is too little."""
    if flight.attitude is None or flight.position is None or not flight.imus:
        return None
    imu, attitude, position = flight.imu(), flight.attitude, flight.position
    begin = max(imu.t[0], attitude.t[0], position.t[0]) + 1.0
    end = min(imu.t[-1], attitude.t[-1], position.t[-1])
    height = position.position[0, 2] - position.position[:, 2]
    aloft = position.t[(np.abs(height) > 1.0) | (np.linalg.norm(position.velocity, axis=1) > 1.0)]
    if len(aloft):
        begin = max(begin, float(aloft[0]) - 15.0)
    end = min(end, begin + _LONGEST_S)
    return cut(flight, begin, end) if end - begin >= _SHORTEST_S else None


def judged(case: Case) -> list[Row]:
    """Every fault of a case."""
    whole = read_recording(case.log).flights[case.flight]
    flight = flown(whole)
    if flight is None:
        return []
    known, healthy = estimator(flight)
    rows = []
    for number, size, share in case.faults:
        if number < 0:
            rows += _untouched(case, flight, None if is_slow(flight) else healthy)
            continue
        fault = FAULTS[number]
        if fault.sensed and known is None:
            continue
        began, before = time.process_time(), fault.made_into(flight)
        try:
            onset, wrong = injected(fault, fault.sizes[size] * fault.scale, before, share)
            if wrong is None:
                continue
            misleads = True
            if fault.sensed and known is not None and healthy is not None:
                begun = ekf.aligned(known, wrong) if fault.throughout and fault.side == "autopilot" else known
                wrong = followed(wrong, flight, begun, healthy)
                misleads = fault.side == "imu" or is_misled(flight if is_slow(flight) else healthy, wrong)
            said: Answer | Failed = answer(as_logged(wrong, thin=case.thin))
        except Exception as error:  # noqa: BLE001  (a failure is a row)
            said = Failed(f"{type(error).__name__}: {error}")
        row = _row(case, fault.name, fault, fault.sizes[size], onset, said, began)
        harmless = row.result == "missed" and not misleads
        rows.append(replace(row, result="misled nobody") if harmless else row)
    return rows


def injected(fault: Fault, size: float, flight: Flight, share: float) -> tuple[float, Flight | None]:
    """The onset, s, and a flight with a fault of a size in SI from a share of it on, or from the next of the onsets.

    At the first at which it shows in what is recorded: None where at none, as of a range that nothing reaches any more.
    """
    for one in sorted({*_ONSETS, share}, key=lambda later: (later < share, later)):
        onset = flight.start + one * flight.duration
        wrong = fault.inject(flight, size, onset)
        if changes(flight, wrong):
            return onset, wrong
    return math.nan, None


def changes(before: Flight, after: Flight) -> bool:
    """Whether a fault changes a reading, or the estimate by more than a healthy one is off by, 1σ."""
    tracks = (*zip(before.gps, after.gps, strict=True), *zip(before.compasses, after.compasses, strict=True))
    if any(one is not other for one, other in tracks):
        return True
    for one, other in zip(before.imus.values(), after.imus.values(), strict=True):
        if not (np.array_equal(one.gyro, other.gyro) and np.array_equal(one.accel, other.accel)):
            return True
    return any(furthest > healthy.AP_SIGMA[quantity] for quantity, furthest in apart(before, after).items())


def is_misled(before: Flight, after: Flight) -> bool:
    """Whether an estimator that reads a faulty sensor is off by what does harm, of what it was without the fault."""
    least = {**harm.AP_ERROR, "position": hypothesis_of("gps_position").min_reported}
    return any(furthest > least[quantity] for quantity, furthest in apart(before, after).items())


def apart(before: Flight, after: Flight) -> dict[str, float]:
    """Quantity → how far two estimates of a flight are apart at most, rad and m, at the times that both have."""
    own, other = before.require_attitude(), after.require_attitude()
    turned = attitude_error(other.q_ned_frd[np.isin(other.t, own.t)], own.q_ned_frd[np.isin(own.t, other.t)])
    moved = np.zeros((1, 3))
    if (first := before.position) is not None and (then := after.position) is not None:
        moved = then.position[np.isin(then.t, first.t)] - first.position[np.isin(first.t, then.t)]
    off = {"tilt": turned[:, :2], "heading": turned[:, 2:], "position": moved[:, :2], "height": moved[:, 2:]}
    return {quantity: float(length(values).max()) for quantity, values in off.items()}


def judged_at_detectable(case: Drawn) -> list[Row]:
    """Each fault at the size that the untouched flight, where it is consistent, says that it would have shown."""
    whole = read_recording(case.log).flights[case.flight]
    flight = flown(whole)
    if flight is None:
        return []
    known, healthy = estimator(flight)
    followed_up = flight if is_slow(flight) or healthy is None else healthy
    random = np.random.default_rng(case.seed)
    rows, untouched = [], {}
    for sensed, name in _ESTIMATES.items():
        began = time.process_time()
        untouched[sensed] = answer(as_logged(followed_up if sensed else flight, thin=case.thin))
        rows.append(_healthy(case, name, untouched[sensed], began))
    for name, fault in STATED.items():
        before = untouched[fault.sensed]
        if before.side != "none" or name not in before.smallest or (fault.sensed and known is None):
            continue
        size, began, middle = before.smallest[name], time.process_time(), flight.start + 0.5 * flight.duration
        try:
            wrong = fault.inject(flight, size, middle, random)
            if fault.sensed:
                wrong = followed(wrong, flight, known, healthy)
            said: Answer | Failed = answer(as_logged(wrong, thin=case.thin))
        except Exception as error:  # noqa: BLE001  (a failure is a row)
            said = Failed(f"{type(error).__name__}: {error}")
        rows.append(_row(case, name, fault, size / fault.scale, middle, said, began))
    return rows


def estimator(flight: Flight) -> tuple[ekf.SetUp | None, Flight | None]:
    """The EKF, and the healthy flight with its estimate; None where the flight has not what it needs."""
    try:
        known = ekf.set_up(flight)
    except DataError:
        return None, None
    return known, replaced(flight, ekf.estimate(flight, known))


def is_slow(flight: Flight) -> bool:
    """Whether its IMU was logged too slowly to run a filter as good as the one on board."""
    return flight.imu().rate_hz < _SLOW_HZ


def followed(wrong: Flight, flight: Flight, known: ekf.SetUp | None, healthy: Flight | None) -> Flight:
    """A flight whose sensors are wrong, with what the EKF makes of them; as it is where there is none.

    flight, known, healthy: before they were, see `estimator`.
    """
    if known is None or healthy is None:
        return wrong
    after = replaced(wrong, ekf.estimate(wrong, known))
    return shifted(wrong, flight, healthy, after) if is_slow(flight) else after


def _untouched(case: Case, flight: Flight, healthy: Flight | None) -> list[Row]:
    rows = []
    for name, one in zip(_ESTIMATES.values(), (flight, healthy), strict=True):
        if one is None:
            continue
        began = time.process_time()
        try:
            said: Answer | Failed = answer(as_logged(one, thin=case.thin))
        except Exception as error:  # noqa: BLE001  (a failure is a row)
            said = Failed(f"{type(error).__name__}: {error}")
        rows.append(_healthy(case, name, said, began))
    return rows


def _healthy(case: Case | Drawn, name: str, said: Answer | Failed, began: float) -> Row:
    results: dict[str, Result] = {"none": "clear", "cannot_tell": "cannot tell"}
    result = "failed" if isinstance(said, Failed) else results.get(said.side, "false alarm")
    return _made(case, name, 0.0, result, said, None, began, cause=False)


def _row(
    case: Case | Drawn,
    name: str,
    fault: Fault | Stated,
    size: float,
    onset: float,
    said: Answer | Failed,
    began: float,
) -> Row:
    if isinstance(said, Failed):
        return _made(case, name, size, "failed", said, None, began, cause=False)
    throughout = isinstance(fault, Fault) and fault.throughout
    delay = None if said.onset is None or throughout else float(said.onset - onset)
    others: dict[str, Result] = {"none": "missed", "cannot_tell": "cannot tell"}
    result: Result = others.get(said.side, "wrong")
    if said.side == fault.side:
        result = "early" if delay is not None and delay < -_EARLY_S else "found"
    cause = said.cause in fault.causes
    return _made(case, name, size, result, said, delay, began, cause=cause)


def _made(
    case: Case | Drawn,
    name: str,
    size: float,
    result: Result,
    said: Answer | Failed,
    delay: float | None,
    began: float,
    *,
    cause: bool,
) -> Row:
    rate, cpu = "25 Hz" if case.thin else "full", time.process_time() - began
    words, stated = (said.reason, None) if isinstance(said, Failed) else (f"{said.side} {said.cause}", said.stated)
    return Row(case.vehicle, case.log, rate, name, size, result, words, stated, cause, delay, cpu)


def as_logged(flight: Flight, *, thin: bool) -> Flight:
    return thinned(flight, _LOW_HZ) if thin and flight.imu().rate_hz >= FAST_HZ else flight


def _at_each_rate(paths: Sequence[Path]) -> Iterator[tuple[str, int, str, bool]]:
    """Log, flight, vehicle, and whether it is thinned to 25 Hz."""
    for path in paths:
        try:
            flights = read_recording(path).flights
        except CompanionError as error:
            print(f"{path.name}: {error}", file=sys.stderr)
            continue
        for number, flight in enumerate(flights):
            if flight.imus:
                for thin in [False] * (flight.imu().rate_hz >= FAST_HZ) + [True]:
                    yield str(path), number, vehicle_of(path), thin


def cases(paths: Sequence[Path], *, sizes: Literal["all", "middle"], shift: int = 0, only: str = "") -> list[Case]:
    """Every flight at its full rate and at 25 Hz, with every fault; onsets go round, from another one with `shift`.

    only: a part of the names of faults that are taken.
    """
    every_case: list[Case] = []
    for flight in _at_each_rate(paths):
        chosen = [] if only else [(-1, 0, 0.0)]
        for i, fault in enumerate(FAULTS):
            if only in fault.name:
                some = range(len(fault.sizes)) if sizes == "all" else [fault.middle]
                chosen += [(i, k, _ONSETS[(len(every_case) + i + k + shift) % len(_ONSETS)]) for k in some]
        every_case += [Case(*flight, tuple(half)) for half in (chosen[::2], chosen[1::2]) if half]
    return every_case


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", type=Path, help="healthy logs, or folders of them")
    parser.add_argument("--quick", action="store_true", help="three flights and one size of each fault")
    parser.add_argument("--sizes", choices=("all", "middle"), default="all", help="of each fault (default: all)")
    parser.add_argument("--only", default="", help="faults with this in their names")
    parser.add_argument("--shift", type=int, default=0, help="1 or 2: each fault at another of the three onsets")
    parser.add_argument(
        "--at-detectable", action="store_true", help="faults of the size that each untouched flight would have shown"
    )
    parser.add_argument("--draws", type=int, default=3, help="of axis and sign, with --at-detectable (default: 3)")
    parser.add_argument("--vehicle", action="append", help="only this one; may be repeated")
    parser.add_argument("--workers", type=int, help="processes, default: one for each processor")
    parser.add_argument("--timeout", type=float, default=1200.0, help="seconds for one flight")
    parser.add_argument("--json", type=Path, help="write every row there")
    chosen = parser.parse_args()
    paths = [
        p
        for p in logs_of(chosen.logs, QUICK if chosen.quick else STANDARD)
        if not chosen.vehicle or vehicle_of(p) in chosen.vehicle
    ]
    if not paths:
        parser.error(NO_LOGS)
    if chosen.at_detectable:
        drawn = [Drawn(*flight, seed) for flight in _at_each_rate(paths) for seed in range(chosen.draws)]
        rows = _run(judged_at_detectable, drawn, chosen)
        print(detectable_table(rows, {name: one.unit for name, one in STATED.items()}))
    else:
        chosen.sizes = "middle" if chosen.quick else chosen.sizes
        rows = _run(judged, cases(paths, sizes=chosen.sizes, shift=chosen.shift, only=chosen.only), chosen)
        print(table(rows, {fault.name: fault.unit for fault in FAULTS}))
    claims = [
        Claim(r.vehicle, r.stated, r.result in _RIGHT, r.result not in ("missed", "misled nobody", "clear"))
        for r in rows
        if r.result not in _UNSTATED
    ]
    print(f"\n{reliability(claims)}\n")
    print(f"{len(rows)} verdicts, {sum(row.cpu_s for row in rows):.0f} s of CPU")
    if chosen.json:
        chosen.json.write_bytes(msgspec.json.format(msgspec.json.encode(rows)))
    return 0


def _run(judge: Callable[[One], list[Row]], todo: Sequence[One], chosen: argparse.Namespace) -> list[Row]:
    rows: list[Row] = []
    for done, (index, result) in enumerate(each(judge, todo, workers=chosen.workers, timeout=chosen.timeout), 1):
        name = Path(todo[index].log).name
        if isinstance(result, Failed):
            print(f"{done} of {len(todo)}: {name}: {result.reason}", file=sys.stderr)
        else:
            rows += result
            print(f"{done} of {len(todo)}: {name}", file=sys.stderr)
            for row in result:
                print(f"  {row.rate}, {row.fault} {row.size:.3g}: {row.result}, {row.said}", file=sys.stderr)
    return rows


if __name__ == "__main__":
    sys.exit(main())
