"""The verdict on a link while it is listened to: the analysis of logs over the last seconds, in a process of its own.

Another process, so that neither the picture nor the recording waits for it; one for the whole session, that is handed
what arrives through its standard input and answers through its standard output. Threads on both sides keep whoever
writes from waiting. It loads what the analysis needs and nothing of the page or of the command line.
"""

from __future__ import annotations

import contextlib
import math
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import IO, Self

import msgspec

from companion.app.examination import assess_imu, give_back
from companion.app.live import Judges, Judging, NothingYetError, new_stream
from companion.app.settings import Settings
from companion.comparison import expected_by_age, phases
from companion.constants import num
from companion.estimation import BestEstimate, Effort
from companion.mavlink import Frames
from companion.model import DataError, Flight, counted
from companion.verdict import (
    Assessment,
    Band,
    Doubt,
    LiveVerdict,
    StandingFault,
    Verdict,
    believable,
    beside_doubt,
    carried_on,
    standing_verdict,
)

_HAND_OVER_S = 0.25  # between two times that what has arrived is handed over: as often as the newest is looked at
_TOGETHER_S = 0.3  # what arrived within it is decoded in one go, which takes a twentieth of the time
_BAND_S = 20.0  # of data between two times that what is expected is computed: it changes slowly
_BEGINS_S = 30.0  # since arming or take-off: what a verdict rests on is only gathered then
# of one piece: more causes are seldom faults, and so many take some two seconds with what they are used for
_EFFORT = Effort(keyframes=120, most_causes=2, most_linearisations=80, looks_again=80)
_MOST_WAITING = 10_000  # receipts: some minutes, while the process starts or the computer sleeps

_BEGIN = "import sys; sys.path[:] = sys.argv[1:]; from companion.app.running_verdict import work; work()"


@dataclass(frozen=True, slots=True)
class Assignment:
    """What is judged, and how."""

    settings: Settings
    imu: str | None = None  # the message; None: the flight's default
    ages_s: tuple[float, ...] = ()  # since an anchor, for which to say what is expected
    vehicle: str | None = None  # SYSID or SYSID:COMPID; None: the first that sends an IMU; "all": each


_Given = tuple[bytes, float] | Assignment
"""Bytes that arrived and when, s UNIX; or what is to be judged from now on."""


class RunningVerdict:
    """Judges until `close`, again and again. Every method answers at once."""

    def __init__(self, assignment: Assignment) -> None:
        self._verdicts = {"": LiveVerdict("", "the first verdict comes when three windows of 5 s are complete")}
        self._several = assignment.vehicle == "all"
        self._ahead = 0.0  # s, of the stamps of what arrives over `time.monotonic()`
        self._waiting: deque[_Given] = deque([assignment], _MOST_WAITING)
        self._closing = threading.Event()
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", _BEGIN, *sys.path],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C and a closed terminal are for who started it
            env={"OPENBLAS_NUM_THREADS": "1", **os.environ},  # as for the commands, whoever has started it
        )
        self._threads = [
            threading.Thread(target=target, name="companion-verdict", daemon=True)
            for target in (self._hand_over, self._take)
        ]
        for thread in self._threads:
            thread.start()

    def read(self, vehicle: str = "", *, silent: bool = False) -> LiveVerdict:
        """What is said of a vehicle, with its age; "": of the first. silent: whether nothing comes on the link now."""
        verdicts = self._verdicts  # replaced as a whole, never changed
        first = next(iter(verdicts.values()))
        one = verdicts.get(vehicle, LiveVerdict("", f"vehicle {vehicle} is not judged yet")) if vehicle else first
        age_s = max(time.monotonic() + self._ahead - one.newest, 0.0) if one.newest else 0.0
        return replace(one, age_s=age_s, silent=silent)

    @property
    def vehicles(self) -> tuple[str, ...]:
        """Those of which something is said, the first first; "" alone where nothing is yet."""
        return tuple(self._verdicts)

    def receive(self, receipts: Iterable[tuple[Frames, float]]) -> None:
        """Take what has arrived."""
        for frames, received in receipts:
            if len(frames):
                self._ahead = received - time.monotonic()
                first, last = int(frames.start[0]), int(frames.start[-1] + frames.size[-1])
                self._waiting.append((frames.data[first:last].tobytes(), received))

    def assign(self, assignment: Assignment) -> None:
        """Judge something else from now on."""
        self._waiting.append(assignment)

    def close(self) -> None:
        """End it, also in the middle of an analysis."""
        self._closing.set()
        self._process.terminate()
        self._process.wait()
        for thread in self._threads:
            thread.join(1.0)
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            with contextlib.suppress(OSError):  # what it has not read is lost with it
                stream.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _hand_over(self) -> None:
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):  # its process has ended: the page goes on without it
            while not self._closing.wait(_HAND_OVER_S):
                for one in joined(self._waiting):
                    _send(self._process.stdin, one)

    def _take(self) -> None:
        assert self._process.stdout is not None
        with contextlib.suppress(EOFError, OSError, pickle.UnpicklingError):  # it has ended, perhaps in a sentence
            while True:
                verdict: LiveVerdict = pickle.load(self._process.stdout)
                known = {who: one for who, one in self._verdicts.items() if who and self._several}
                self._verdicts = {**known, verdict.vehicle: verdict} if verdict.vehicle or not known else known
        if not self._closing.is_set():
            why = "the process that judges has ended: nothing is judged any more until companion is started again"
            self._verdicts = {w: replace(v, status="", text=why, expected=()) for w, v in self._verdicts.items()}


def _send(stream: IO[bytes], one: object) -> None:
    stream.write(pickle.dumps(one))
    stream.flush()


def work() -> None:
    """The process: receives, judges, answers; ends when who started it has gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Windows sends Ctrl-C to every process of the console
    warnings.simplefilter("ignore")
    with contextlib.suppress(BrokenPipeError), os.fdopen(os.dup(1), "wb") as answers:  # who started it was killed
        os.dup2(2, 1)  # what a library prints must not stand between two answers
        _judge_until_the_end(sys.stdin.buffer, answers)


def _judge_until_the_end(given: IO[bytes], answers: IO[bytes]) -> None:
    inbox: queue.SimpleQueue[_Given | None] = queue.SimpleQueue()
    assignment = pickle.load(given)
    threading.Thread(target=_listen, args=(given, inbox), daemon=True).start()
    judges = judges_of(assignment)
    while True:
        for one in _arrived(inbox):
            if one is None:
                return
            if isinstance(one, Assignment):
                judges.choose(partial(verdict_on, one), one.imu)
            else:
                judges.receive(*one)
        live_verdict = judges.step(time.monotonic())
        if live_verdict is not None:
            with contextlib.suppress(OSError):
                _send(answers, live_verdict)
            give_back()  # a third of its memory is needed only while it judges


def joined(waiting: deque[_Given]) -> Iterator[_Given]:
    """Take what waits, in order: what arrived together in one piece, with the time of the last."""
    pieces: list[bytes] = []
    first = last = 0.0
    while waiting:
        one = waiting.popleft()
        if pieces and not (isinstance(one, tuple) and one[1] - first < _TOGETHER_S):
            yield b"".join(pieces), last
            pieces = []
        if isinstance(one, tuple):
            first, last = first if pieces else one[1], one[1]
            pieces.append(one[0])
        else:
            yield one
    if pieces:
        yield b"".join(pieces), last


def _arrived(inbox: queue.SimpleQueue[_Given | None]) -> Iterator[_Given | None]:
    """What has been handed over; waits for the first of it, but no longer than till there may be something to judge."""
    with contextlib.suppress(queue.Empty):
        yield inbox.get(timeout=_HAND_OVER_S)
        while True:
            yield inbox.get_nowait()


def _listen(given: IO[bytes], inbox: queue.SimpleQueue[_Given | None]) -> None:
    with contextlib.suppress(EOFError, OSError, pickle.UnpicklingError):  # cut off in a sentence
        while True:
            inbox.put(pickle.load(given))
    inbox.put(None)


def judges_of(assignment: Assignment) -> Judges:
    """Who judge as an assignment says."""
    log = assignment.settings.log
    stream = new_stream(log.dialect, dequantise=log.dequantise)
    return Judges(partial(verdict_on, assignment), stream, imu=assignment.imu, vehicle=assignment.vehicle)


def verdict_on(assignment: Assignment) -> Judging:
    """The analysis of a log, at the one horizon that the verdict needs."""
    drift = msgspec.structs.replace(assignment.settings.drift, horizons_s=(5.0,))
    settings = msgspec.structs.replace(assignment.settings, drift=drift)

    band: Band = ()
    of: tuple[str, int, str] | None = None  # whose band it is
    made = -math.inf  # s, boot clock, at the end of which data
    before: BestEstimate | None = None
    standing: tuple[StandingFault, ...] = ()
    doubt: Doubt | None = None
    since = 0.0  # s, boot clock, when the vehicle was first received

    def judged(flight: Flight, imu: str | None) -> tuple[Verdict, Band]:
        nonlocal band, of, made, before, standing, doubt, since
        end, now = flight.start + flight.duration, (str(flight.vehicle), flight.boot, flight.imu(imu).source)
        if now != of:
            before = None
        if of is None or now[:2] != of[:2]:
            standing, doubt, since = (), None, flight.start
        try:
            assessment = assess_imu(flight, settings, imu=imu, before=before, effort=_EFFORT)
        except DataError as why:
            of = now
            if not standing:
                raise
            return standing_verdict(standing, Verdict("insufficient_data", str(why), ())), band
        before = assessment.best
        own = believable(assessment.verdict, flight)
        standing = carried_on(standing, flight, own, assessment.best)
        verdict = standing_verdict(standing, own)
        if verdict.status == "insufficient_data" and (begun := _just_begun(flight, assessment, since)):
            of = now
            raise NothingYetError(begun)
        verdict, doubt = beside_doubt(verdict, end, doubt)
        if now != of or len(band) < len(assignment.ages_s) or end - made > _BAND_S:
            of, made = now, end
            budget = assessment.comparison, assessment.imu_spec, assessment.autopilot
            rows = expected_by_age(*budget, assignment.ages_s).tolist()
            band = tuple((age, attitude, velocity, position) for age, attitude, velocity, position in rows)
        return verdict, band

    return judged


def _just_begun(flight: Flight, assessment: Assessment, since: float) -> str:
    """Why a flight cannot be judged yet that has only begun: it has too few windows; "" for any other.

    since: s, boot clock, when the vehicle was first received.
    """
    judged = assessment.agreements[num.JUDGED_S]
    if judged.windows >= num.MIN_WINDOWS or any(f.kind == "rate_too_low" for f in assessment.verdict.findings):
        return ""
    part, end = phases(flight)[-1], flight.start + flight.duration
    armed = max((event.t for event in flight.events if event.kind == "armed"), default=-math.inf)
    takes_off = part.kind == "flight" and part.start > flight.start  # what began before the piece began long ago
    begun = {"heard": since, "armed": armed, "in the air": part.start if takes_off else -math.inf}
    where = max(begun, key=lambda name: begun[name])
    if end - begun[where] > _BEGINS_S:
        return ""
    windows = f"{counted(judged.windows, 'window')} of {num.JUDGED_S:g} s"
    return f"{where} for {end - begun[where]:.0f} s: {windows} of the {num.MIN_WINDOWS} that a verdict needs"
