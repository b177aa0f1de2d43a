"""The drift of a flight that is still going on: its table, window by window, and whether the last seconds differ."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from companion.analysis.comparison import Comparison, Part, WindowErrors, compare, edges, errors, grid_origin, windows
from companion.analysis.drift import DriftRow, drift_row
from companion.analysis.findings.stuck import unchanged
from companion.analysis.integration import DEFAULT, Integration
from companion.analysis.reference import length
from companion.constants import check, healthy, num
from companion.model import Array, DataError, Flight, ImuTrack, percentile


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
        return tuple(
            table.row(has_position=self._part is not None and self._part.has_position) for table in self._tables
        )

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
        origin = grid_origin(comparison)
        if origin is None:
            return
        begin = float(comparison.reference.t[np.argmax(comparison.reference.attitude_known)])
        self._begin = float(np.fmin(self._begin, begin))
        if self._part is None or (comparison.has_position and not self._part.has_position):
            self._part = Part(origin, comparison.has_position)
            for table in self._tables:
                earlier = int((origin - self._begin) / table.horizon) - int((origin - begin) / table.horizon)
                table.begin({"no_position": earlier} if earlier else {})
        for table in self._tables:
            table.take(comparison, replace(self._part, before_s=settled_s))


class _Table:
    """The windows of one horizon: anchor, end, and the errors in attitude, velocity and position."""

    def __init__(self, horizon: float) -> None:
        self.horizon = horizon
        self._excluded: Counter[str] = Counter()
        self._errors = np.zeros((0, 11))
        self._next: int | None = None  # edge of the grid
        self._row: dict[bool, DriftRow] = {}  # as it was made last, with a position and without

    def begin(self, excluded: dict[str, int]) -> None:
        self._excluded = Counter(excluded)
        self._errors, self._next = np.zeros((0, 11)), None
        self._row.clear()

    def take(self, comparison: Comparison, part: Part) -> None:
        part = replace(part, first=self._next)
        numbers = edges(comparison, self.horizon, part)
        if len(numbers) < 2:
            return
        self._next = int(numbers[-1])
        self._row.clear()
        chosen = windows(comparison, self.horizon, part)
        self._excluded.update(chosen.excluded)
        e = errors(comparison, chosen)
        new = np.column_stack([e.anchor_s, e.end_s, e.attitude, e.velocity, e.position])
        self._errors = np.concatenate([self._errors, new])[-check.MAX_LIVE_WINDOWS :]

    def row(self, *, has_position: bool) -> DriftRow:
        if has_position not in self._row:  # a page asks for it more often than it changes
            self._row[has_position] = self._made(has_position=has_position)
        return self._row[has_position]

    def _made(self, *, has_position: bool) -> DriftRow:
        e: Array = self._errors
        window_errors = WindowErrors(e[:, 0], e[:, 1], e[:, 2:5], e[:, 5:8], e[:, 8:11])
        return drift_row(self.horizon, dict(self._excluded), window_errors, has_position=has_position)


def newest_stands_out(comparison: Comparison) -> bool:
    """Whether the autopilot's estimate has just stepped, IMU and autopilot part faster than before, or an axis stands.

    It says that something may have begun, not what.
    """
    since = float(comparison.track.t[-1]) - check.LIVE_NEWEST_S
    if any(len(steps) and steps[-1, 1] > since for steps in (comparison.attitude_steps, comparison.position_steps)):
        return True
    if _stands(comparison.track):
        return True
    chosen = windows(comparison, num.AVERAGED_S)
    window_errors = errors(comparison, chosen)
    new = window_errors.end_s > since
    if not new.any() or (~new).sum() < check.LIVE_MIN:
        return False
    parted = [window_errors.attitude, window_errors.velocity] if comparison.has_position else [window_errors.attitude]
    return any(
        float(size[new].max()) > check.LIVE_TIMES * percentile(size[~new], check.LIVE_USUAL)
        for size in map(length, parted)
    )


def _stands(track: ImuTrack) -> bool:
    """Whether an axis has read the same for just so long that it can be judged, and never before for half as long."""
    return any(_has_stopped(track.t, readings) for readings in (track.gyro, track.accel))


def _has_stopped(t: Array, readings: Array) -> bool:
    if len(t) < 2:
        return False
    same = unchanged(readings)
    for axis in range(3):
        moves = np.flatnonzero(~same[:, axis]) + 1  # samples that read otherwise than the one before
        if len(moves) < 2:
            continue
        lasted = float(t[-1] - t[moves[-1]])
        just = healthy.FROZEN_S < lasted < healthy.STUCK_S + check.JUST_S
        if just and float(np.diff(t[moves]).max()) < 0.5 * lasted:
            return True
    return False
