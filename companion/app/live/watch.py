"""Everything that is known of one vehicle of a link at this moment: both poses, and the drift so far.

The newest seconds of a stream are replayed by the same function as a log. Belongs to the thread that looks.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from companion.comparison import (
    HORIZONS_S,
    Continued,
    DriftRow,
    FreeRun,
    FreeState,
    Integration,
    Replay,
    RunningDrift,
    extend,
    replay,
)
from companion.mavlink import Frames, together
from companion.model import DataError, Flight, check_seconds
from companion.telemetry import Stream

_MARGIN_S = 3.0  # beside the re-anchor period: late packets, and the autopilot's messages around the anchor

_WHOLE_S = 4.0  # between two looks at everything; in between the newest samples go on from the last
_OVERLAP_S = 0.6  # of arrivals before that: a sample or more of each message, also of slow ones

_STEADY_S = 5.0  # how long another IMU message must be the better one


@dataclass(frozen=True, slots=True, eq=False)
class Present:
    """Where a live flight stands."""

    flight: Flight  # its last seconds
    imu: str  # the message that is integrated
    replay: Replay  # since the anchor before the last, or only the last rows; its last row is now
    continued: Continued | None  # those last rows; None where everything was looked at


@dataclass(frozen=True, slots=True, eq=False)
class _Whole:
    """A look at everything."""

    present: Present
    how: Integration
    newest: float  # s UNIX, when the newest message of then arrived
    requested: tuple[object, ...]


class LiveReplay:
    """Both poses of a stream's vehicle, now: `look` as often as something is to be shown.

    vehicle: SYSID or SYSID:COMPID; None: the one with the most IMU samples. how: how to integrate a flight. The other
    options are those of `replay`; all but the stream may be changed at any time.
    Dead reckoning starts again from the autopilot every `reanchor_s`, at the times at which that of the whole flight
    would, give or take a sample; after a reboot at the first state that is known.
    """

    def __init__(
        self,
        stream: Stream,
        *,
        vehicle: str | None = None,
        imu: str | None = None,
        how: Callable[[Flight], Integration] = lambda _: Integration(),
        reanchor_s: float = 10.0,
    ) -> None:
        self.vehicle = vehicle
        self.vehicles: tuple[str, ...] = ()  # those with an IMU at the last look, as SYSID:COMPID
        self.reanchor_s = reanchor_s
        self.why_not = "nothing has been received"  # why the last `look` found nothing, for the user
        self._stream = stream
        self.imu = imu
        self.how = how
        self._whole: _Whole | None = None
        self._boot: tuple[str, int] | None = None
        self._anchor: float | None = None  # s, boot clock
        self._chosen: str | None = None  # the IMU that is shown when the user names none
        self._doubted: float | None = None  # s, boot clock, since when another would be the default

    @property
    def reanchor_s(self) -> float:
        """The re-anchor period, s. Raises SettingsError for one that is not positive."""
        return self._reanchor_s

    @reanchor_s.setter
    def reanchor_s(self, seconds: float) -> None:
        check_seconds("the re-anchor period", seconds)
        self._reanchor_s = seconds

    def anchor_now(self) -> None:
        """Start again from the autopilot at the next look."""
        self._anchor = self._whole = None

    def look(self) -> Present | None:
        """Both poses over the last seconds; None, with the reason in `why_not`, when they cannot be known."""
        return self._gone_on() or self._look_at_everything()

    def _gone_on(self) -> Present | None:
        """The last look at everything carried on; None where it is time for another, or nothing else can tell."""
        whole = self._whole
        if whole is None or whole.requested != self._requested or self._stream.newest - whole.newest > _WHOLE_S:
            return None
        present = whole.present
        newest = self._stream.extend(present.flight, present.imu, whole.newest - _OVERLAP_S)
        if newest is None:
            return None
        continued = extend(present.replay, newest.imu, newest.attitude, newest.position, whole.how)
        if continued is None or continued.replay.t[-1] >= present.replay.anchors[-1] + self._reanchor_s:
            return None
        return Present(present.flight, present.imu, continued.replay, continued)

    @property
    def _requested(self) -> tuple[object, ...]:
        """What the user wants to see: another wish is another look."""
        return self.vehicle, self.imu, self.how, self._reanchor_s

    def _look_at_everything(self) -> Present | None:
        self._whole = None
        flight = self._choose()
        if flight is None:
            return None
        boot = (str(flight.vehicle), flight.boot)
        if boot != self._boot:
            self._boot, self._anchor, self._chosen = boot, None, None
        imu = self.imu or self._steady_imu(flight)
        how = self.how(flight)
        start = self._anchor
        if start is None or start < flight.start + flight.duration - self._span:
            start = float(flight.attitude.t[-1]) - 1.0 if flight.attitude is not None else None  # nearly now
        try:
            both = replay(flight, imu=imu, how=how, reanchor_s=self._reanchor_s, start_s=start)
        except DataError as reason:
            self.why_not = str(reason)
            return None
        # one anchor back, so that the last error before a new anchor is still shown with it
        self._anchor = float(both.anchors[-2 if len(both.anchors) > 1 else -1])
        self.why_not = ""
        present = Present(flight, flight.imu(imu).source, both, None)
        self._whole = _Whole(present, how, self._stream.newest, self._requested)
        return present

    @property
    def _span(self) -> float:
        return 2 * self._reanchor_s + _MARGIN_S

    def _choose(self) -> Flight | None:
        recent = self._stream.recent(self._span)
        newest = {str(f.vehicle): f for f in recent}  # the last boot of each
        usable = [f for f in newest.values() if f.default_imu is not None]
        self.vehicles = tuple(str(f.vehicle) for f in usable)
        if self.vehicle is not None:
            usable = [f for f in usable if self.vehicle in (str(f.vehicle), str(f.vehicle.sysid))]
        if not usable:
            self.why_not = "no IMU messages" if newest else "no vehicle on the link"
            return None
        shown = self._boot[0] if self._boot else ""  # two vehicles that send alike must not take turns
        return max(usable, key=lambda f: (str(f.vehicle) == shown, len(f.imus[f.default_imu or ""])))

    def _steady_imu(self, flight: Flight) -> str | None:
        """The flight's default; another than before only when it has been that for a while: losses come and go."""
        default, now = flight.default_imu, flight.start + flight.duration
        if default == self._chosen:
            self._doubted = None
        elif self._chosen not in flight.imus or (self._doubted is not None and now - self._doubted > _STEADY_S):
            self._chosen, self._doubted, self._anchor = default, None, None
        elif self._doubted is None:
            self._doubted = now
        return self._chosen


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

    how: how to integrate a flight. imu, vehicle: as in `LiveReplay`, whose vehicle and period can be changed at any
    time: see `replay`. most_reanchor_s: the longest period that will be chosen later: so much is kept.
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
        self._horizons = tuple(horizons)
        self.replay = LiveReplay(self._stream, vehicle=vehicle, imu=imu, how=how, reanchor_s=reanchor_s)
        self._free = FreeRun()
        self._drifts: dict[tuple[str, int, str], RunningDrift] = {}  # of each boot and IMU, the newest last
        self._shown: tuple[str, int, str] | None = None
        self._drift_due = 0.0
        self._drift_span = longest + 2 * _DRIFT_S + _SETTLED_S

    @property
    def why_not(self) -> str:
        """Why the last look found nothing, for the user; also why the last free run ended."""
        return self.replay.why_not or self._free.ended

    @property
    def drift(self) -> tuple[DriftRow, ...]:
        """The drift of this boot since it was first received."""
        return self._drifts[self._shown].rows if self._shown in self._drifts else ()

    def choose(self, imu: str | None, how: Callable[[Flight], Integration]) -> None:
        """Dead-reckon from another IMU (None: the flight's default), or otherwise: all results begin anew."""
        self.replay.imu, self.replay.how = imu, how
        self._drifts.clear()
        self._shown = None

    def anchor_now(self) -> None:
        """Restart both dead reckonings from the autopilot's present state."""
        self.replay.anchor_now()
        self._free.anchor_now()

    def receive(self, receipts: Sequence[tuple[Frames, float]]) -> None:
        """Take what has arrived, with when: s UNIX."""
        if receipts:
            self._stream.add(together(receipts))

    def look(self) -> LiveState | None:
        """Both poses now; None, with the reason in `why_not`."""
        present = self.replay.look()
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
            free = self._free.take(flight.imu(present.imu), present.replay, self.replay.how(flight))
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
                running.take(flight, imu=imu, how=self.replay.how(flight), settled_s=until)
        while len(self._drifts) > _MOST_DRIFTS:
            del self._drifts[next(iter(self._drifts))]
