"""The checks before take-off in words and a table: one definition for terminal, report and page."""

from __future__ import annotations

from collections.abc import Sequence

from companion.analysis import Ageing, Check, Preflight
from companion.analysis import percent as probability
from companion.model import words
from companion.present.formats import capitalised, fixed, shown_unit, with_unit
from companion.present.tables import Cell, Column, Table

OUTCOMES = {"go": "go", "no_go": "NO-GO", "unknown": "cannot tell"}
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
    return f"GO: {len(result.checks)} checks within their limits ({span})"


def preflight_table(result: Preflight, aged: Sequence[Ageing] = ()) -> Table:
    """A row for each check, what is wrong first; with what it was before, where that is known."""
    before = {(one.check.name, one.check.sensor): one for one in aged}
    titles = ["", "check", "sensor", "size", "limit", *(["before"] if aged else []), "the autopilot's own check"]
    order = {"no_go": 0, "unknown": 1, "go": 2}
    rows = []
    for one in sorted(result.checks, key=lambda c: order[c.outcome]):
        cells: list[Cell] = [OUTCOMES[one.outcome], capitalised(words(one.name)), one.sensor, _size(one), _limit(one)]
        if aged:
            cells.append(_before(one, before.get((one.name, one.sensor))))
        rows.append((*cells, _autopilot(one)))
    return Table(tuple(Column(title, is_text=True) for title in titles), tuple(rows))


def _size(one: Check) -> str:
    if one.name in _COUNTED or not one.limit:
        return one.note
    unit, factor = _unit(one.unit)
    return with_unit(f"{fixed(one.size * factor)} ± {fixed(one.sigma * factor)}", unit)


def _limit(one: Check) -> str:
    if one.name in _COUNTED or not one.limit:
        return ""
    unit, factor = _unit(one.unit)
    shown = with_unit(fixed(one.limit * factor), unit)
    return shown if one.outcome == "go" else f"{shown} (beyond: {probability(one.probability)})"


def _autopilot(one: Check) -> str:
    if one.autopilot_limit is None:
        return one.autopilot
    unit, factor = _unit(one.unit)
    return f"{one.autopilot} (above {with_unit(fixed(one.autopilot_limit * factor), unit)})"


def _before(one: Check, aged: Ageing | None) -> str:
    if aged is None or one.name in _COUNTED:
        return ""
    _, factor = _unit(one.unit)
    shown = f"{fixed(aged.before * factor)} ± {fixed(aged.spread * factor)} ({aged.times})"
    if one.uncorrected is not None:
        shown = f"{shown}, now {fixed(one.uncorrected * factor)} uncorrected"
    return f"{shown}: changed" if aged.changed else shown


def _unit(unit: str) -> tuple[str, float]:
    return _UNITS.get(unit) or (shown_unit(unit) if unit else ("", 1.0))
