"""Everything that is known of one vehicle of a link at this moment. Belongs to the thread that looks."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from companion.analysis import HORIZONS_S, DriftRow, FreeRun, FreeState, Integration, RunningDrift
from companion.app.live.replay import LiveReplay, Present
from companion.mavlink import Frames, together
from companion.model import Flight
from companion.telemetry import Stream

_DRIFT_S = 5.0  # between two looks for complete windows
_SETTLED_S = 2.0  # packets come late: a window is judged so long after its end
_MOST_DRIFTS = 8  # vehicles and boots whose tables are kept
_KEPT_S = 12.0  # of messages, beside the longest window or two re-anchor periods


@dataclass(frozen=True, slots=True, eq=False)
class LiveState:
    """A vehicle now."""

    present: Present
    free: FreeState | None  # None just after a free run has ended


class Watch:
    """Give `receive` what arrives, then `look`: both poses, the free run, and the drift since the session began.

    how: how to integrate a flight. imu, vehicle: as in `LiveReplay`. most_reanchor_s: the longest period that will be
    chosen later: so much is kept.
    """

    def __init__(
        self,
        *,
        dialect: str,
        dequantise: bool,
        how: Callable[[Flight], Integration],
        horizons: Sequence[float] = HORIZONS_S,
        imu: str | None = None,
        vehicle: str | None = None,
        reanchor_s: float = 10.0,
        most_reanchor_s: float = 10.0,
    ) -> None:
        longest = max(horizons)
        self._stream = Stream(
            dialect=dialect, window_s=_KEPT_S + max(longest, 2 * most_reanchor_s), dequantise=dequantise
        )
        self._how, self._horizons = how, tuple(horizons)
        self._replay = LiveReplay(self._stream, vehicle=vehicle, imu=imu, how=how, reanchor_s=reanchor_s)
        self._free = FreeRun()
        self._drifts: dict[tuple[str, int, str], RunningDrift] = {}  # of each boot and IMU, the newest last
        self._shown: tuple[str, int, str] | None = None
        self._drift_due = 0.0
        self._drift_span = longest + 2 * _DRIFT_S + _SETTLED_S

    @property
    def why_not(self) -> str:
        """Why the last look found nothing, for the user; also why the last free run ended."""
        return self._replay.why_not or self._free.ended

    @property
    def reanchor_s(self) -> float:
        """s between two restarts of the dead reckoning from the autopilot's state."""
        return self._replay.reanchor_s

    @reanchor_s.setter
    def reanchor_s(self, seconds: float) -> None:
        self._replay.reanchor_s = seconds

    @property
    def vehicles(self) -> tuple[str, ...]:
        """Those that were received in the last seconds and have an IMU, as SYSID:COMPID."""
        return self._replay.vehicles

    @property
    def drift(self) -> tuple[DriftRow, ...]:
        """The drift of this boot since it was first received."""
        return self._drifts[self._shown].rows if self._shown in self._drifts else ()

    def choose(self, imu: str | None, how: Callable[[Flight], Integration]) -> None:
        """Dead-reckon from another IMU (None: the flight's default), or otherwise: all results begin anew."""
        self._replay.imu, self._replay.how, self._how = imu, how, how
        self._drifts.clear()
        self._shown = None

    def pick(self, vehicle: str) -> None:
        """Look at another vehicle."""
        self._replay.vehicle = vehicle

    def anchor_now(self) -> None:
        """Restart both dead reckonings from the autopilot's present state."""
        self._replay.anchor_now()
        self._free.anchor_now()

    def receive(self, receipts: Sequence[tuple[Frames, float]]) -> None:
        """Take what has arrived, with when: s UNIX."""
        if receipts:
            self._stream.add(together(receipts))

    def look(self) -> LiveState | None:
        """Both poses now; None, with the reason in `why_not`."""
        present = self._replay.look()
        if present is None:
            return None
        flight = present.flight
        shown = (str(flight.vehicle), flight.boot, present.imu)
        if shown != self._shown:
            self._shown = shown
            self._free.anchor_now()
            self._drift_due = 0.0
        if present.continued is not None:
            free = self._free.carry(present.continued)
        else:
            free = self._free.take(flight.imu(present.imu), present.replay, self._how(flight))
        if time.monotonic() >= self._drift_due:
            self._drift_due = time.monotonic() + _DRIFT_S
            self.judge()
        return LiveState(present, free)

    def judge(self, *, settled: bool = False) -> None:
        """Judge the windows that have become complete. settled: nothing more will come."""
        if self._shown is None:
            return
        who, boot, imu = self._shown
        for flight in self._stream.recent(self._drift_span):
            if (str(flight.vehicle), flight.boot) == (who, boot) and imu in flight.imus:
                running = self._drifts.setdefault(self._shown, RunningDrift(self._horizons))
                until = float("inf") if settled else float(flight.imus[imu].t[-1]) - _SETTLED_S
                running.take(flight, imu=imu, how=self._how(flight), settled_s=until)
        while len(self._drifts) > _MOST_DRIFTS:
            del self._drifts[next(iter(self._drifts))]
