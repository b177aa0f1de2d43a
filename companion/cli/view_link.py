"""`companion view LINK`: the live page, and the recording that goes on behind it."""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
import webbrowser
from collections.abc import Callable

from companion.analysis import Integration
from companion.app.examination import limits_of
from companion.app.live import Attachment
from companion.app.resources import give_back
from companion.app.settings import Settings
from companion.cli import live, options, unexpected_error
from companion.links import Recorder, Session
from companion.model import CompanionError, SettingsError
from companion.pages.live import LiveFeed
from companion.view import LiveViewer, ReplayChoice

_GIVE_BACK_S = 5.0  # between two times that freed memory is given back


def run(arguments: argparse.Namespace) -> int:
    """Serve the live page and record until Ctrl-C or SIGTERM; then give the vehicle its message intervals back."""
    settings = options.settings_of(arguments)
    if not settings.view.reanchor_s > 0:
        raise SettingsError("--reanchor is positive on a link; the free run is shown beside it.")
    with contextlib.ExitStack() as opened:
        ended = opened.enter_context(live.until_signal())
        patience = live.patience_of(arguments)
        link = opened.enter_context(live.open_link(arguments.log, arguments, settings, patience, ended))
        recorder = None if arguments.no_record else opened.enter_context(Recorder(arguments.output))
        session = Session(link, choice=live.choice_of(arguments, settings), recorder=recorder, remember=True)
        attachment = opened.enter_context(Attachment(session))
        try:
            _show(attachment, arguments, settings, recorder, lambda: bool(ended()) or patience.over(link.health.frames))
        except CompanionError:
            raise
        except Exception as error:
            if recorder is None:
                raise
            unexpected_error.report(error, sys.argv[1:])
            live.say("The page has ended. The recording goes on; Ctrl-C ends it.")
        while recorder is not None and not ended() and attachment.alive and not patience.over(link.health.frames):
            for sentence in attachment.notices():
                live.say(sentence)
            time.sleep(0.1)
        attachment.close()
        for sentence in attachment.notices():
            live.say(sentence)
        attachment.check()
    if recorder is not None:
        return live.conclude(link, recorder, restored=attachment.restored)
    if not link.health.frames:
        return live.nothing_received()
    return 0 if attachment.restored else 2


def _show(
    attachment: Attachment,
    arguments: argparse.Namespace,
    settings: Settings,
    recorder: Recorder | None,
    ended: Callable[[], bool],
) -> None:
    """Serve the page until it is ended. An error of the page is raised here."""
    with contextlib.ExitStack() as opened:
        vehicle = None if arguments.vehicle == "all" else arguments.vehicle
        feed = LiveFeed(attachment, _choice(arguments, settings), vehicle, settings)
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
        while not ended() and not viewer.stopped and attachment.alive:
            for sentence in feed.news():
                live.say(sentence)
            if time.monotonic() >= due:
                due = time.monotonic() + _GIVE_BACK_S
                give_back()
            time.sleep(0.1)
        if ended():
            attachment.close()  # first of all: the vehicle gets its intervals back
        viewer.close()  # its thread takes no more sentences from the link's
        for sentence in feed.news():
            live.say(sentence)


def _choice(arguments: argparse.Namespace, settings: Settings) -> ReplayChoice:
    chosen = settings.integration
    how = Integration(chosen.method, chosen.middle, chosen.segments, limits=limits_of(settings))
    return ReplayChoice(imu=arguments.imu, how=how, gravity=chosen.gravity)


def _announce(arguments: argparse.Namespace, settings: Settings, viewer: LiveViewer, recorder: Recorder | None) -> None:
    if other := options.other_port(settings.view.port, viewer.port):
        live.say(other)
    if viewer.warning:
        live.say(viewer.warning)
    where = f"recording into {recorder.path}" if recorder else "not recorded"
    live.print_line(f"Live view of {arguments.log}, {where}: {viewer.url}  (Ctrl-C ends it)")
    if arguments.open:
        webbrowser.open(viewer.url)
