"""The quantities of the drift tables of terminal, page and report, and the columns of each."""

from __future__ import annotations

from dataclasses import dataclass, fields

from companion.analysis import Statistic
from companion.present.formats import with_unit

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
