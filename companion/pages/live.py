"""The source of the live page: the link's thread, the drift so far and the verdict's process, as one."""

from __future__ import annotations

import time
from collections import deque

import msgspec

from companion.app.live import Attachment, Watch
from companion.app.running_verdict import Assignment, RunningVerdict
from companion.app.sensors import preflight_of
from companion.app.settings import Settings
from companion.links import Clock, RequestState
from companion.model import DataError, Flight
from companion.verdict import Preflight
from companion.view import LONGEST_REANCHOR_S, LinkState, LiveStatus, ReplayChoice, Seen, StreamState

_MOST_MESSAGES = 100  # that the page keeps
_AGES_S = (0.5, 2.0, 5.0, 10.0, LONGEST_REANCHOR_S)  # since an anchor, at which the charts know what is expected
_CHECKED_S = 4.0  # between two runs of the checks before take-off: nothing moves in the picture meanwhile
_NOTES = {RequestState.FINDING: "asking", RequestState.ASKING: "asking", RequestState.GIVEN_UP: "given up"}


class LiveFeed:
    """The source of the live page, from the link's thread and the verdict's process."""

    def __init__(self, attachment: Attachment, choice: ReplayChoice, vehicle: str | None, settings: Settings) -> None:
        """vehicle: SYSID or SYSID:COMPID; None: the one with the most IMU samples."""
        self._messages: deque[str] = deque(maxlen=_MOST_MESSAGES)
        self._news: deque[str] = deque()
        self._attachment, self._choice = attachment, choice
        self._watch = Watch(
            dialect=settings.log.dialect,
            dequantise=settings.log.dequantise,
            how=choice.integration,
            horizons=settings.drift.horizons_s,
            imu=choice.imu,
            vehicle=vehicle,
            reanchor_s=settings.view.reanchor_s,
            most_reanchor_s=max(settings.view.reanchor_s, LONGEST_REANCHOR_S),
        )
        self._settings = settings
        self._flight: Flight | None = None  # the last seconds of the vehicle that is looked at
        self._preflight: Preflight | None = None
        self._check_due = 0.0  # s of the steady clock
        self._verdict = RunningVerdict(self._assignment())

    @property
    def choice(self) -> ReplayChoice:
        return self._choice

    def choose(self, choice: ReplayChoice) -> None:
        self._choice = choice
        self._watch.choose(choice.imu, choice.integration)
        self._verdict.assign(self._assignment())

    def _assignment(self) -> Assignment:
        """The verdict rests on what the page integrates; every vehicle is judged."""
        how = self._choice.how
        chosen = msgspec.structs.replace(
            self._settings.integration, method=how.method, middle=how.middle, segments=how.segments
        )
        return Assignment(
            msgspec.structs.replace(self._settings, integration=chosen),
            imu=self._choice.imu,
            vehicle="all",
            ages_s=_AGES_S,
        )

    @property
    def reanchor_s(self) -> float:
        return self._watch.replay.reanchor_s

    @reanchor_s.setter
    def reanchor_s(self, seconds: float) -> None:
        self._watch.replay.reanchor_s = seconds

    @property
    def status(self) -> LiveStatus:
        """The messages are a copy, made at once: the page draws while `look` adds to them."""
        link, flight = self._link, self._flight
        silent, shown = bool(link.problem), "" if flight is None else str(flight.vehicle)
        others = [name for name in self._verdict.vehicles if shown and name not in ("", shown)]
        if (now := time.monotonic()) >= self._check_due:
            self._check_due = now + _CHECKED_S
            self._preflight = None if flight is None else checks_on_the_ground(flight)
        return LiveStatus(
            link,
            self._verdict.read(shown, silent=silent),
            [self._verdict.read(name, silent=silent) for name in others],
            self._watch.why_not,
            self._watch.replay.vehicles,
            tuple(self._messages),
            self._watch.drift,
            self._preflight,
        )

    @property
    def _link(self) -> LinkState:
        report = self._attachment.report
        return LinkState(
            link=report.link,
            problem=report.problem,
            streams=tuple(
                StreamState(a.name, a.desired_hz, a.received_hz, _NOTES.get(a.state, "")) for a in report.arriving
            ),
            frames=report.frames,
            lost=report.lost_by,
            rejected=report.rejected,
            latency_ms=report.clock.latency_ms if report.clock else None,
            clock=_in_words(report.clock) if report.clock else "",
            recording=report.recording,
            recorded_bytes=report.recorded_bytes,
            recording_problem=report.recording_problem,
        )

    def wait(self, timeout_s: float) -> None:
        self._attachment.wait(timeout_s)

    def look(self) -> Seen | None:
        for sentence in self._attachment.notices():
            self._messages.append(f"{time.strftime('%H:%M:%S')} {sentence}")
            self._news.append(sentence)
        receipts = self._attachment.fetch()
        self._watch.receive(receipts)
        self._verdict.receive(receipts)
        sighting = self._watch.look()
        if sighting is None:
            return None
        present = sighting.present
        self._flight = present.flight
        return Seen(present.flight, present.imu, present.replay, sighting.free)

    def pick(self, vehicle: str) -> None:
        self._watch.replay.vehicle = vehicle

    def anchor_now(self) -> None:
        self._watch.anchor_now()

    def news(self) -> list[str]:
        """The sentences that the terminal has not shown yet."""
        return [self._news.popleft() for _ in range(len(self._news))]

    def close(self) -> None:
        """End the verdict's process."""
        self._verdict.close()


def checks_on_the_ground(flight: Flight) -> Preflight | None:
    """The checks while the vehicle says that it is disarmed, and stands; else None."""
    armed = next((e.kind == "armed" for e in reversed(flight.events) if e.kind in ("armed", "disarmed")), False)
    if armed or "HEARTBEAT" not in flight.messages:
        return None
    try:
        return preflight_of(flight)
    except DataError:
        return None


def _in_words(clock: Clock) -> str:
    booted = time.strftime("%H:%M:%S", time.localtime(clock.booted))
    rate = "" if clock.rate_ppm is None else f", its clock runs {clock.rate_ppm:+.0f} ppm"
    return f"Booted at {booted} by our clock{rate}"
