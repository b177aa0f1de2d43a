"""The verdicts while flights happen: now, by the last seconds, and so far, by what a verdict was before.

A judge for each vehicle of a link, over one stream. A verdict is due every 3 s, and sooner where the last one took
long, so that none is older than 5 s when the next is there, though that has a fault to explain. What cannot be told any
more is judged again at once. Between them a look at the newest 20 s, a fortieth of the work, calls for a verdict at
once where the last seconds differ from those before. A verdict that took more than 1.6 s of the processor shortens the
data of the next: the newest seconds come first. And the processor rests twice as long as it was busy, 1.25 times under
an alarm.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from math import sqrt

from companion.comparison import AIRBORNE_REPORTS, compare, newest_stands_out, phases
from companion.constants import check
from companion.model import DataError, Flight
from companion.telemetry import Stream
from companion.verdict import Alarm, Band, LiveVerdict, State, Verdict

HORIZON_S = 40.0
"""Of data that the verdict now rests on: shorter, and a slow bias drowns in noise; longer, and it costs more than it
tells. What lasted longer than that is in the record of alarms."""

_MOST_S = 90.0
"""And from an alarm on until nobody is suspect: without its onset a fault is measured less well."""

_LEAST_S = 20.0
"""On a computer that is too slow: the newest seconds come first. A verdict needs three windows of 5 s."""

_BEFORE_S = 20.0  # of data before an alarm that still lasts
_LOOK_S = 20.0  # of data for a look at the newest
_MOST_ALARMS = 50
_TURNS_S = 4.5  # a flip, and what shows that it was one: until then a vehicle that turns over is not lost
_YOUNG_S = 60.0  # since boot: until then an estimator on the ground may still be finding its heading

Judging = Callable[[Flight, str | None], tuple[Verdict, Band]]
"""What is said of an IMU of a flight (None: its default), and what is expected of it."""


class NothingYetError(DataError):
    """What a verdict rests on has only begun."""


class Judge:
    """Of one vehicle: give `receive` what arrives, then `judge` as often as can be afforded.

    verdict_on: judges a flight as a log; may raise DataError. stream: what has arrived (`new_stream`), which several
    judges may share. imu: its message; the default where it does not come. vehicle: SYSID or SYSID:COMPID; None: the
    first with an IMU that is received, as long as it is. Memory does not grow: only the last seconds and the alarms
    are kept.
    """

    def __init__(
        self, verdict_on: Judging, stream: Stream, *, imu: str | None = None, vehicle: str | None = None
    ) -> None:
        self.verdict_on = verdict_on
        self.imu = imu
        self.vehicle = vehicle
        self.most_s = _MOST_S  # of data that are judged: less where that takes too long
        self.others: tuple[str, ...] = ()  # further vehicles with an IMU at the last judgement
        self._stream = stream
        self.newest = 0.0  # s UNIX, when the newest data arrived; 0: nothing has
        self.last = LiveVerdict("", "nothing has been received")  # what was said last
        self._since = math.inf  # s UNIX, the first alarm since nobody was suspect
        self._judged: Flight | None = None
        self._aloft_s = -math.inf  # s, boot clock, when it was last known to be in the air
        self._tells = False  # whether the vehicle says itself when it takes off and lands

    def receive(self, data: bytes, received: float) -> None:
        """Take bytes that arrived at `received` s UNIX."""
        self._stream.push(data, received)
        self.newest = received

    def forget(self) -> None:
        """Begin the record anew: another IMU is judged from now on."""
        self.last, self._judged = LiveVerdict("", "judging anew"), None
        self._since = math.inf

    def judge(self) -> LiveVerdict:
        """What is to be said now; the same as before where this vehicle's IMU has sent nothing since."""
        last, before = self.last, self._judged
        flight = self._flight(self._horizon_s)
        if flight is None or (before is not None and _end(flight) == _end(before)):
            if not last.newest:
                self.last = replace(last, text="no IMU messages received")
            return self.last
        changed = "" if before is None or flight.vehicle == before.vehicle else f"{before.vehicle} is silent. "
        self._judged = flight
        if changed:  # nothing of the other vehicle's is this one's
            self._since, self._aloft_s, self._tells = math.inf, -math.inf, False
            self.last = last = replace(last, status="", expected=(), cause=None)
        seen = self._status_of(flight)
        status, text = seen.status, seen.text
        if changed and str(flight.vehicle) != last.vehicle:
            text = f"Vehicle {flight.vehicle} is judged from now on: {changed}{text}"
        verdict = replace(seen, text=text, newest=self.newest, vehicle=str(flight.vehicle), alarms=last.alarms)
        if seen.is_alarm:
            verdict = replace(verdict, alarms=_noted(last.alarms, self._since, status, text, self.newest))
            self._since = min(self._since, self.newest)
        elif status == "consistent":
            self._since = math.inf
        self.last = replace(verdict, was_consistent=last.was_consistent or status == "consistent")
        return self.last

    def is_urgent(self) -> bool:
        """Whether the last seconds differ from those before, so that a judgement should not wait for its turn."""
        try:
            flight = self._gone_on() or self._flight(_LOOK_S)
            return flight is not None and newest_stands_out(compare(flight, imu=self._imu_of(flight)))
        except Exception:  # noqa: BLE001  (a look is a hint: a defect of it must not end the verdicts)
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
        return min(max(HORIZON_S, self.newest - self._since + _BEFORE_S), self.most_s)

    def _imu_of(self, flight: Flight) -> str | None:
        return self.imu if self.imu in flight.imus else None

    def _flight(self, seconds: float) -> Flight | None:
        usable = [flight for flight in self._stream.recent(seconds) if flight.default_imu is not None]
        newest = {str(flight.vehicle): flight for flight in usable}  # the last boot of each
        chosen = [
            f for f in newest.values() if self.vehicle is None or self.vehicle in (str(f.vehicle), str(f.vehicle.sysid))
        ]
        now = self.last.vehicle  # two vehicles that send alike must not take turns
        flight = max(chosen, key=lambda one: (str(one.vehicle) == now, len(one.imu())), default=None)
        self.others = tuple(str(one.vehicle) for one in newest.values() if one is not flight)
        return flight

    def _status_of(self, flight: Flight) -> LiveVerdict:
        part = phases(flight)[-1]
        aligning = part.kind == "aligning" or (part.kind == "standing" and self._is_young(flight))
        if aligning and flight.attitude is not None:
            why = part.reason if part.kind == "aligning" else "it has booted less than a minute ago"
            return LiveVerdict("starting", f"the estimator is aligning ({why}): nothing is judged yet")
        if part.kind == "impact":
            if part.end - part.start < _TURNS_S and self.last.status:
                return self.last
            return LiveVerdict("lost", f"{part.reason}: nothing is judged until it is in control again")
        try:
            verdict, expected = self.verdict_on(flight, self._imu_of(flight))
        except NothingYetError as reason:
            return LiveVerdict("starting", str(reason))
        except DataError as reason:
            return LiveVerdict("insufficient_data", str(reason))
        text = verdict.summary
        aloft = self._is_aloft(flight, part.kind)
        if (where := _WHERE.get(part.kind)) and not aloft:
            text = f"{text.removesuffix('.')} ({where})."
        return LiveVerdict(verdict.status, text, expected=expected, cause=verdict.cause)

    def _is_young(self, flight: Flight) -> bool:
        """Whether its estimator may still be aligning: on the ground, disarmed, in the first minute since boot."""
        estimator = flight.series.get("estimator")
        if estimator is not None and "flags" in estimator.columns and len(estimator.t):
            flags = estimator["flags"][-1]
            if math.isfinite(flags) and int(flags) & check.POSITION_VALID:
                return False
        armed = [event.kind == "armed" for event in flight.events if event.kind in ("armed", "disarmed")]
        return _end(flight) < _YOUNG_S and bool(flight.events) and not (armed and armed[-1])

    def _is_aloft(self, flight: Flight, kind: str) -> bool:
        """Whether it is in the air, though in what is judged it does not move: a hover looks like standing."""
        end = _end(flight)
        if end < self._aloft_s:  # it has rebooted
            self._aloft_s = -math.inf
        if kind == "flight":
            self._aloft_s = end
        self._tells |= any(event.text in AIRBORNE_REPORTS for event in flight.events)
        came_down = any((e.kind == "disarmed" or e.text == "landed") and e.t > self._aloft_s for e in flight.events)
        if came_down or (kind == "landed" and not self._tells):
            self._aloft_s = -math.inf
        return math.isfinite(self._aloft_s)


_WHERE = {"standing": "on the ground", "landed": "after landing"}


def new_stream(dialect: str, *, dequantise: bool = False) -> Stream:
    """A stream that keeps what judges need."""
    return Stream(dialect=dialect, window_s=1.2 * _MOST_S, dequantise=dequantise)


def _end(flight: Flight) -> float:
    """The newest sample of its IMU, s, boot clock."""
    return float(flight.imu().t[-1])


def _noted(alarms: tuple[Alarm, ...], since: float, status: State, text: str, newest: float) -> tuple[Alarm, ...]:
    """The alarms with this one: the last goes on if it is of the same side, and nobody said since that all is well.

    since: s UNIX, the first alarm since then. newest: s UNIX, of the data.
    """
    goes_on = bool(alarms) and alarms[-1].status == status and alarms[-1].last >= since
    first = alarms[-1].first if goes_on else newest
    new = Alarm(status, text, first, newest, f"{_clock(first)} to {_clock(newest)}")
    alarms = (*(alarms[:-1] if goes_on else alarms), new)
    return (alarms[0], *alarms[1:][-_MOST_ALARMS + 1 :])  # the first says what the session's verdict is


def _clock(t: float) -> str:
    return time.strftime("%H:%M:%S", time.localtime(t))


_LOOKS_S = 0.6  # between two looks
_AGE_S = 4.6  # from the beginning of a verdict to the end of the next, so that it is shown before the last is 5 s old
_SHARE = 2.0  # rest after a verdict, in times of the CPU time that it took
_ALARM_SHARE = 1.25  # the same under an alarm, after a look has called for a verdict, or where it has changed
_CALLED_S = 2.5  # CPU time between two regular verdicts that those which looks call for may take: five of 0.5 s
_COSTS_S = 1.6  # CPU time of a verdict, beyond which the next judges less data in proportion
PAUSE_S = _AGE_S - _COSTS_S  # between the beginnings of two verdicts: also one with a fault to explain is in time
_DECIDED_WITHIN = 3  # verdicts, what cannot be told at first: some seconds more of it decide
_LESS, _MORE = 0.8, 1.1  # factors of the data judged next: where the next verdict would be late, and where it would not
_AT_ONCE = 1.4  # the largest such factor after data were cut: with too little the onset of a fault would be lost


class Pace:
    """Give `step` the time as often as you like. A look costs a fortieth of a judgement, and calls one at once.

    The longer the last judgement took, on a busy computer, the sooner the next begins; and where that is not enough,
    the judge is given fewer seconds: the newest.
    """

    def __init__(self, judge: Judge) -> None:
        self.judge = judge
        self._due = self._look = 0.0  # s of the clock of `step`
        self._called = 0.0  # s that the processor was busy with those since the last in turn
        self._judged = self._looked = 0.0  # s UNIX, the newest data of then
        self._soon = 0  # further verdicts that are wanted at once

    def at_once(self) -> None:
        """Judge at the next step: something else is to be judged."""
        self._due = self._judged = 0.0

    def step(self, now: float) -> LiveVerdict | None:
        """What is to be said now; None where nothing is new. now: s of any steady clock."""
        judge = self.judge
        if judge.newest == self._judged:
            return None
        if now < self._due:
            if self._called >= _CALLED_S or now < self._look or judge.newest == self._looked:
                return None
            self._look, self._looked = now + _LOOKS_S, judge.newest
            if not judge.is_urgent():
                return None
        else:
            self._called = 0.0
        self._judged = judge.newest
        said, before, began = judge.last.status, time.process_time(), time.monotonic()
        try:
            live_verdict = judge.judge()
        except Exception as error:  # noqa: BLE001  (a defect of the analysis must not end the verdicts)
            text = f"no verdict ({type(error).__name__}: {error})"
            live_verdict = replace(judge.last, status="", text=text, newest=0.0, expected=())
        busy, took = time.process_time() - before, time.monotonic() - began
        self._called += busy
        called = self._called > busy  # by a look
        self._soon = max(self._soon - 1, 0)
        if said == "consistent" and live_verdict.status != said:
            self._soon = 1 if live_verdict.is_alarm else _DECIDED_WITHIN
        rests = busy * (_ALARM_SHARE if live_verdict.is_alarm or called or self._soon else _SHARE)
        self._due = now + (rests if self._soon else max(min(PAUSE_S, _AGE_S - took), rests))
        in_time = rests + took <= _AGE_S
        if busy > _COSTS_S:
            judge.most_s = max(judge.most_s * _COSTS_S / busy, _LEAST_S)
        else:
            more = min(sqrt(_COSTS_S / max(busy, 1e-3)), _AT_ONCE) if judge.most_s < HORIZON_S else _MORE
            judge.most_s = min(max(judge.most_s * (more if in_time else _LESS), min(HORIZON_S, judge.most_s)), _MOST_S)
        return live_verdict


_MOST_JUDGED = 8  # vehicles: each costs the processor as much as one alone
_MOST_RECORDS = 64  # of vehicles that are silent, for when they come back


class Judges:
    """Give `receive` what arrives, and `step` the time as often as you like.

    judging: makes what judges a flight, one for each vehicle. stream: what has arrived (`new_stream`). vehicle: SYSID
    or SYSID:COMPID; None: the first that sends an IMU, as long as it is received; "all": each of the first eight.
    imu: as for `Judge`.
    """

    def __init__(
        self, judging: Callable[[], Judging], stream: Stream, *, imu: str | None = None, vehicle: str | None = None
    ) -> None:
        self._judging = judging
        self._imu = imu
        self._all = vehicle == "all"
        self._stream = stream
        self._newest = 0.0
        self._records: dict[str, LiveVerdict] = {}  # what was said last of vehicles that are silent, the newest last
        self._paces = [self._pace(None if self._all else vehicle)]

    def receive(self, data: bytes, received: float) -> None:
        """Take bytes that arrived at `received` s UNIX."""
        self._stream.push(data, received)
        self._newest = received
        for pace in self._paces:
            pace.judge.newest = received

    def choose(self, judging: Callable[[], Judging], imu: str | None) -> None:
        """Judge otherwise, or another IMU, from now on: every record begins anew."""
        self._judging, self._imu = judging, imu
        self._records.clear()
        for pace in self._paces:
            pace.judge.verdict_on, pace.judge.imu = judging(), imu
            pace.judge.forget()
            pace.at_once()

    def step(self, now: float) -> LiveVerdict | None:
        """What is to be said now of one of them, each in its turn; None where nothing is new."""
        for pace in tuple(self._paces):
            verdict = pace.step(now)
            if verdict is not None:
                self._paces.remove(pace)  # behind all others
                self._paces.append(pace)
                self._meet(pace.judge)
                return verdict
        return None

    def _pace(self, vehicle: str | None) -> Pace:
        judge = Judge(self._judging(), self._stream, imu=self._imu, vehicle=vehicle)
        judge.newest = self._newest
        return Pace(judge)

    def _meet(self, judge: Judge) -> None:
        """Judge the others too that it has met, where all are requested."""
        if not self._all:
            return
        judge.vehicle = judge.last.vehicle or judge.vehicle
        kept = self._newest - _MOST_S  # nothing is known of a vehicle any more that was silent for so long
        gone = [one for one in self._paces if one.judge is not judge and 0.0 < one.judge.last.newest < kept]
        self._paces = [one for one in self._paces if one not in gone]
        for last in (one.judge.last for one in gone):
            self._records[last.vehicle] = replace(last, status="", text="judging anew", newest=0.0, expected=())
        for oldest in tuple(self._records)[:-_MOST_RECORDS]:
            del self._records[oldest]
        known = {pace.judge.vehicle for pace in self._paces}
        for vehicle in judge.others:
            if vehicle not in known and len(self._paces) < _MOST_JUDGED:
                pace = self._pace(vehicle)
                pace.judge.last = self._records.pop(vehicle, pace.judge.last)
                self._paces.append(pace)
