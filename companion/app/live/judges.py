"""The verdicts on every vehicle of a link: a judge for each, over one stream."""

from __future__ import annotations

from collections.abc import Callable

from companion.analysis import LiveVerdict
from companion.app.live.judge import MOST_S, Judge, Judging, new_stream
from companion.app.live.pace import Pace

_MOST_JUDGED = 8  # vehicles: each costs the processor as much as one alone


class Judges:
    """Give `hear` what arrives, and `step` the time as often as you like.

    judging: makes what judges a flight, one for each vehicle. vehicle: SYSID or SYSID:COMPID; None: the first that
    sends an IMU, as long as it is heard; "all": each of the first eight. imu: as for `Judge`.
    """

    def __init__(
        self,
        judging: Callable[[], Judging],
        *,
        dialect: str,
        dequantise: bool = False,
        imu: str | None = None,
        vehicle: str | None = None,
    ) -> None:
        self._judging = judging
        self._imu, self._dialect = imu, dialect
        self._all = vehicle == "all"
        self._stream = new_stream(dialect, dequantise=dequantise)
        self._newest = 0.0
        self._paces = [self._pace(None if self._all else vehicle)]

    def hear(self, data: bytes, received: float) -> None:
        """Take bytes that arrived at `received` s UNIX."""
        self._stream.push(data, received)
        self._newest = received
        for pace in self._paces:
            pace.judge.received_at(received)

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
        judge = Judge(self._judging(), dialect=self._dialect, imu=self._imu, vehicle=vehicle, stream=self._stream)
        judge.received_at(self._newest)
        return Pace(judge)

    def _meet(self, judge: Judge) -> None:
        """Judge the others too that it has met, where all are asked for."""
        if not self._all:
            return
        judge.vehicle = judge.last.vehicle or judge.vehicle
        kept = self._newest - MOST_S  # nothing is known of a vehicle any more that was silent for so long
        self._paces = [one for one in self._paces if one.judge is judge or not 0.0 < one.judge.last.newest < kept]
        known = {pace.judge.vehicle for pace in self._paces}
        for vehicle in judge.others:
            if vehicle not in known and len(self._paces) < _MOST_JUDGED:
                self._paces.append(self._pace(vehicle))
