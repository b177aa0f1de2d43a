"""The baseline of `companion check`: how far the IMU drifted and what was detectable in flights of one kind."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from companion.app import destination
from companion.app.examination import Examination
from companion.documents import SCHEMA
from companion.model import InputError
from companion.present import QUANTITIES

Measures = Mapping[str, float]
"""What a flight is compared by, the smaller the better: "detectable gyro_bias", "drift 10 s position_m". SI, °."""


class BaselineFlight(msgspec.Struct, frozen=True):
    """One flight of the baseline; limits that somebody sets by hand are one too."""

    measures: dict[str, float]
    log: str = ""
    vehicle: str = ""
    boot: int = 1


class Baseline(msgspec.Struct, frozen=True):
    """The file. The worst of its flights is the limit: of N alike, one more is worse than all in 1 of N + 1 cases."""

    flights: tuple[BaselineFlight, ...]
    schema: int = SCHEMA

    @property
    def limits(self) -> Measures:
        """The largest of each measure."""
        names = dict.fromkeys(name for flight in self.flights for name in flight.measures)
        return {name: max(f.measures[name] for f in self.flights if name in f.measures) for name in names}

    @property
    def always(self) -> frozenset[str]:
        """The measures that every flight of it has."""
        return frozenset(self.limits).intersection(*(flight.measures for flight in self.flights))


@dataclass(frozen=True, slots=True)
class Compared:
    """One measure of a flight beside the baseline's worst."""

    name: str
    value: float | None  # None: this flight does not have it
    limit: float
    is_worse: bool

    def __str__(self) -> str:
        if self.value is None:
            return f"not known of this flight, {self.limit:.3g} in the baseline"
        change = f", {100 * (self.value / self.limit - 1):+.0f} %" if self.limit > 0 else ""
        return f"{self.value:.3g}, at most {self.limit:.3g} in the baseline{change}"


def measures_of(examined: Examination) -> Measures:
    """The detectable size of each fault, and the median drift at each horizon."""
    could, rows = examined.assessment.sensitivity.smallest, examined.assessment.drift.rows
    drift = {
        f"drift {row.horizon_s:g} s {quantity.attribute}": statistic.median
        for row in rows
        for quantity in QUANTITIES
        if (statistic := getattr(row, quantity.attribute)) is not None
    }
    return {f"detectable {kind}": size for kind, size in could.items()} | drift


def compared(measures: Measures, baseline: Baseline, tolerance: float) -> Iterator[Compared]:
    """Each measure of the baseline. One is worse when it is larger by more than the tolerance (0.1 is 10 %).

    So is one that every flight of the baseline has and this one lacks.
    """
    for name, limit in baseline.limits.items():
        value = measures.get(name)
        if value is not None or name in baseline.always:
            yield Compared(name, value, limit, value is None or value > limit * (1.0 + tolerance))


def read_baseline(path: str) -> Baseline:
    """Raises InputError for a file that cannot be read or is no baseline."""
    try:
        baseline = msgspec.json.decode(Path(path).read_bytes(), type=Baseline)
    except OSError as error:
        raise InputError(f"cannot read the baseline {path}: {error.strerror}. Write one: --write-baseline.") from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path} is no baseline: {error}. Write one: --write-baseline.") from None
    if not baseline.limits:
        raise InputError(f"the baseline {path} has no measures: it would let everything pass.")
    return baseline


def write_baseline(path: Path, flights: Sequence[BaselineFlight]) -> None:
    """Raises InputError where there is nothing to write, or no place."""
    if not flights:
        raise InputError("no baseline written: none of the flights could be examined.")
    with destination.replacing(path) as part:
        part.write_bytes(msgspec.json.format(msgspec.json.encode(Baseline(tuple(flights))), indent=2) + b"\n")
