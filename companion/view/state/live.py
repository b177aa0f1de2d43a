"""What a live page is given, as plain values, and what it has shown, for as long as charts and trails reach back."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import numpy.typing as npt

from companion.comparison import DriftRow, FreeState, Replay
from companion.model import Array, Flight
from companion.strapdown import SAME_TIME
from companion.verdict import LiveVerdict, Preflight
from companion.view.state.trajectory import (
    COLUMNS,
    MOST,
    DisplayTrajectory,
    Errors,
    ReplayChoice,
    display_trajectory,
    samples_of,
)


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """A vehicle now."""

    flight: Flight  # its last seconds
    imu: str  # the message that is integrated
    replay: Replay  # since the anchor before the last; its last row is now
    free: FreeState | None  # the IMU left alone since an anchor; None just after such a run has ended


@dataclass(frozen=True, slots=True)
class StreamState:
    """One message that is requested of the vehicle."""

    name: str
    requested_hz: float
    received_hz: float
    note: str = ""  # "given up", "asking"; "" when it is agreed


@dataclass(frozen=True, slots=True)
class LinkState:
    """How a link stands. All text is untrusted."""

    link: str
    problem: str = ""  # why nothing is received at present; "" while frames arrive
    streams: tuple[StreamState, ...] = ()
    frames: int = 0
    lost: Mapping[str, float] = field(default_factory=dict)  # vehicle → share of its frames missing by sequence
    rejected: int = 0  # frames whose signature is missing or wrong
    latency_ms: float | None = None  # half of the way there and back
    clock: str = ""  # what is known of the vehicle's clock, in words
    recording: str = ""  # file; "" for none
    recorded_bytes: int = 0
    recording_problem: str = ""


@dataclass(frozen=True, slots=True)
class LiveStatus:
    """What is said of a link and its vehicles now. All text is untrusted."""

    link: LinkState
    verdict: LiveVerdict  # now and so far, on the vehicle that is looked at
    other_verdicts: Sequence[LiveVerdict] = ()  # on the other vehicles of the link
    why_not: str = ""  # why the last look saw nothing, or the last free run ended
    vehicles: Sequence[str] = ()  # those that can be looked at
    messages: Sequence[str] = ()  # the last sentences for the user, the newest last
    drift: Sequence[DriftRow] = ()  # since the first message of the vehicle
    preflight: Preflight | None = None  # the checks before take-off, while the vehicle stands disarmed


LONGEST_REANCHOR_S = 20.0
"""That the page offers; whoever keeps the messages keeps two such periods."""


class Feed(Protocol):
    """Where the live page looks. Everything but `wait` answers at once, and all is called by the view thread alone."""

    reanchor_s: float  # the dead reckoning restarts from the autopilot so often

    @property
    def choice(self) -> ReplayChoice:
        """Which IMU is integrated, and how; a change begins the free run and the drift anew."""

    def choose(self, choice: ReplayChoice) -> None:
        """Integrate another one, or otherwise."""

    @property
    def status(self) -> LiveStatus:
        """How everything stands."""

    def wait(self, timeout_s: float) -> None:
        """Wait until there is something that `look` has not seen, no longer than so many s."""

    def look(self) -> Seen | None:
        """The vehicle now."""

    def pick(self, vehicle: str) -> None:
        """Look at another vehicle from now on."""

    def anchor_now(self) -> None:
        """Restart both dead reckonings from the autopilot."""


_SHAPES = dict.fromkeys(COLUMNS, 3) | {"q_imu": 4, "q_ref": 4, "errors": 4, "free": 4, "free_position": 3}
_ROW = np.dtype([(name, float, size) for name, size in _SHAPES.items()]
    + [(name, float) for name in ("t", "valid", "anchor", "free_anchor")])  # fmt: skip
_GAP_S = 1.0  # between two rows: the link was silent


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """The errors of what was shown, for charts."""

    errors: Errors  # since the last anchor, at (N,) s before the last row, which is 0
    free: Errors  # of the free run
    age: Array  # (N,) s since the last anchor
    known: npt.NDArray[np.bool_]  # (N,) whether there was an autopilot's state to compare with
    free_known: npt.NDArray[np.bool_]  # (N,) and a free run
    has_position: bool


@dataclass(frozen=True, slots=True, eq=False)
class FreeRun:
    """The IMU left alone, at one instant."""

    errors: tuple[float, ...]  # tilt and heading °, velocity m/s, position m
    age_s: float
    position: Array  # (3,) NED, m


@dataclass(frozen=True, slots=True, eq=False)
class Past:
    """A stretch of what was shown. Times are seconds before its end: 0 is the last row."""

    display: DisplayTrajectory
    curves: Curves
    free: Array  # (N, 4) the free run's errors at the samples: tilt and heading °, velocity m/s, position m
    free_position: Array  # (N, 3) NED, m
    free_anchor: Array  # (N,) s, boot clock
    end: float  # s, boot clock, of the last row

    def free_at(self, t: float) -> FreeRun | None:
        """The free run at an instant; None where there was none."""
        row = int(np.clip(np.searchsorted(self.display.replay.t, t + SAME_TIME) - 1, 0, len(self.free) - 1))
        age = t + self.end - float(self.free_anchor[row])
        return FreeRun(tuple(self.free[row]), age, self.free_position[row]) if np.isfinite(age) else None


class History:
    """The newest rows of everything shown, of one boot of one vehicle. Its memory is taken once and never grows."""

    def __init__(self, seconds: float, rate_hz: float) -> None:
        self._period = 1.0 / rate_hz
        self._rows = np.empty(max(int(seconds * rate_hz), 2), dtype=_ROW)
        self._count = 0  # rows written ever
        self._has_position = False

    def __len__(self) -> int:
        return min(self._count, len(self._rows))

    def clear(self) -> None:
        """Forget everything."""
        self._count = 0

    def add(self, replay: Replay, free: FreeState | None) -> None:
        """Keep what the replay ends with, where that is worth a row."""
        t = float(replay.t[-1])
        if self._count and t < self._rows["t"][(self._count - 1) % len(self._rows)] + 0.9 * self._period:
            return
        row = self._rows[self._count % len(self._rows)]
        row["t"], row["valid"] = t, replay.reference_valid[-1]
        row["anchor"] = replay.anchors[np.searchsorted(replay.anchors, t, side="right") - 1]
        row["errors"] = _sizes(replay.attitude_error[-1], replay.velocity_error[-1], replay.position_error[-1])
        for name in COLUMNS:
            row[name] = getattr(replay, name)[-1]
        row["free"] = np.nan if free is None else free_run(free, t).errors
        row["free_anchor"] = np.nan if free is None else free.anchor_s
        row["free_position"] = np.nan if free is None else free.state.position
        self._count += 1
        self._has_position = replay.has_position

    def curves(self) -> Curves:
        """The errors of everything that is kept; needs a row."""
        times, errors = self._ordered("t"), self._ordered("errors")
        t = times - times[-1]
        known = self._known(t) & (np.abs(errors) < MOST).all(axis=1)
        shown = Errors(t, *np.where(known[:, None], errors, 0.0).T)
        free = self._ordered("free")
        free_shown = Errors(t, *np.where(np.isfinite(free), free, 0.0).T)
        age, free_known = times - self._ordered("anchor"), known & np.isfinite(free[:, 0])
        return Curves(shown, free_shown, age, known, free_known, self._has_position)

    def positions(self) -> tuple[Array, Array] | None:
        """The autopilot's and the IMU's (N, 3) NED, m, of everything that is kept; None where there is no position."""
        both = self._ordered("position_ref"), self._ordered("position_imu")
        good = (np.abs(np.hstack(both)) < MOST).all(axis=1)
        return (both[0][good], both[1][good]) if self._has_position and good.any() else None

    def past(self) -> Past:
        """Everything that is kept. Raises DataError when there is nothing finite in it."""
        times = self._ordered("t")
        end = float(times[-1])
        display = display_trajectory(
            Replay(
                t=times - end,
                **{name: self._ordered(name) for name in COLUMNS},
                anchors=np.unique(self._ordered("anchor")) - end,
                has_position=self._has_position,
                reference_valid=self._known(times),
                from_rest=False,
            )
        )
        kept = np.isin(times - end, display.replay.t)
        free, position, anchor = (self._ordered(name)[kept] for name in ("free", "free_position", "free_anchor"))
        return Past(display, self.curves(), free, position, anchor, end)

    def _known(self, t: Array) -> npt.NDArray[np.bool_]:
        """Where the autopilot's state was known: not beside a silence of the link."""
        known = self._ordered("valid") > 0
        gap = np.flatnonzero(np.diff(t) > _GAP_S)
        known[gap] = known[gap + 1] = False
        return known

    def _ordered(self, name: str) -> Array:
        """A column of the rows kept, oldest first: a copy."""
        column = self._rows[name]
        if self._count <= len(column):
            return column[: self._count].copy()
        first = self._count % len(column)
        return np.concatenate([column[first:], column[:first]])


def present(replay: Replay) -> DisplayTrajectory:
    """The end of a replay, ready for the eye. Raises DataError when nothing of it is finite."""
    return display_trajectory(samples_of(replay, slice(-2, None)))


def free_run(free: FreeState, now: float) -> FreeRun:
    """It at `now`, s, boot clock."""
    errors = _sizes(free.attitude_error, free.velocity_error, free.position_error)
    return FreeRun(errors, now - free.anchor_s, free.state.position)


def _sizes(attitude: Array, velocity: Array, position: Array) -> tuple[float, float, float, float]:
    north, east, down = map(math.degrees, attitude.tolist())
    return math.hypot(north, east), down, math.hypot(*velocity.tolist()), math.hypot(*position.tolist())
