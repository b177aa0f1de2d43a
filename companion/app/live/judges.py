"""The verdicts on every vehicle of a link: a judge for each, over one stream, and when each of them judges.

A verdict is due every 4 s, and sooner where the last one took long, so that none is older than 5 s when the next is
there. Between them a look at the newest 20 s, a fortieth of the work, calls for a verdict at once where the last
seconds differ from those before. A verdict that took more than 1.6 s of the processor shortens the data of the next:
the newest seconds come first. And the processor rests twice as long as it was busy, 1.25 times under an alarm.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from math import sqrt

from companion.analysis import LiveVerdict
from companion.app.live.judge import HORIZON_S, LEAST_S, MOST_S, Judge, Judging
from companion.telemetry import Stream

_LOOK_S = 0.4  # between two looks: data are handed over twice as often
PAUSE_S = 4.0  # between the beginnings of two verdicts
_AGE_S = 4.2  # from the beginning of a verdict to the end of the next, so that it is shown before the last is 5 s old
_SHARE = 2.0  # rest after a verdict, in times of the CPU time that it took
_ALARM_SHARE = 1.25  # the same under an alarm, after a look has called for a verdict, or where it has changed
_CALLED_S = 2.5  # CPU time between two regular verdicts that those which looks call for may take: five of 0.5 s
_COSTS_S = 1.6  # CPU time of a verdict, beyond which the next judges less data in proportion
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
            self._look, self._looked = now + _LOOK_S, judge.newest
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
        changed = said == "consistent" and live_verdict.status != said
        rests = busy * (_ALARM_SHARE if live_verdict.is_alarm or called or changed else _SHARE)
        self._due = now + (rests if changed else max(min(PAUSE_S, _AGE_S - took), rests))
        in_time = rests + took <= _AGE_S
        if busy > _COSTS_S:
            judge.most_s = max(judge.most_s * _COSTS_S / busy, LEAST_S)
        else:
            more = min(sqrt(_COSTS_S / max(busy, 1e-3)), _AT_ONCE) if judge.most_s < HORIZON_S else _MORE
            judge.most_s = min(max(judge.most_s * (more if in_time else _LESS), min(HORIZON_S, judge.most_s)), MOST_S)
        return live_verdict


_MOST_JUDGED = 8  # vehicles: each costs the processor as much as one alone


class Judges:
    """Give `receive` what arrives, and `step` the time as often as you like.

    judging: makes what judges a flight, one for each vehicle. stream: what has arrived (`new_stream`). vehicle: SYSID
    or SYSID:COMPID; None: the first that sends an IMU, as long as it is received; "all": each of the first eight.
    imu: as for `Judge`.
    """

    def __init__(
        self,
        judging: Callable[[], Judging],
        stream: Stream,
        *,
        imu: str | None = None,
        vehicle: str | None = None,
    ) -> None:
        self._judging = judging
        self._imu = imu
        self._all = vehicle == "all"
        self._stream = stream
        self._newest = 0.0
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
        kept = self._newest - MOST_S  # nothing is known of a vehicle any more that was silent for so long
        self._paces = [one for one in self._paces if one.judge is judge or not 0.0 < one.judge.last.newest < kept]
        known = {pace.judge.vehicle for pace in self._paces}
        for vehicle in judge.others:
            if vehicle not in known and len(self._paces) < _MOST_JUDGED:
                self._paces.append(self._pace(vehicle))
