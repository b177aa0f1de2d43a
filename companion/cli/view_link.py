"""`companion view LINK`: the live page, and the recording that goes on behind it."""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
import webbrowser
from collections import deque
from collections.abc import Callable, Sequence

import msgspec

from companion.analysis import DriftRow, Integration
from companion.app.examination import limits_of
from companion.app.live import Attachment, Watch
from companion.app.memory import give_back
from companion.app.running_verdict import Assignment, RunningVerdict
from companion.app.settings import Settings
from companion.cli import live, options, unexpected_error
from companion.links import Clock, Recorder, RequestState, Session
from companion.model import CompanionError, SettingsError
from companion.view import LONGEST_REANCHOR_S, Judgement, LinkState, LiveViewer, ReplayChoice, Seen, StreamState

_MOST_SAID = 100  # sentences that the page keeps
_AGES_S = (0.5, 2.0, 5.0, 10.0, LONGEST_REANCHOR_S)  # since an anchor, at which the charts know what is expected
_GIVE_BACK_S = 5.0  # between two times that freed memory is given back
_NOTES = {RequestState.FINDING: "asking", RequestState.ASKING: "asking", RequestState.GIVEN_UP: "given up"}


def run(arguments: argparse.Namespace) -> int:
    """Serve the live page and record until Ctrl-C or SIGTERM; then give the vehicle its message intervals back."""
    settings = options.settings_of(arguments)
    if not settings.view.reanchor_s > 0:
        raise SettingsError("--reanchor is positive on a link; the free run is shown beside it.")
    with contextlib.ExitStack() as opened:
        told = opened.enter_context(live.until_told())
        patience = live.patience_of(arguments)
        link = opened.enter_context(live.open_link(arguments.log, arguments, settings, patience, told))
        recorder = None if arguments.no_record else opened.enter_context(Recorder(arguments.output))
        session = Session(link, choice=live.choice_of(arguments, settings), recorder=recorder, remember=True)
        attachment = opened.enter_context(Attachment(session))
        try:
            _show(attachment, arguments, settings, recorder, lambda: bool(told()) or patience.over(link.health.frames))
        except CompanionError:
            raise
        except Exception as error:
            if recorder is None:
                raise
            unexpected_error.tell(error, sys.argv[1:])
            live.say("The page has ended. The recording goes on; Ctrl-C ends it.")
        while recorder is not None and not told() and attachment.alive and not patience.over(link.health.frames):
            for sentence in attachment.said():
                live.say(sentence)
            time.sleep(0.1)
        attachment.close()
        for sentence in attachment.said():
            live.say(sentence)
        attachment.check()
    if recorder is not None:
        return live.conclude(link, recorder)
    return 0 if link.health.frames else live.nothing_heard()


def _show(
    attachment: Attachment,
    arguments: argparse.Namespace,
    settings: Settings,
    recorder: Recorder | None,
    told: Callable[[], bool],
) -> None:
    """Serve the page until it is told to end. An error of the page is raised here."""
    with contextlib.ExitStack() as opened:
        feed = _Feed(attachment, _choice(arguments, settings), arguments, settings)
        opened.callback(feed.close)
        viewer = opened.enter_context(
            LiveViewer(
                feed,
                window_s=60.0 * settings.live.window_min,
                host=settings.view.host,
                port=settings.view.port,
                token=settings.view.token,
            )
        )
        _announce(arguments, settings, viewer, recorder)
        due = 0.0
        while not told() and not viewer.stopped and attachment.alive:
            for sentence in feed.news():
                live.say(sentence)
            if time.monotonic() >= due:
                due = time.monotonic() + _GIVE_BACK_S
                give_back()
            time.sleep(0.1)
        if told():
            attachment.close()  # first of all: the vehicle gets its intervals back
        viewer.close()  # its thread takes no more sentences from the link's
        for sentence in feed.news():
            live.say(sentence)


def _choice(arguments: argparse.Namespace, settings: Settings) -> ReplayChoice:
    chosen = settings.integration
    how = Integration(chosen.method, chosen.middle, chosen.segments, limits=limits_of(settings))
    return ReplayChoice(imu=arguments.imu, how=how, gravity=chosen.gravity)


def _announce(arguments: argparse.Namespace, settings: Settings, viewer: LiveViewer, recorder: Recorder | None) -> None:
    if viewer.port != settings.view.port:
        live.say(f"port {settings.view.port} is taken: using {viewer.port}")
    if viewer.warning:
        live.say(viewer.warning)
    where = f"recording into {recorder.path}" if recorder else "not recorded"
    live.tell(f"Live view of {arguments.log}, {where}: {viewer.url}  (Ctrl-C ends it)")
    if arguments.open:
        webbrowser.open(viewer.url)


def _in_words(clock: Clock) -> str:
    booted = time.strftime("%H:%M:%S", time.localtime(clock.booted))
    rate = "" if clock.rate_ppm is None else f", its clock runs {clock.rate_ppm:+.0f} ppm"
    return f"Booted at {booted} by our clock{rate}"


class _Feed:
    """What the live page looks at, from the link's thread and the verdict's process."""

    def __init__(
        self, attachment: Attachment, choice: ReplayChoice, arguments: argparse.Namespace, settings: Settings
    ) -> None:
        self._said: deque[str] = deque(maxlen=_MOST_SAID)
        self._news: deque[str] = deque()
        self._attachment, self._choice = attachment, choice
        self._watch = Watch(
            dialect=settings.log.dialect,
            dequantise=settings.log.dequantise,
            how=choice.integration,
            horizons=settings.drift.horizons_s,
            imu=choice.imu,
            vehicle=None if arguments.vehicle == "all" else arguments.vehicle,
            reanchor_s=settings.view.reanchor_s,
            most_reanchor_s=max(settings.view.reanchor_s, LONGEST_REANCHOR_S),
        )
        self._settings = settings
        self._verdict = RunningVerdict(self._assignment(None if arguments.vehicle == "all" else arguments.vehicle))

    @property
    def said(self) -> Sequence[str]:
        """The newest sentences. A copy, made at once: the page draws while `look` adds to them."""
        return tuple(self._said)

    @property
    def choice(self) -> ReplayChoice:
        return self._choice

    def choose(self, choice: ReplayChoice) -> None:
        self._choice = choice
        self._watch.choose(choice.imu, choice.integration)
        self._verdict.assign(self._assignment(self._vehicle))

    def _assignment(self, vehicle: str | None) -> Assignment:
        """The verdict rests on what the page reckons with."""
        self._vehicle, how = vehicle, self._choice.how
        chosen = msgspec.structs.replace(
            self._settings.integration, method=how.method, middle=how.middle, segments=how.segments
        )
        return Assignment(
            msgspec.structs.replace(self._settings, integration=chosen),
            imu=self._choice.imu,
            vehicle=vehicle,
            ages_s=_AGES_S,
        )

    @property
    def reanchor_s(self) -> float:
        return self._watch.reanchor_s

    @reanchor_s.setter
    def reanchor_s(self, seconds: float) -> None:
        self._watch.reanchor_s = seconds

    @property
    def why_not(self) -> str:
        return self._watch.why_not

    @property
    def vehicles(self) -> Sequence[str]:
        return self._watch.vehicles

    @property
    def link(self) -> LinkState:
        report = self._attachment.report
        return LinkState(
            link=report.link,
            problem=report.problem,
            streams=tuple(
                StreamState(a.name, a.wanted_hz, a.received_hz, _NOTES.get(a.state, "")) for a in report.arriving
            ),
            frames=report.frames,
            lost=report.lost_by,
            rejected=report.unsigned + report.wrongly_signed,
            latency_ms=report.clock.latency_ms if report.clock else None,
            clock=_in_words(report.clock) if report.clock else "",
            recording=report.recording,
            recorded_bytes=report.recorded_bytes,
            recording_problem=report.recording_problem,
        )

    @property
    def drift(self) -> Sequence[DriftRow]:
        return self._watch.drift

    @property
    def judgement(self) -> Judgement:
        opinion = self._verdict.opinion
        return Judgement(opinion.status, opinion.text, self._verdict.age_s, *opinion.so_far, opinion.expected)

    def look(self) -> Seen | None:
        for sentence in self._attachment.said():
            self._said.append(f"{time.strftime('%H:%M:%S')} {sentence}")
            self._news.append(sentence)
        receipts = self._attachment.fetch()
        self._watch.hear(receipts)
        self._verdict.hear(receipts)
        found = self._watch.look()
        if found is None:
            return None
        present = found.present
        if (shown := str(present.flight.vehicle)) != self._vehicle:
            self._verdict.assign(self._assignment(shown))
        return Seen(present.flight, present.imu, present.replay, found.free)

    def pick(self, vehicle: str) -> None:
        self._watch.pick(vehicle)

    def anchor_now(self) -> None:
        self._watch.anchor_now()

    def news(self) -> list[str]:
        """The sentences that the terminal has not shown yet."""
        found = []
        while self._news:
            found.append(self._news.popleft())
        return found

    def close(self) -> None:
        """End the verdict's process."""
        self._verdict.close()
