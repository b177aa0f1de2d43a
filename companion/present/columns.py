"""What the drift tables of terminal, page and report have in common: the quantities and the columns of each."""

from __future__ import annotations

from dataclasses import dataclass, fields

from companion.analysis import Assessment, Drift, Statistic
from companion.present.formats import short

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


@dataclass(frozen=True, slots=True)
class Gain:
    """What the calibration of the first half of a flight changes of the median drift in the second."""

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
