"""`companion analyze LOG --confusion`: the smallest faults, and the confusion matrix of this flight."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from rich.table import Table

from companion.cli.tables import table, wrapped
from companion.estimation import HYPOTHESES, BestEstimate, ConfusionMatrix, Identifiability, hypothesis_of
from companion.model import words
from companion.present import percent, shown_unit, with_unit

_NO_FAULT = ("perhaps harmless", "cannot tell", "nobody")


def confusion_lines(best: BestEstimate | None, width: int) -> Iterator[str | Table]:
    """Both tables; without a best estimate a line that says so."""
    yield ""
    if best is None or best.confusion is None:
        yield "No confusion matrix: no best estimate could be made."
        return
    matrix = best.confusion
    level = float(np.linalg.norm(best.states.constant("earth_field")[:2]))
    yield "[bold]Smallest faults, and what one that is not detected does to the best estimate[/]"
    yield _sizes(matrix, level)
    yield "\n[bold]Confusion matrix: what a fault of the detectable size is called[/]"
    yield _called(matrix)
    yield from _notes(matrix, width)


def _sizes(matrix: ConfusionMatrix, level: float) -> Table:
    """level: of the horizontal Earth field, µT."""
    shown = table("fault", "detectable", "identifiable", "tilt", "heading", "velocity", "position", left=1)
    for row in matrix.rows:
        shown.add_row(
            _fault(row),
            _size(row.kind, row.detectable, level),
            "never" if row.identifiable is None else _size(row.kind, row.identifiable, level),
            f"{_digits(np.degrees(row.tilt))}°",
            f"{_digits(np.degrees(row.heading))}°",
            f"{_digits(row.velocity)} m/s",
            f"{_digits(row.position)} m",
        )
    return shown


def _called(matrix: ConfusionMatrix) -> Table:
    seen = {name for row in matrix.rows for name in row.called}
    names = [name for name in (*(kind.name for kind in HYPOTHESES), *_NO_FAULT) if name in seen]
    shown = table("fault", left=1)
    for name in names:
        shown.add_column(words(name), justify="right")
    for row in matrix.rows:
        shown.add_row(_fault(row), *(percent(row.called[name]) if name in row.called else "" for name in names))
    return shown


def _notes(matrix: ConfusionMatrix, width: int) -> Iterator[str]:
    yield from wrapped(
        f"{matrix.draws} data sets a fault, drawn in the middle of the flight with the noise that was learned from it. "
        "Identifiable: the sensor at fault is accused in 95 % of them. Perhaps harmless: one sensor is known to be "
        "off, but not whether by enough to be a fault.",
        width,
        0,
    )
    if matrix.not_shown:
        yield from wrapped(f"Not detectable at any likely size: {', '.join(map(words, matrix.not_shown))}.", width, 0)


def _fault(row: Identifiability) -> str:
    return f"{words(row.kind)}, {row.lasts:g} s" if row.lasts else words(row.kind)


def _size(name: str, value: float, level: float) -> str:
    """Of a field that turns the angle, as in the verdict."""
    unit = hypothesis_of(name).unit
    if name == "compass_field":
        unit, value = "rad", float(np.arctan(value / max(level, 1e-9)))
    shown, factor = shown_unit(unit)
    return with_unit(_digits(value * factor), shown)


def _digits(value: float) -> str:
    """Two digits, and no less than 0.01."""
    return f"{value:.{max(0, min(2, 1 - int(np.floor(np.log10(max(value, 1e-9))))))}f}"
