"""When the newest data are looked at, and when they are judged."""

from __future__ import annotations

import time

from companion.live.opinion import Judge, Opinion

_LOOK_S = 0.25  # between two looks at whether something has just begun
_PAUSE_S = 3.5  # between the begins of two judgements: none is older than 5 s where one takes less than 1.5 s
_SHARE = 4.0  # times as long as the processor was busy with one: at most a quarter of a core on a slow computer
_CALLED_S = 2.5  # of the processor, from one in turn to the next, for those that looks call: five of 0.5 s


class Pace:
    """Give `step` the time as often as you like. A look costs a fortieth of a judgement, and calls one at once."""

    def __init__(self, judge: Judge) -> None:
        self._judge = judge
        self._due = self._look = 0.0  # s of the clock of `step`
        self._called = 0.0  # s that the processor was busy with those since the last in turn
        self._judged = self._looked = 0.0  # s UNIX, the newest data of then

    def at_once(self) -> None:
        """Judge at the next step: something else is to be judged."""
        self._due = self._judged = 0.0

    def step(self, now: float) -> Opinion | None:
        """What is to be said now; None where nothing is new. now: s of any steady clock."""
        judge = self._judge
        if judge.newest == self._judged:
            return None
        if now < self._due:
            if self._called >= _CALLED_S or now < self._look or judge.newest == self._looked:
                return None
            self._look, self._looked = now + _LOOK_S, judge.newest
            if not judge.stirred():
                return None
        else:
            self._called = 0.0
        self._judged = judge.newest
        before = time.process_time()
        try:
            opinion = judge.judge()
        except Exception as error:  # noqa: BLE001  (a defect of the analysis must not end the verdicts)
            opinion = Opinion("", f"no verdict ({type(error).__name__}: {error})", 0.0)
        busy = time.process_time() - before
        self._called += busy
        self._due = now + max(_PAUSE_S, _SHARE * busy)
        return opinion
