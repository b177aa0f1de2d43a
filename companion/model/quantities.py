"""What a flight says beside its tracks: any quantity over time, and what happened when.

Ground floor, like `companion.model.tracks`: times are seconds of the vehicle's boot clock, values are SI.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from companion.model.notebook_repr import brief

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """Quantities over time, as columns whose names end in their unit: "x_mps2", "lat_rad", "pressure_pa".

    Raises ValueError for shapes that do not match or times that do not increase.
    """

    __repr__ = brief

    t: Array  # (N,) s, strictly increasing
    values: Array  # (N, k) one column per name; NaN where the vehicle does not know
    columns: tuple[str, ...]
    source: str = ""  # the message or record it came from: "VIBRATION", "BARO[1]"
    instance: int = 0  # which sensor of its kind, where there are several

    def __post_init__(self) -> None:
        if self.values.shape != (len(self.t), len(self.columns)):
            raise ValueError(
                f"{self.source}: {len(self.t)} times and {len(self.columns)} columns, but values {self.values.shape}"
            )
        if not np.isfinite(self.t).all() or not (self.t[1:] > self.t[:-1]).all():
            raise ValueError(f"{self.source}: times must be finite and increase strictly")

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, column: str) -> Array:
        """One column, (N,). Raises KeyError, with the names that there are."""
        if column not in self.columns:
            raise KeyError(f"{self.source} has no column {column!r}; it has {', '.join(self.columns)}")
        return np.asarray(self.values[:, self.columns.index(column)])


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened. The text is untrusted: escape it before it becomes markup."""

    t: float  # s, boot clock
    kind: str  # "armed", "disarmed", "mode", "error" or "event"
    text: str  # the name of the mode, or what happened


def of_kind(series: Mapping[str, Series], kind: str) -> Iterator[Series]:
    """Those of a kind among a flight's, by their keys "kind" or "kind:source"; the others are not even made."""
    return (series[key] for key in series if key.partition(":")[0] == kind)


def nearest(samples: Array, t: Array) -> npt.NDArray[np.intp]:
    """Index of the sample nearest to each t. Needs two samples or more."""
    index = np.clip(np.searchsorted(samples, t), 1, len(samples) - 1)
    return index - (t - samples[index - 1] < samples[index] - t)


def interpolated(t: Array, samples: Array, values: Array) -> Array:
    """(M, n) at the times t (M,): on the lines between values (N, n) at increasing times (N,), and flat beyond them."""
    return np.column_stack([np.interp(t, samples, column) for column in values.T])
