"""The verdict while a flight happens: now, by its last seconds, and so far, by what the verdict was before."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

from companion.analysis import Verdict, compare, newest_stands_out, phases
from companion.model import DataError, Flight
from companion.telemetry import Stream

HORIZON_S = 40.0
"""Of data that the verdict now rests on: shorter, and a slow bias drowns in noise; longer, and it costs more than it
tells. What lasted longer than that is in the record of alarms."""

MOST_S = 90.0
"""And from an alarm on until nobody is suspect: without its onset a fault looks like another."""

_BEFORE_S = 20.0  # of data before an alarm that still lasts
_LOOK_S = 20.0  # of data for a look at the newest
_MOST_ALARMS = 50
_SUSPECT = ("imu_suspect", "autopilot_suspect")

Band = tuple[tuple[float, float, float, float], ...]
"""Time since an anchor, s, and 1σ of what the error is expected to be then: attitude °, velocity m/s, position m."""

Judging = Callable[[Flight, str | None], tuple[Verdict, Band]]
"""What is said of an IMU of a flight (None: its default), and what is expected of it."""

State = Literal["consistent", "imu_suspect", "autopilot_suspect", "insufficient_data", "starting", "lost", ""]
"""What is to be said: a verdict; the estimator is aligning; control was lost; nothing yet."""


@dataclass(frozen=True, slots=True)
class Alarm:
    """A time in which somebody was suspect."""

    status: State
    text: str  # as it was said last, when most was known
    first: float  # s UNIX, of the newest data when it was said first
    last: float  # ... and last


@dataclass(frozen=True, slots=True)
class LiveVerdict:
    """What is to be said at one moment."""

    status: State
    text: str
    newest: float  # s UNIX, when the newest data that it rests on arrived
    vehicle: str = ""
    alarms: tuple[Alarm, ...] = ()  # since the session began; the newest last
    expected: Band = ()  # empty where it cannot be said
    was_consistent: bool = False  # whether it ever was, since then

    @property
    def so_far(self) -> tuple[State, str]:
        """The verdict on the session up to now, and why: the first alarm, and what was after it."""
        if not self.alarms:
            return ("consistent", "no alarm so far") if self.was_consistent else ("", "nothing is known yet")
        said = [f"{_clock(a.first)} to {_clock(a.last)}: {a.text}" for a in self.alarms]
        more = f" ({len(said) - 2} more)" if len(said) > 2 else ""
        return self.alarms[0].status, "; ".join(dict.fromkeys([said[0], said[-1]])) + more


class Judge:
    """Give `hear` what arrives, then `judge` as often as can be afforded.

    verdict_on: judges a flight as a log; may raise DataError. imu: its message; the default where it does not come.
    vehicle: SYSID or SYSID:COMPID; None: the one with the most IMU samples. Memory does not grow: only the last seconds
    and the alarms are kept.
    """

    def __init__(
        self,
        verdict_on: Judging,
        *,
        dialect: str,
        dequantise: bool = False,
        imu: str | None = None,
        vehicle: str | None = None,
    ) -> None:
        self.verdict_on = verdict_on
        self.imu = imu
        self.vehicle = vehicle
        self.most_s = MOST_S  # of data that are judged while somebody is suspect: less where that takes too long
        self._stream = Stream(dialect=dialect, window_s=1.2 * MOST_S, dequantise=dequantise)
        self._newest = 0.0
        self.last = LiveVerdict("", "nothing has been received", 0.0)  # what was said last
        self._since = math.inf  # s UNIX, the first alarm since nobody was suspect
        self._judged: Flight | None = None

    @property
    def newest(self) -> float:
        """When the newest data arrived, s UNIX; 0: nothing has."""
        return self._newest

    def hear(self, data: bytes, received: float) -> None:
        """Take bytes that arrived at `received` s UNIX."""
        self._stream.push(data, received)
        self._newest = received

    def forget(self) -> None:
        """Begin the record anew: another IMU or another vehicle is judged from now on."""
        self.last, self._judged = LiveVerdict("", "judging anew", self._newest), None
        self._since = math.inf

    def judge(self) -> LiveVerdict:
        """What is to be said now."""
        last = self.last
        self._judged = flight = self._flight(self._horizon_s)
        status, text, expected = self._said(flight)
        live_verdict = replace(last, status=status, text=text, newest=self._newest, expected=expected)
        if flight is not None:
            live_verdict = replace(live_verdict, vehicle=str(flight.vehicle))
        if status in _SUSPECT:
            live_verdict = replace(
                live_verdict, alarms=_noted(last.alarms, self._since, Alarm(status, text, self._newest, self._newest))
            )
            self._since = min(self._since, self._newest)
        elif status == "consistent":
            self._since = math.inf
        self.last = replace(live_verdict, was_consistent=last.was_consistent or status == "consistent")
        return self.last

    def stirred(self) -> bool:
        """Whether the last seconds differ from those before, so that a judgement should not wait for its turn."""
        flight = self._gone_on() or self._flight(_LOOK_S)
        if flight is None:
            return False
        try:
            return newest_stands_out(compare(flight, imu=self._imu_of(flight)))
        except DataError:
            return False

    def _gone_on(self) -> Flight | None:
        """The last seconds of the flight that was judged, no more than a look needs; None where it has not gone on."""
        flight = self._judged
        if flight is None:
            return None
        imu = flight.imu(self._imu_of(flight)).source
        newest = self._stream.extend(flight, imu, self._stream.newest - _LOOK_S)
        if newest is None:
            return None
        return replace(flight, imus={imu: newest.imu}, attitude=newest.attitude, position=newest.position)

    @property
    def _horizon_s(self) -> float:
        """Of data that are judged: more until an alarm has cleared, so that its onset stays in them."""
        return min(max(HORIZON_S, self._newest - self._since + _BEFORE_S), self.most_s)

    def _imu_of(self, flight: Flight) -> str | None:
        return self.imu if self.imu in flight.imus else None

    def _flight(self, seconds: float) -> Flight | None:
        usable = [flight for flight in self._stream.recent(seconds) if flight.default_imu is not None]
        newest = {flight.vehicle.sysid: flight for flight in usable}  # the last boot of each
        chosen = [
            f for f in newest.values() if self.vehicle is None or self.vehicle in (str(f.vehicle), str(f.vehicle.sysid))
        ]
        return max(chosen, key=lambda flight: len(flight.imu()), default=None)

    def _said(self, flight: Flight | None) -> tuple[State, str, Band]:
        if flight is None:
            return "", "no IMU messages received", ()
        part = phases(flight)[-1]
        if part.kind == "aligning":
            return "starting", f"the estimator is aligning ({part.reason}): nothing is judged yet", ()
        if part.kind == "impact":
            return "lost", f"{part.reason}: nothing is judged until it is in control again", ()
        try:
            verdict, expected = self.verdict_on(flight, self._imu_of(flight))
        except DataError as reason:
            return "insufficient_data", str(reason), ()
        text = verdict.summary
        if part.kind != "flight":
            text = f"{text.removesuffix('.')} ({_WHERE[part.kind]})."
        return verdict.status, text, expected


_WHERE = {"standing": "on the ground", "landed": "after landing"}


def _noted(alarms: tuple[Alarm, ...], since: float, new: Alarm) -> tuple[Alarm, ...]:
    """The alarms with this one: the last goes on if it is of the same side, and nobody said since that all is well.

    since: s UNIX, the first alarm since then.
    """
    if alarms and alarms[-1].status == new.status and alarms[-1].last >= since:
        return (*alarms[:-1], replace(new, first=alarms[-1].first))
    alarms = (*alarms, new)
    return (alarms[0], *alarms[1:][-_MOST_ALARMS + 1 :])  # the first says what the session's verdict is


def _clock(t: float) -> str:
    return time.strftime("%H:%M:%S", time.localtime(t))
