"""Drift: how far the IMU's dead reckoning is from the autopilot after a horizon, from many anchors.

For each horizon the flight is cut into windows end to end. Each window starts from the autopilot's own state at an IMU
sample (the anchor), is integrated by itself, and is held against the autopilot at its end. This is the relative pose
error (RPE) of trajectory evaluation, with time as the step.

Also here: every IMU of a flight through the same windows; and a flight that is still going on: its table, window by
window, and whether the last seconds differ.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

from companion.comparison.budget import expected_over
from companion.comparison.imu_spec import ImuSpec, ReferenceSpec
from companion.comparison.reference import length
from companion.comparison.spans import unchanged
from companion.comparison.windows import (
    DEFAULT,
    Comparison,
    Integration,
    Part,
    WindowErrors,
    Windows,
    compare,
    edges,
    errors,
    windows,
)
from companion.constants import check, healthy, num
from companion.model import Array, DataError, Flight, ImuTrack, SettingsError, brief, percentile


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
            of_rows = [getattr(row, name) for row in self.rows]
            for part in (column.name for column in fields(Statistic)):
                columns[f"{quantity}_{part}_{unit}"] = [getattr(statistic, part, math.nan) for statistic in of_rows]
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
    flight: Flight, *, horizons: Sequence[float] = num.HORIZONS_S, imu: str | None = None, how: Integration = DEFAULT
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
    comparison = compare(flight, imu=imu, how=how)
    if np.ndim(horizons) != 1 or not len(horizons):
        raise SettingsError(f"horizons must be positive seconds such as (1, 5), got {horizons!r}")
    return drift_over(comparison, [windows(comparison, horizon) for horizon in horizons])


def drift_over(comparison: Comparison, sets: Sequence[Windows]) -> Drift:
    """The drift table over given windows, a row for each set."""
    placed = comparison.has_position
    rows = [_row(one.horizon, one.excluded, errors(comparison, one), has_position=placed) for one in sets]
    how = comparison.how
    return Drift(comparison.track.source, how.method, how.middle, tuple(rows), comparison.path.notes)


def _row(horizon_s: float, excluded: Mapping[str, int], off: WindowErrors, *, has_position: bool) -> DriftRow:
    """The statistics of windows of one length."""
    turned = _statistic(np.degrees(length(off.attitude)))
    speed, place = (_statistic(length(vectors)) if has_position else None for vectors in (off.velocity, off.position))
    return DriftRow(horizon_s, len(off.anchor_s), excluded, turned, speed, place, off)


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
    flight: Flight, compared: Callable[[str], Comparison], spec_of: Callable[[str], ImuSpec], autopilot: ReferenceSpec
) -> tuple[RedundantImu, ...]:
    """Every IMU of the flight with two samples or more, each by its own part's figures."""
    made = []
    for name, track in flight.imus.items():
        if len(track) > 1:
            comparison = compared(name)
            chosen = windows(comparison, num.JUDGED_S)
            expected = expected_over(comparison, chosen, spec_of(name), autopilot)
            inside = {} if expected is None else {k: v for k, v in expected.inside.items() if k != "velocity"}
            (row,), own = drift_over(comparison, [chosen]).rows, comparison.track
            made.append(RedundantImu(own.source, own.instance, own.rate_hz, row, inside))
    return tuple(made)


class RunningDrift:
    """Give `take` the flight's newest seconds now and then: at least the longest horizon and what has come since.

    The windows stand where those of the whole flight stand and are judged by the same functions, so that in the end the
    table is that of `drift` over the whole.
    """

    def __init__(self, horizons: Sequence[float] = num.HORIZONS_S) -> None:
        self._tables = [_Table(horizon) for horizon in horizons]
        self._part: Part | None = None
        self._begin = np.nan  # s, boot clock, the first known attitude

    @property
    def rows(self) -> tuple[DriftRow, ...]:
        """The table so far."""
        placed = self._part is not None and self._part.has_position
        return tuple(table.row(has_position=placed) for table in self._tables)

    def take(
        self, flight: Flight, *, imu: str | None = None, how: Integration = DEFAULT, settled_s: float = np.inf
    ) -> None:
        """Judge the windows that have become complete. settled_s: s, boot clock; what is later may still change.

        A flight whose position is known only now begins anew, because it is judged where it has one.
        """
        try:
            comparison = compare(flight, imu=imu, how=how)
        except DataError:
            return  # not yet, or not any more
        whole = comparison.whole
        if np.isnan(whole.origin_s):
            return
        begin = float(comparison.reference.t[np.argmax(comparison.reference.attitude_known)])
        self._begin = float(np.fmin(self._begin, begin))
        if self._part is None or (comparison.has_position and not self._part.has_position):
            self._part = whole
            for i, horizon in enumerate(table.horizon for table in self._tables):
                earlier = int((whole.origin_s - self._begin) / horizon) - int((whole.origin_s - begin) / horizon)
                self._tables[i] = _Table(horizon, {"no_position": earlier} if earlier else None)
        for table in self._tables:
            table.take(comparison, replace(self._part, before_s=settled_s))


class _Table:
    """The windows of one horizon: anchor, end, and the errors in attitude, velocity and position."""

    def __init__(self, horizon: float, excluded: Mapping[str, int] | None = None) -> None:
        self.horizon = horizon
        self._excluded: Counter[str] = Counter(excluded)
        self._errors = np.zeros((0, 11))
        self._next: int | None = None  # edge of the grid
        self._row: DriftRow | None = None  # as it was made last; a page asks for it more often than it changes

    def take(self, comparison: Comparison, part: Part) -> None:
        part = replace(part, first=self._next)
        numbers = edges(comparison, self.horizon, part)
        if len(numbers) < 2:
            return
        self._next, self._row = int(numbers[-1]), None
        chosen = windows(comparison, self.horizon, part)
        self._excluded.update(chosen.excluded)
        e = errors(comparison, chosen)
        new = np.column_stack([e.anchor_s, e.end_s, e.attitude, e.velocity, e.position])
        self._errors = np.concatenate([self._errors, new])[-check.MAX_LIVE_WINDOWS :]

    def row(self, *, has_position: bool) -> DriftRow:
        """The statistics so far; whether the flight has a position changes with a new table alone."""
        if self._row is None:
            e: Array = self._errors
            window_errors = WindowErrors(e[:, 0], e[:, 1], e[:, 2:5], e[:, 5:8], e[:, 8:11])
            self._row = _row(self.horizon, dict(self._excluded), window_errors, has_position=has_position)
        return self._row


def newest_stands_out(comparison: Comparison) -> bool:
    """Whether the autopilot's estimate has just stepped, IMU and autopilot part faster than before, or an axis stands.

    It says that something may have begun, not what.
    """
    since = float(comparison.track.t[-1]) - check.LIVE_NEWEST_S
    stepped = (len(s) and s[-1, 1] > since for s in (comparison.attitude_steps, comparison.position_steps))
    if any(stepped) or _stands(comparison.track):
        return True
    chosen = windows(comparison, num.AVERAGED_S)
    window_errors = errors(comparison, chosen)
    new = window_errors.end_s > since
    if not new.any() or (~new).sum() < check.LIVE_MIN:
        return False
    parted = [window_errors.attitude, window_errors.velocity] if comparison.has_position else [window_errors.attitude]
    sizes = [length(vectors) for vectors in parted]
    return any(size[new].max() > check.LIVE_TIMES * percentile(size[~new], check.LIVE_USUAL) for size in sizes)


def _stands(track: ImuTrack) -> bool:
    """Whether an axis has read the same for just so long that it can be judged, and never before for half as long."""
    t = track.t
    for moved in (*(~unchanged(track.gyro)).T, *(~unchanged(track.accel)).T):
        moves = np.flatnonzero(moved) + 1  # samples that read otherwise than the one before
        if len(moves) < 2:
            continue
        lasted = float(t[-1] - t[moves[-1]])
        just = healthy.FROZEN_S < lasted < healthy.STUCK_S + check.JUST_S
        if just and float(np.diff(t[moves]).max()) < 0.5 * lasted:
            return True
    return False
