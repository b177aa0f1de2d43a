"""The lanes of an estimator, and the checks before take-off, in words and tables for terminal, report and page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

from companion.model import words
from companion.present.formats import capitalised, fixed, plus_minus, shown_unit, with_unit
from companion.present.tables import Table, text_table
from companion.verdict import FLOWN, Ageing, Check, LaneInSpan, Lanes, LaneSpan, LaneSwitch, Preflight
from companion.verdict import percent as probability

_SWITCHED = {
    "right": "right",
    "wrong": "wrong",
    "indifferent": "made no difference that matters",
    "undecided": "cannot be told",
}


def lane_lines(lanes: Lanes, *, in_table: bool = False) -> Iterator[str]:
    """What is to be said of them, a sentence each: untrusted nowhere, as all names are ours.

    in_table: whether a table below has what each lane would have done.
    """
    named = (one.name + ("" if one.imu is None else f" (IMU {one.imu})") for one in lanes.lanes)
    yield f"Lanes: {', '.join(named)}"
    yield from judgement_lines(lanes)
    if lanes.spans and not in_table:
        yield from counterfactual_words(lanes.spans[0])
    yield from (f"Note: {note}" for note in lanes.notes)


def judgement_lines(lanes: Lanes) -> Iterator[str]:
    """Which lane flew, each switch, and which lane should have flown: without the numbers of the tables."""
    if (flown := flown_words(lanes)) != "":
        yield f"Flown: {flown}"
    yield from map(switch_words, lanes.switches)
    for span in lanes.spans[1:]:
        yield f"{capitalised(words(span.what))}, {span.start_s:.1f}-{span.end_s:.1f} s: {span_words(span)}"
    if lanes.spans:
        yield f"Whole flight: {span_words(lanes.spans[0])}"


def flown_words(lanes: Lanes) -> str:
    """Which lane flew from when on."""
    if lanes.in_use is None:
        return ""
    names = {one.core: one.name for one in lanes.lanes if one.core is not None}
    changes = [(t, names.get(core, f"core {core}")) for t, core in lanes.in_use.changes]
    parts = (f"{name} {t:.1f}-{end:.1f} s" for (t, name), (end, _) in pairwise(changes))
    t, name = changes[-1]
    return ", ".join([*parts, f"{name} from {t:.1f} s to the end"])


def switch_words(one: LaneSwitch) -> str:
    """A change of lane, judged: "Switch at 69.7 s to EKF3 core 1: right, ..."."""
    sentence = f"Switch at {one.t:.1f} s from {one.before} to {one.after}: {_SWITCHED[one.judgement]}"
    if one.probability is None:
        return f"{sentence}: {one.why}"
    left, taken = (_size(size, one.sigma, one.quantity) for size in (one.before_size, one.after_size))
    sentence += (
        f" ({probability(one.probability)} that it is nearer to the truth): until {one.end_s:.1f} s {one.before} was "
        f"{left} off in {one.quantity}, {one.after} {taken}"
    )
    if one.reset_s is not None:
        sentence += f"; {one.after} had announced a reset {one.reset_s:.1f} s before"
    return sentence


def span_words(span: LaneSpan) -> str:
    """Which lane should have flown, in a clause."""
    off = [one for one in span.lanes if one.off]
    as_good = f", and {', '.join(span.as_good)} as good" if span.as_good else ""
    sentence = (
        f"{span.right} was the right lane{as_good}" if span.right else "no lane that flew was off by what matters"
    )
    if not span.right and {one.lane for one in off} & {*span.flown, FLOWN}:
        sentence = "another lane was nearer, but which is the nearest cannot be told"
    elif sum(one.nearest is not None for one in span.lanes) < 2:
        sentence = "there is no other lane to compare with"
    elif not span.flown:
        sentence = "which of the lanes flew is not known"
    sentence += "".join(f"; {one.lane} was off by {_worst(one)}" for one in off)
    if span.readers is not None:
        others = [one.lane for one in span.lanes if one.lane not in span.readers and one.nearest is not None]
        spared = f", not by {', '.join(others)}" if others else ": no lane escapes it"
        sentence += f"; that sensor is read by {', '.join(span.readers) or 'none of the lanes'}{spared}"
    return sentence


def counterfactual_words(span: LaneSpan) -> Iterator[str]:
    """How far off each lane would have been had it been flown: a line for each."""
    for one in span.lanes:
        within = ", ".join(f"{_size(e.p95, e.sigma, e.quantity)} in {e.quantity}" for e in one.errors)
        verb = "stayed" if one.lane == FLOWN or span.flown == (one.lane,) else "would have stayed"
        yield f"{one.lane}: {verb} within {within} for 95 % of it"


def lane_table(span: LaneSpan) -> Table:
    """A row for each lane: the 95 % of its errors, and how likely it is the nearest."""
    quantities = {e.quantity: shown_unit(e.unit) for one in span.lanes for e in one.errors}
    titles = ["lane", "flown", "nearest", *(f"{name}, {unit}" for name, (unit, _) in quantities.items()), ""]
    rows = []
    for one in span.lanes:
        errors = {e.quantity: e for e in one.errors}
        flown = "yes" if one.lane in (*span.flown, FLOWN) else ""
        cells = [one.lane, flown, "-" if one.nearest is None else probability(one.nearest)]
        cells += [
            plus_minus(e.p95 * factor, e.sigma * factor) if (e := errors.get(name)) is not None else "-"
            for name, (_, factor) in quantities.items()
        ]
        rows.append((*cells, "off" if one.off else ""))
    return text_table(titles, rows)


def _worst(one: LaneInSpan) -> str:
    """The error of a lane that is largest beside what the best estimate itself may be off by."""
    worst = max(one.errors, key=lambda e: e.rms / e.sigma)
    return f"{_size(worst.rms, worst.sigma, worst.quantity)} in {worst.quantity}"


def _size(value: float, sigma: float, quantity: str) -> str:
    unit, factor = shown_unit({"tilt": "rad", "heading": "rad", "velocity": "m/s"}.get(quantity, "m"))
    if not math.isfinite(value):
        return "unknown"
    return with_unit(plus_minus(value * factor, sigma * factor), unit)


OUTCOMES = {"no_go": "NO-GO", "unknown": "cannot tell", "go": "go"}
"""Outcome → in words, what is wrong first."""
_UNITS = {"T": ("µT", 1e6), "rad/s/√Hz": ("mrad/s/√Hz", 1e3)}
_COUNTED = ("gps_fix", "gps_satellites", "barometer_temperature")
"""Checks whose note has the number that people know."""


def preflight_headline(result: Preflight) -> str:
    """The answer in a sentence."""
    bad = [f"{words(one.name)} of {one.sensor}" for one in result.checks if one.outcome == "no_go"]
    doubtful = [f"{words(one.name)} of {one.sensor}" for one in result.checks if one.outcome == "unknown"]
    span = f"stood {result.start_s:.1f}-{result.end_s:.1f} s, motors {'off' if result.motors_off else 'perhaps on'}"
    if bad:
        return f"NO-GO: {', '.join(bad)} ({span})"
    if doubtful:
        return f"Cannot tell: {', '.join(doubtful)}; the rest is go ({span})"
    within = f"{len(result.checks)} checks within their limits"
    if result.refuses:
        return f"Cannot tell: the vehicle itself refuses to arm; {within} ({span})"
    return f"GO: {within} ({span})"


def preflight_table(result: Preflight, aged: Sequence[Ageing] = ()) -> Table:
    """A row for each check, what is wrong first; with what it was before, where that is known."""
    before = {(one.check.name, one.check.sensor): one for one in aged}
    titles = ["", "check", "sensor", "size", "limit", *(["before"] if aged else []), "the autopilot's own check"]
    rows = []
    for one in sorted(result.checks, key=lambda check: [*OUTCOMES].index(check.outcome)):
        cells = [OUTCOMES[one.outcome], capitalised(words(one.name)), one.sensor, *_size_and_limit(one)]
        if aged:
            cells.append(_before(one, before.get((one.name, one.sensor))))
        rows.append((*cells, _autopilot(one)))
    return text_table(titles, rows)


def _size_and_limit(one: Check) -> tuple[str, str]:
    if one.name in _COUNTED or not one.limit:
        return one.note, ""
    unit, factor = _unit(one.unit)
    beyond = "" if one.outcome == "go" else f" (beyond: {probability(one.probability)})"
    return with_unit(plus_minus(one.size * factor, one.sigma * factor), unit), with_unit(
        fixed(one.limit * factor), unit
    ) + beyond


def _autopilot(one: Check) -> str:
    if one.autopilot_limit is None:
        return one.autopilot
    unit, factor = _unit(one.unit)
    return f"{one.autopilot} (above {with_unit(fixed(one.autopilot_limit * factor), unit)})"


def _before(one: Check, aged: Ageing | None) -> str:
    if aged is None or one.name in _COUNTED:
        return ""
    _, factor = _unit(one.unit)
    shown = f"{plus_minus(aged.before * factor, aged.spread * factor)} ({aged.times})"
    if one.uncorrected is not None:
        shown = f"{shown}, now {fixed(one.uncorrected * factor)} uncorrected"
    return f"{shown}: changed" if aged.changed else shown


def _unit(unit: str) -> tuple[str, float]:
    return _UNITS.get(unit) or (shown_unit(unit) if unit else ("", 1.0))
