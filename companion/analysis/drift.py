"""Drift: how far the IMU's dead reckoning is from the autopilot after a horizon, from many anchors.

For each horizon the flight is cut into windows end to end. Each window starts from the autopilot's own state at an IMU
sample (the anchor), is integrated by itself, and is held against the autopilot at its end. This is the relative pose
error (RPE) of trajectory evaluation, with time as the step.

Also here: every IMU of a flight through the same windows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from companion.analysis.budget import ATTITUDE, POSITION, budget, nees, stacked
from companion.analysis.comparison import Comparison, WindowErrors, Windows, compare, errors, windows
from companion.analysis.imu_spec import ImuSpec, ReferenceSpec
from companion.analysis.integration import DEFAULT, Integration
from companion.analysis.reference import length
from companion.constants import num
from companion.estimation import chi_square
from companion.model import Array, Flight, SettingsError, brief


def _percentile(percent: float, heading: str) -> float:
    """A column of the drift table: which percentile of the windows it is, and what people read above it."""
    return field(metadata={"percent": percent, "heading": heading})  # type: ignore[no-any-return]


@dataclass(frozen=True, slots=True)
class Statistic:
    """Statistics of an error's length over windows: the columns of the drift table, wherever it is shown."""

    __repr__ = brief

    median: float = _percentile(50.0, "median")
    p95: float = _percentile(95.0, "95 %")
    max: float = _percentile(100.0, "worst")


@dataclass(frozen=True, slots=True, eq=False)
class DriftRow:
    """Drift at one horizon: None where no window was used, or (velocity, position) the flight has no position."""

    __repr__ = brief

    horizon_s: float
    windows: int  # used
    excluded: Mapping[str, int]  # windows left out, by reason
    attitude_deg: Statistic | None
    velocity_mps: Statistic | None
    position_m: Statistic | None
    errors: WindowErrors


@dataclass(frozen=True, slots=True, eq=False)
class Drift:
    """The drift table of a flight, and with what it was made."""

    imu: str
    method: str
    middle: str
    rows: tuple[DriftRow, ...]
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, list[float]]:
        """The table by columns, NaN where there is no figure: what `pandas.DataFrame` and `polars.DataFrame` take.

        >>> import companion as c
        >>> flight = c.open_log("tlogs/copter-demo-100hz.tlog")[0]
        >>> table = c.drift(flight, horizons=(5, 10)).to_dict()
        >>> table["horizon_s"], [f"{x:.2f}" for x in table["position_median_m"]]
        ([5.0, 10.0], ['0.21', '0.99'])
        """
        columns: dict[str, list[float]] = {
            "horizon_s": [row.horizon_s for row in self.rows],
            "windows": [row.windows for row in self.rows],
            "excluded": [sum(row.excluded.values()) for row in self.rows],
        }
        for name in ("attitude_deg", "velocity_mps", "position_m"):
            quantity, unit = name.split("_")
            for part in (column.name for column in fields(Statistic)):
                columns[f"{quantity}_{part}_{unit}"] = [
                    math.nan if (statistic := getattr(row, name)) is None else getattr(statistic, part)
                    for row in self.rows
                ]
        return columns

    def __repr__(self) -> str:
        """The medians, as a notebook shows them."""
        lines = []
        for row in self.rows:
            statistics = ((row.attitude_deg, "°"), (row.velocity_mps, " m/s"), (row.position_m, " m"))
            medians = ", ".join(f"{s.median:.3g}{unit}" for s, unit in statistics if s is not None) or "no window"
            lines.append(f"{row.horizon_s:g} s: {medians}")
        shown = [*lines[:4], f"... {len(lines)} horizons"] if len(lines) > 5 else lines
        return f"Drift of {self.imu} ({self.method}), median of the windows after " + ";\n  ".join(shown)


def drift(
    flight: Flight,
    *,
    horizons: Sequence[float] = num.HORIZONS_S,
    imu: str | None = None,
    how: Integration = DEFAULT,
) -> Drift:
    """The drift of the flight's IMU against its autopilot after each horizon (s).

    Windows with a gap in the IMU samples, with an unknown state at an end, or over a jump of the autopilot's attitude
    or position are left out and counted. A flight that has a position is judged where it has one: before, the
    estimator is still starting up. One without any is compared in attitude alone. One pass over the samples serves
    every window.

    Raises DataError when the flight has no usable IMU or no attitude, SettingsError for an unknown method or a horizon
    that is not positive.

    >>> import companion as c
    >>> flight = c.open_log("tlogs/copter-demo-100hz.tlog")[0]
    >>> (row,) = c.drift(flight, horizons=(5,), how=c.Integration(method="midpoint")).rows
    >>> row.windows, f"{row.attitude_deg.median:.3f}°", f"{row.position_m.max:.2f} m"
    (20, '0.165°', '0.91 m')
    >>> row.errors.position.shape  # autopilot minus IMU at the end of each window, NED, m
    (20, 3)
    """
    return drift_of(compare(flight, imu=imu, how=how), horizons)


def drift_of(comparison: Comparison, horizons: Sequence[float] = num.HORIZONS_S) -> Drift:
    """The drift table of a comparison. Raises SettingsError for a horizon that is not positive, and for none."""
    if np.ndim(horizons) != 1 or not len(horizons):
        raise SettingsError(f"horizons must be positive seconds such as (1, 5), got {horizons!r}")
    return drift_over(comparison, [windows(comparison, horizon) for horizon in horizons])


def drift_over(comparison: Comparison, sets: Sequence[Windows]) -> Drift:
    """The drift table over given windows, a row for each set."""
    rows = tuple(
        drift_row(chosen.horizon, chosen.excluded, errors(comparison, chosen), has_position=comparison.has_position)
        for chosen in sets
    )
    return Drift(comparison.track.source, comparison.how.method, comparison.how.middle, rows, comparison.path.notes)


def drift_row(
    horizon_s: float, excluded: Mapping[str, int], window_errors: WindowErrors, *, has_position: bool
) -> DriftRow:
    """The statistics of windows of one length."""
    return DriftRow(
        horizon_s=horizon_s,
        windows=len(window_errors.anchor_s),
        excluded=excluded,
        attitude_deg=_statistic(np.degrees(length(window_errors.attitude))),
        velocity_mps=_statistic(length(window_errors.velocity)) if has_position else None,
        position_m=_statistic(length(window_errors.position)) if has_position else None,
        errors=window_errors,
    )


def _statistic(values: Array) -> Statistic | None:
    if not len(values):
        return None
    return Statistic(*np.percentile(values, [column.metadata["percent"] for column in fields(Statistic)]).tolist())


@dataclass(frozen=True, slots=True, eq=False)
class RedundantImu:
    """One IMU of several."""

    imu: str
    instance: int
    rate_hz: float
    drift: DriftRow  # after 5 s
    inside: Mapping[str, float]  # attitude, position → share of windows inside the 95 % bound; empty without windows


def each_imu(
    flight: Flight,
    compare_imu: Callable[[str], Comparison],
    imu_spec_of: Callable[[str], ImuSpec],
    autopilot: ReferenceSpec,
) -> tuple[RedundantImu, ...]:
    """Every IMU of the flight with two samples or more, each by its own part's figures."""
    return tuple(
        _redundant(compare_imu(name), imu_spec_of(name), autopilot)
        for name, track in flight.imus.items()
        if len(track) > 1
    )


def _redundant(comparison: Comparison, imu_spec: ImuSpec, autopilot: ReferenceSpec) -> RedundantImu:
    chosen = windows(comparison, num.JUDGED_S)
    inside: dict[str, float] = {}
    if len(chosen.start):
        total = budget(comparison, chosen, imu_spec, autopilot).total
        error = stacked(comparison, chosen)
        blocks = {"attitude": ATTITUDE, "position": POSITION} if comparison.has_position else {"attitude": ATTITUDE}
        inside = {
            name: float(np.mean(nees(error[:, b], total[:, b, b]) < chi_square(3, num.Z_95)))
            for name, b in blocks.items()
        }
    row = drift_of(comparison, (num.JUDGED_S,)).rows[0]
    track = comparison.track
    return RedundantImu(track.source, track.instance, track.rate_hz, row, inside)
