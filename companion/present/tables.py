"""The tables of drift and of the IMUs, built once: terminal and report lay out the same cells."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import groupby

from companion.analysis import Assessment, Drift, Expected, RedundantImu, Statistic
from companion.model import words
from companion.present.formats import percent, with_unit

AXES = ("forward", "right", "down")
"""Of the body (FRD), as people read them."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """One quantity that drifts."""

    name: str  # key of the shares of a budget and of the windows inside their bound
    attribute: str  # of a drift row and of what is expected of it; its unit is at the end
    unit: str  # as people read it

    @property
    def title(self) -> str:
        """With its unit."""
        return f"{self.name}, {self.unit}"

    @property
    def after(self) -> str:
        """The unit as it stands after a number."""
        return with_unit("", self.unit)

    def column(self, statistic: str) -> str:
        """The name of a column of `Drift.to_dict`."""
        return f"{self.name}_{statistic}_{self.attribute.removeprefix(self.name + '_')}"


QUANTITIES = (
    Quantity("attitude", "attitude_deg", "°"),
    Quantity("velocity", "velocity_mps", "m/s"),
    Quantity("position", "position_m", "m"),
)
STATISTICS = {column.name: str(column.metadata["heading"]) for column in fields(Statistic)}
"""Statistic of the windows → heading of its column."""


Cell = str | int | float | None
"""Text as it is, a count, a number that is rounded where it is shown, or None where there is none."""


@dataclass(frozen=True, slots=True)
class Column:
    """One column of a table."""

    title: str
    group: str = ""  # of columns that follow one another and have one title above theirs
    is_text: bool = False


@dataclass(frozen=True, slots=True)
class Table:
    """Columns and rows."""

    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]

    @property
    def groups(self) -> Iterator[tuple[str, tuple[int, ...]]]:
        """Title of each group and the places of its columns; a column without a group is alone in one."""
        for (group, _), places in groupby(
            enumerate(self.columns), key=lambda one: (one[1].group, -1 if one[1].group else one[0])
        ):
            yield group, tuple(i for i, _ in places)


def drift_table(
    drift: Drift, expected: Sequence[Expected | None] = (), quantities: Sequence[Quantity] = QUANTITIES
) -> Table:
    """Statistics of the windows of each horizon; beside them what is expected, where that is given."""
    titles = (*STATISTICS.values(), *(["1σ"] if expected else []))
    columns = (Column("after"), Column("windows"), *(Column(title, q.title) for q in quantities for title in titles))
    rows = []
    for i, row in enumerate(drift.rows):
        cells: list[Cell] = [f"{row.horizon_s:g} s", row.windows]
        for quantity in quantities:
            statistic = getattr(row, quantity.attribute)
            cells += [getattr(statistic, key, None) for key in STATISTICS]
            cells += [getattr(expected[i], quantity.attribute, None)] if expected else []
        rows.append(tuple(cells))
    return Table(columns, tuple(rows))


def expected_table(assessment: Assessment) -> Table:
    """What the drift should be, 1σ, and what causes most of it."""
    units = (Column(quantity.unit, "allowed, 1σ") for quantity in QUANTITIES)
    rows = [
        (f"{row.horizon_s:g} s", *(getattr(expected, q.attribute) for q in QUANTITIES), dominant(expected))
        for row, expected in zip(assessment.drift.rows, assessment.expected, strict=True)
        if expected is not None
    ]
    return Table((Column("after"), *units, Column("mostly", is_text=True)), tuple(rows))


def dominant(expected: Expected) -> str:
    """The dominant error source of the position, or of the attitude where there is no position, and its share."""
    shares = expected.shares.get("position", expected.shares["attitude"])
    name = max(shares, key=lambda cause: shares[cause])
    return f"{words(name)} {shares[name]:.0%}"


def agreement_table(assessment: Assessment) -> Table:
    """The share of windows inside the 95 % bound: of the IMU as it is, and as the verdict judges it."""
    names = [quantity.name for quantity in QUANTITIES]
    rows = []
    for row, expected in zip(assessment.drift.rows, assessment.expected, strict=True):
        judged = assessment.agreements[row.horizon_s]
        as_it_is, removed = (_shares(of, names) for of in (expected.inside if expected else {}, judged.inside))
        rows.append((f"{row.horizon_s:g} s", row.windows, *as_it_is, judged.windows, *removed))
    columns = (
        Column(title, group) for group in ("the IMU as it is", "known errors removed") for title in ("n", *names)
    )
    return Table((Column("after"), *columns), tuple(rows))


def redundant_imus_table(others: Sequence[RedundantImu]) -> Table:
    """The IMUs of a flight side by side."""
    titles = ("Hz", "windows", "median °", "median m", "inside 95 %: att.", "pos.")
    rows = []
    for other in others:
        row = other.drift
        medians = (getattr(statistic, "median", None) for statistic in (row.attitude_deg, row.position_m))
        shares = _shares(other.inside, ("attitude", "position"))
        rows.append((other.imu, f"{other.rate_hz:.1f}", row.windows, *medians, *shares))
    return Table((Column("IMU", is_text=True), *map(Column, titles)), tuple(rows))


def _shares(inside: Mapping[str, float], names: Sequence[str]) -> Iterator[Cell]:
    return (percent(inside[name]) if name in inside else None for name in names)
