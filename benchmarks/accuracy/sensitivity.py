"""How much a verdict hangs on what no flight tells: `python benchmarks/accuracy/sensitivity.py [LOG_OR_FOLDER ...]`.

The rates of faults are estimates, and the noise model is never quite right. So every labelled recording is judged again
with the prior rates of all faults a tenth and ten times as high, and with half the log evidence. A verdict that changes
hung on that number; a wrong accusation that appears is a number that was too bold. With `--rules` each rule by which
something accuses nobody is taken out alone instead: one without which nothing goes wrong is not needed. Without
arguments: every labelled recording of ../shared/tlogs beside the checkout.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest import mock

import msgspec
import numpy as np

from benchmarks.accuracy.answer import Answer, answer
from benchmarks.accuracy.injected import NO_LOGS, logs_of
from benchmarks.accuracy.labelled import HERE
from benchmarks.accuracy.labels import SHARED, Label, Outcome, load_labels, name_of, outcome, recordings
from benchmarks.accuracy.parallel import Failed, each
from companion.app.recording import read_recording
from companion.constants import check, num, priors
from companion.estimation import BestEstimate, Hypothesis, search, setup, smooth, weighing
from companion.estimation.evidence import Trial, trial
from companion.model import Array, CompanionError, Flight
from companion.verdict import assessment, attribution, constant_faults, deviations
from companion.verdict.fault_interval import EstimatorDeviation, FaultInterval

QUICK = (
    "sitl/copter-demo-100hz.tlog",
    "sitl/copter-imu1-fail-100hz.tlog",
    "sitl/copter-gps-glitch-50hz.tlog",
    "ap_faults/gyrbias_z.tlog.xz",
    "px4_faults/q_accel_step.tlog.xz",
    "real/zlite__PX4_flight_review__3DRFlight_2.ulg.xz",
)
AS_IT_IS = "as it is"


@contextlib.contextmanager
def fault_rates(times: float) -> Iterator[None]:
    """Every prior rate or share of faults so many times as high, in this process."""
    rate_of = Hypothesis.rate_of

    def scaled(kind: Hypothesis, shape: str) -> float:
        return times * rate_of(kind, shape)

    with (
        mock.patch.object(Hypothesis, "rate_of", scaled),
        mock.patch.object(priors, "FAULTY_IMU", times * priors.FAULTY_IMU),
    ):
        yield


@contextlib.contextmanager
def log_evidence(times: float) -> Iterator[None]:
    """The log evidence of every hypothesis multiplied, in this process."""
    constant, misfit = constant_faults.fault_probabilities, weighing.whole_misfit

    def weaker(*args: Any, **keywords: Any) -> Trial:
        one = trial(*args, **keywords)
        return replace(one, log_bayes=times * one.log_bayes)

    def weaker_constant(*args: Any, **keywords: Any) -> Array:
        prior = _log_odds(np.asarray(priors.FAULTY_IMU))
        odds = prior + times * (_log_odds(constant(*args, **keywords)) - prior)
        return np.asarray(1.0 / (1.0 + np.exp(-odds)))

    with (
        mock.patch.object(search, "trial", weaker),
        mock.patch.object(weighing, "whole_misfit", lambda problem: times * misfit(problem)),
        mock.patch.object(constant_faults, "fault_probabilities", weaker_constant),
    ):
        yield


def _log_odds(probability: Array) -> Array:
    p = np.clip(probability, 1e-300, 1.0 - 1e-16)
    return np.asarray(np.log(p) - np.log1p(-p))


def without(where: object, name: str, instead: object) -> Callable[[], AbstractContextManager[object]]:
    """A variant in which what a rule is made of is something else, in this process."""
    return lambda: mock.patch.object(where, name, instead)


def _never(*_: object) -> bool:
    return False


def _begins_after(deviation: EstimatorDeviation, interval: FaultInterval, _: BestEstimate) -> bool:
    return deviation.start >= interval.start - check.NEAR_S - num.SIGMAS * interval.start_sigma


VARIANTS: Mapping[str, Callable[[], AbstractContextManager[object]]] = {
    AS_IT_IS: nullcontext,
    "fault rates × 0.1": lambda: fault_rates(0.1),
    "fault rates × 10": lambda: fault_rates(10.0),
    "log evidence × 0.5": lambda: log_evidence(0.5),
}

RULES: Mapping[str, Callable[[], AbstractContextManager[object]]] = {
    AS_IT_IS: nullcontext,
    "the IMU fits with far more noise than it shows": without(BestEstimate, "contradicted", False),
    "the IMU moved as the autopilot says": without(deviations, "_confirmed_by_imu", _never),
    "a sensor explains a deviation nearly as well": without(attribution, "SENSORS", {}),
    "there since the start of the log": without(attribution, "_since_start", lambda *_: 1.0),
    "compass and IMU turned against each other": without(attribution, "_turned", lambda *_: None),
    "a lag of the attitude": without(deviations, "_lag", lambda error, *_: np.zeros_like(error)),
    "a height or a heading that cannot follow": without(attribution, "follows", _begins_after),
    "folded vibration": without(setup, "aliasing", lambda _: {}),
}
"""Rule → the same without it."""

_OF_THE_ESTIMATE = "folded vibration"  # which is made anew without it


@dataclass(frozen=True, slots=True)
class Row:
    """One flight under one variant."""

    log: str  # below ../shared/tlogs
    flight: str  # SYSID/BOOT
    variant: str
    said: Answer | None  # None: the analysis failed
    outcome: Outcome | None  # None without a label
    note: str = ""


@dataclass(frozen=True, slots=True)
class Case:
    """A recording, and what is tried on it."""

    path: Path
    variants: tuple[str, ...]
    labels: tuple[Label, ...]  # that speak of it


def judged(case: Case) -> list[Row]:
    """Every flight of a recording. One that the analysis fails on does not hide the others."""
    rows = []
    for flight in read_recording(case.path).flights:
        name, known = f"{flight.vehicle.sysid}/{flight.boot}", dict[str, BestEstimate]()
        for variant in case.variants:
            said, note = None, ""
            again = variant in VARIANTS or variant == _OF_THE_ESTIMATE
            try:
                with {**RULES, **VARIANTS}[variant](), nullcontext() if again else _estimated_once(known):
                    said = answer(flight)
            except Exception as error:  # noqa: BLE001  (a failure is a row)
                note = f"{type(error).__name__}: {error}"
            label = next((one for one in case.labels if one.flight in {"", name}), None)
            result = None if label is None or label.truth == "no_flight" else outcome(label, said)
            rows.append(Row(name_of(case.path), name, variant, said, result, note))
    return rows


def _estimated_once(known: dict[str, BestEstimate]) -> AbstractContextManager[object]:
    """Within it the best estimate of a flight is made once for each way in which it is asked for."""

    def remembered(flight: Flight, **how: Any) -> BestEstimate:
        key = repr((sorted(how.items()), len(flight.gps), len(flight.compasses)))
        if key not in known:
            known[key] = smooth(flight, **how)
        return known[key]

    return mock.patch.object(assessment, "smooth", remembered)


@dataclass(frozen=True, slots=True)
class Changed:
    """A verdict that is another one under a variant."""

    before: Row
    after: Row

    @property
    def status(self) -> bool:
        """Whether its status is, and not its cause alone."""
        return _side(self.before) != _side(self.after)

    def __str__(self) -> str:
        judged_as = f" [{self.before.outcome} → {self.after.outcome}]" if self.before.outcome else ""
        return f"{self.before.log} {self.before.flight}: {_words(self.before)} → {_words(self.after)}{judged_as}"


def _side(row: Row) -> str:
    return "failed" if row.said is None else row.said.side


def _words(row: Row) -> str:
    return row.note if row.said is None else f"{row.said.side} {row.said.cause}".strip()


def changes(rows: Sequence[Row]) -> dict[str, list[Changed]]:
    """Variant → what another status or cause is told of than as it is."""
    first = {(row.log, row.flight): row for row in rows if row.variant == AS_IT_IS}
    out: dict[str, list[Changed]] = {row.variant: [] for row in rows if row.variant != AS_IT_IS}
    for row in rows:
        before = first.get((row.log, row.flight))
        if row.variant != AS_IT_IS and before is not None and _words(before) != _words(row):
            out[row.variant].append(Changed(before, row))
    return out


def table(rows: Sequence[Row]) -> str:
    """By variant: how many verdicts change, and how many are right or accuse wrongly, as Markdown; then which."""
    lines = ["| variant | verdicts | status changes | cause alone changes | right | false alarm or inverted |"]
    lines += ["|---" * 6 + "|"]
    changed = changes(rows)
    for name in (AS_IT_IS, *changed):
        own = [row for row in rows if row.variant == name]
        known = [row.outcome for row in own if row.outcome is not None]
        other = changed.get(name, [])
        status = sum(one.status for one in other)
        counts = ("", "") if name == AS_IT_IS else (str(status), str(len(other) - status))
        wrong = sum(result in ("false alarm", "inverted") for result in known)
        right = f"{known.count('right')} of {len(known)}" if known else ""
        lines.append(f"| {name} | {len(own)} | {' | '.join(counts)} | {right} | {wrong or ''} |")
    for name, other in changed.items():
        lines += ["", f"{name}:", *(f"  {one}" for one in other)] if other else []
    return "\n".join(lines)


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", type=Path, help="logs, or folders of them")
    parser.add_argument("--labels", type=Path, default=HERE / "labels.toml", help="what is known of them")
    parser.add_argument("--quick", action="store_true", help="six short recordings")
    parser.add_argument("--rules", action="store_true", help="take out each rule alone")
    parser.add_argument("--workers", type=int, help="processes, default: one for each processor")
    parser.add_argument("--timeout", type=float, default=2400.0, help="seconds for one recording")
    parser.add_argument("--json", type=Path, help="write every row there")
    chosen = parser.parse_args()
    try:
        labels = load_labels(chosen.labels)
    except CompanionError as error:
        parser.error(str(error))
    if chosen.logs or chosen.quick:
        paths = logs_of(chosen.logs, QUICK)
    else:
        paths = [path for path in recordings(SHARED) if labels_of(path, labels)]
    if not paths:
        parser.error(NO_LOGS)
    variants = tuple(RULES if chosen.rules else VARIANTS)
    todo = [Case(path, variants, labels_of(path, labels)) for path in paths]
    rows: list[Row] = []
    for done, (index, result) in enumerate(each(judged, todo, workers=chosen.workers, timeout=chosen.timeout), 1):
        case = todo[index]
        new = _failed(case, result) if isinstance(result, Failed) else result
        rows += new
        said = "; ".join(dict.fromkeys(map(_words, new))) or "no flight"
        print(f"{done} of {len(todo)}: {name_of(case.path)}: {said}", file=sys.stderr)
    print(table(rows))
    if chosen.json:
        chosen.json.write_bytes(msgspec.json.format(msgspec.json.encode(rows)))
    return 0


def _failed(case: Case, failed: Failed) -> list[Row]:
    return [Row(name_of(case.path), "", variant, None, None, failed.reason) for variant in case.variants]


def labels_of(path: Path, labels: Sequence[Label]) -> tuple[Label, ...]:
    """Those that speak of a recording."""
    return tuple(one for one in labels if one.matches(name_of(path)))


if __name__ == "__main__":
    sys.exit(main())
