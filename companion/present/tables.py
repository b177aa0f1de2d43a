"""The tables of drift, IMUs and calibration, built once: terminal and report lay out the same cells."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import groupby

from companion.comparison import PARTS, Calibration, Drift, Expected, RedundantImu, Statistic, left_out
from companion.model import words
from companion.present.formats import percent, short, with_unit
from companion.verdict import Assessment

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


def text_table(titles: Sequence[str], rows: Sequence[tuple[Cell, ...]]) -> Table:
    """A table of words."""
    return Table(tuple(Column(title, is_text=True) for title in titles), tuple(rows))


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


def left_out_lines(drift: Drift) -> Iterator[str]:
    """A line for each horizon that has windows which were not used."""
    for row in drift.rows:
        if row.excluded:
            yield f"Left out of the windows of {row.horizon_s:g} s: {left_out(row.excluded)}"


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


_DEGREES = math.degrees(1.0)


@dataclass(frozen=True, slots=True)
class CalibratedPart:
    """One part of a calibration (`comparison.PARTS`)."""

    title: str
    unit: str  # as people read it
    factor: float  # from SI to that
    digits: int  # decimals
    si: str  # unit of the parameters themselves
    axes: tuple[str, ...] = AXES

    def shown(self, value: float, sigma: float) -> str:
        """A parameter and its standard error, without the unit."""
        return f"{value * self.factor:.{self.digits}f} ± {sigma * self.factor:.{self.digits}f}"


CALIBRATED: Mapping[str, CalibratedPart] = {
    "gyro_bias": CalibratedPart("gyro bias", "mrad/s", 1e3, 2, "rad/s"),
    "accel_bias": CalibratedPart("accelerometer bias", "m/s²", 1.0, 3, "m/s²"),
    "gyro_scale": CalibratedPart("gyro scale", "%", 1e2, 3, ""),
    "accel_scale": CalibratedPart("accelerometer scale", "%", 1e2, 3, ""),
    "gyro_misalignment": CalibratedPart(
        "gyro axes", "°", _DEGREES, 2, "rad", ("xy", "xz", "yx", "yz", "zx", "zy")
    ),
    "accel_misalignment": CalibratedPart("accelerometer axes", "°", _DEGREES, 2, "rad", ("yx", "zx", "zy")),
    "mounting": CalibratedPart("mounting", "°", _DEGREES, 2, "rad"),
    "lever_arm": CalibratedPart("lever arm", "m", 1.0, 3, "m"),
    "time_offset": CalibratedPart("lag", "ms", 1e3, 1, "s", ("",)),
}  # fmt: skip
"""Part → its title, unit and decimals, in the order of the tables."""


def not_observable(fit: Calibration) -> list[str]:
    """The titles of the parts that are not observable in the flight."""
    return [part.title for name, part in CALIBRATED.items() if not fit.score(name)]


def by_best_estimate(fit: Calibration) -> list[str]:
    """The titles of the parts that are determined by the best estimate rather than the windows."""
    return [part.title for name, part in CALIBRATED.items() if fit.observed_by_best(name)]


def level_force(fit: Calibration) -> str:
    """The error of accel z at 1 g, where it cannot be separated into bias and scale; else ""."""
    known = fit.observable[PARTS["accel_bias"]][2] and not fit.observable[PARTS["accel_scale"]][2]
    value, sigma = fit.level_force
    return f"{value:.3f} ± {sigma:.3f} m/s²: bias and scale together" if known else ""


@dataclass(frozen=True, slots=True)
class Gain:
    """The change of the median drift in the second half of a flight by the calibration of the first."""

    windows: int  # of the second half
    by_autopilot: str  # "0.31 → 0.12°, 1.20 → 0.50 m"
    by_best: str  # the same against the best estimate; empty without one

    def __str__(self) -> str:
        return self.by_autopilot + (f"; against the best estimate {self.by_best}" if self.by_best else "")


def held_out_gain(assessment: Assessment) -> Gain | None:
    """None where a half has too few windows."""
    if assessment.uncorrected is None or assessment.corrected is None:
        return None
    by_best = assessment.judged_by_best
    return Gain(
        assessment.corrected.rows[0].windows,
        _change(assessment.uncorrected, assessment.corrected),
        _change(*by_best) if by_best and by_best[1].rows[0].windows else "",
    )


def _change(before: Drift, after: Drift) -> str:
    (one, *_), (other, *_) = before.rows, after.rows
    parts = []
    if one.attitude_deg and other.attitude_deg:
        parts.append(f"{short(one.attitude_deg.median)} → {short(other.attitude_deg.median)}°")
    if one.position_m and other.position_m:
        parts.append(f"{short(one.position_m.median)} → {short(other.position_m.median)} m")
    return ", ".join(parts) or "–"
