"""What a live page has shown, for as long as its charts and trails reach back."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from companion.analysis import FreeState, Replay
from companion.model import Array
from companion.view.state.trajectory import MOST, DisplayTrajectory, Errors, display_trajectory

_REPLAYED = {
    "q_imu": 4, "velocity_imu": 3, "position_imu": 3, "q_ref": 4, "velocity_ref": 3, "position_ref": 3,
    "attitude_error": 3, "velocity_error": 3, "position_error": 3,
}  # fmt: skip
_CHARTED = {"t": 1, "valid": 1, "errors": 4, "free": 4, "anchor": 1}
_WIDTHS = _CHARTED | _REPLAYED | {"free_position": 3, "free_anchor": 1}
_STARTS = np.cumsum([0, *_WIDTHS.values()])
_SLICES = {name: slice(a, b) for name, a, b in zip(_WIDTHS, _STARTS[:-1], _STARTS[1:], strict=True)}
"""The columns of a row."""

_GAP_S = 1.0  # between two rows: the link was silent


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """The errors of what was shown, for charts."""

    errors: Errors  # since the last anchor, at (N,) s before the last row, which is 0
    free: Errors  # of the free run; NaN where there is none
    age: Array  # (N,) s since the last anchor
    known: npt.NDArray[np.bool_]  # (N,) whether there was an autopilot's state to compare with
    has_position: bool


@dataclass(frozen=True, slots=True, eq=False)
class Past:
    """A stretch of what was shown. Times are seconds before its end: 0 is the last row."""

    display: DisplayTrajectory
    curves: Curves
    free: Array  # (N, 4) the free run's errors at the samples: tilt and heading °, velocity m/s, position m
    free_position: Array  # (N, 3) NED, m
    free_anchor: Array  # (N,) s, boot clock
    end: float  # s, boot clock, of the last row


class History:
    """The newest rows of everything shown, of one boot of one vehicle. Its memory is taken once and never grows."""

    def __init__(self, seconds: float, rate_hz: float) -> None:
        self._period = 1.0 / rate_hz
        self._rows = np.full((max(int(seconds * rate_hz), 2), sum(_WIDTHS.values())), np.nan)
        self._count = 0  # rows written ever
        self._has_position = False

    def __len__(self) -> int:
        return min(self._count, len(self._rows))

    def clear(self) -> None:
        """Forget everything."""
        self._count = 0

    def add(self, replay: Replay, free: FreeState | None) -> bool:
        """Keep what the replay ends with; whether that is worth a row."""
        t = float(replay.t[-1])
        last = self._rows[(self._count - 1) % len(self._rows), 0] if self._count else -np.inf
        if t < last + 0.9 * self._period:
            return False
        row = self._rows[self._count % len(self._rows)]
        row[:] = np.nan
        row[0] = t
        row[_SLICES["anchor"]] = replay.anchors[np.searchsorted(replay.anchors, t, side="right") - 1]
        row[_SLICES["valid"]] = replay.reference_valid[-1]
        row[_SLICES["errors"]] = _sizes(replay.attitude_error[-1], replay.velocity_error[-1], replay.position_error[-1])
        for name in _REPLAYED:
            row[_SLICES[name]] = getattr(replay, name)[-1]
        if free is not None:
            row[_SLICES["free_anchor"]] = free.anchor_s
            row[_SLICES["free_position"]] = free.state.position
            row[_SLICES["free"]] = free_errors(free)
        self._count += 1
        self._has_position = replay.has_position
        return True

    def curves(self) -> Curves:
        """The errors of everything that is kept; needs a row."""
        rows = self._ordered(sum(_CHARTED.values()))
        t = rows[:, 0] - rows[-1, 0]
        errors = rows[:, _SLICES["errors"]]
        known = (rows[:, _SLICES["valid"]][:, 0] > 0) & (np.abs(errors) < MOST).all(axis=1)
        gap = np.flatnonzero(np.diff(t) > _GAP_S)
        known[gap] = known[gap + 1] = False
        age = rows[:, 0] - rows[:, _SLICES["anchor"]][:, 0]
        shown = np.where(known[:, None], errors, 0.0)
        free = Errors(t, *rows[:, _SLICES["free"]].T)
        return Curves(Errors(t, *shown.T), free, age, known, self._has_position)

    def positions(self) -> tuple[Array, Array] | None:
        """The autopilot's and the IMU's (N, 3) NED, m, of everything that is kept; None where there is no position."""
        rows = self._ordered(self._rows.shape[1])
        both = rows[:, _SLICES["position_ref"]], rows[:, _SLICES["position_imu"]]
        good = (np.abs(np.hstack(both)) < MOST).all(axis=1)
        return (both[0][good], both[1][good]) if self._has_position and good.any() else None

    def past(self) -> Past:
        """Everything that is kept. Raises DataError when there is nothing finite in it."""
        rows = self._ordered(self._rows.shape[1])
        end = float(rows[-1, 0])
        t = rows[:, 0] - end
        column = {name: rows[:, part] for name, part in _SLICES.items()}
        valid = column["valid"][:, 0] > 0
        gap = np.flatnonzero(np.diff(t) > _GAP_S)
        valid[gap] = valid[gap + 1] = False
        display = display_trajectory(
            Replay(
                t=t,
                **{name: column[name] for name in _REPLAYED},
                anchors=np.unique(column["anchor"]) - end,
                has_position=self._has_position,
                reference_valid=valid,
                from_rest=False,
            )
        )
        kept = np.isin(t, display.replay.t)
        errors, position, anchor = (column[name][kept] for name in ("free", "free_position", "free_anchor"))
        return Past(display, self.curves(), errors, position, anchor[:, 0], end)

    def _ordered(self, width: int) -> Array:
        """The first columns of the rows kept, oldest first: a copy."""
        rows = self._rows[:, :width]
        if self._count <= len(rows):
            return rows[: self._count].copy()
        first = self._count % len(rows)
        return np.concatenate([rows[first:], rows[:first]])


def present(replay: Replay) -> DisplayTrajectory:
    """The end of a replay, ready for the eye. Raises DataError when nothing of it is finite."""
    last = slice(-2, None)
    columns = {name: getattr(replay, name)[last] for name in ("t", "reference_valid", *_REPLAYED)}
    return display_trajectory(replace(replay, **columns))


def free_errors(free: FreeState) -> tuple[float, float, float, float]:
    """Tilt and heading °, velocity m/s, position m: how far a free run is from the autopilot."""
    return _sizes(free.attitude_error, free.velocity_error, free.position_error)


def _sizes(attitude: Array, velocity: Array, position: Array) -> tuple[float, float, float, float]:
    north, east, down = map(math.degrees, attitude.tolist())
    return math.hypot(north, east), down, math.hypot(*velocity.tolist()), math.hypot(*position.tolist())
