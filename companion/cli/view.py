"""`companion view`: a log replayed in the browser, or a link as it is now."""

from __future__ import annotations

import argparse
import contextlib
import shlex
import sys
import time
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from companion.app.examination import give_back, limits_of
from companion.app.live import Attachment
from companion.app.settings import Settings
from companion.cli import live, options
from companion.cli.main import report_unexpected
from companion.comparison import Integration
from companion.links import Recorder, is_link
from companion.model import CompanionError, SettingsError

if TYPE_CHECKING:
    from companion.view import LiveViewer, Viewer

_GIVE_BACK_S = 5.0  # between two times that freed memory is given back


def view_options(parser: options.Parser) -> None:
    """The command's options."""
    options.add_log(parser, *options.FLIGHT, *options.INTEGRATION, "--imu-model", takes_link=True)
    parser.add_argument("--host", help="address to serve on (default: 127.0.0.1, this computer alone)")
    parser.add_argument(
        "--port", type=int, help="port to serve on, 0 for any free one (default: 8080; the next free one when taken)"
    )
    parser.add_argument(
        "--token",
        action="store_true",
        default=None,
        help="let in only who has the token in the address, on 127.0.0.1 too (with another --host: always)",
    )
    options.add(parser, "--reanchor", "--correction", "--anchor")
    parser.add_argument(
        "--map", action="store_true", help="show a map of the ground from the start: its tiles come from the network"
    )
    parser.add_argument(
        "--map-url", metavar="URL", help="server of the map's tiles, with {z}, {x} and {y} (default: OpenStreetMap's)"
    )
    on_link = parser.add_argument_group("on a link")
    live.add_request_options(on_link)
    live.add_recording(on_link)
    on_link.add_argument("--no-record", action="store_true", help="record nothing")
    parser.add_argument("--open", action="store_true", help="open the browser")


def run_view(arguments: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C or SIGTERM."""
    if not is_link(arguments.log) or Path(arguments.log).is_file():
        live.refuse_link_options(arguments, "no-record")
        return _replay(arguments)
    if arguments.boot is not None:
        raise SettingsError("--boot chooses a flight of a log; a link shows the present one.")
    if arguments.anchor == "rest":
        raise SettingsError("--anchor rest is for a log: on a link the flight has only begun.")
    if arguments.map or arguments.map_url:
        raise SettingsError("--map is for a log: a link's page has no map.")
    return _live(arguments)


def _replay(arguments: argparse.Namespace) -> int:
    from companion.pages.replay import Answers, open_replay  # noqa: PLC0415  (viser is slow to import)
    from companion.view import check_url  # noqa: PLC0415

    settings = options.settings_of(arguments)
    check_url(settings.view.map_url)
    rest = arguments.anchor == "rest"
    if rest and arguments.reanchor_s:
        raise SettingsError("--anchor rest is never anchored again: leave --reanchor out.")
    answers = Answers(
        settings,
        imu_model=arguments.imu_model,
        correction=arguments.correction,
        from_rest=rest,
        command=shlex.join(["companion", *sys.argv[1:]]),
    )
    recording = options.read(arguments, settings)
    with open_replay(
        answers,
        recording.flights,
        chosen=options.choose(recording, arguments),
        imu=arguments.imu,
        source=recording.source,
        map_shown=arguments.map,
        port=settings.view.port,
    ) as viewer:
        _warn(settings, viewer)
        with live.until_signal(outlive_terminal=False) as ended:
            print(f"Replay of {arguments.log}: {viewer.url}  (Ctrl-C ends it)", flush=True)
            if arguments.open:
                webbrowser.open(viewer.url)
            viewer.run(ended)
    return 0


def _warn(settings: Settings, viewer: LiveViewer | Viewer) -> None:
    """Of another port than the one that was requested, and of what the viewer warns of."""
    if settings.view.port not in (0, viewer.port):
        live.say(f"port {settings.view.port} is taken: using {viewer.port}")
    if viewer.warning:
        live.say(viewer.warning)


def _live(arguments: argparse.Namespace) -> int:
    """Serve the live page and record; at the end give the vehicle its message intervals back."""
    settings = options.settings_of(arguments)
    if not settings.view.reanchor_s > 0:
        raise SettingsError("--reanchor is positive on a link; the free run is shown beside it.")
    with live.session_on(arguments.log, arguments, settings) as (session, over), Attachment(session) as attachment:
        try:
            _show(attachment, session.recorder, arguments, settings, over)
        except CompanionError:
            raise
        except Exception as error:
            if session.recorder is None:
                raise
            report_unexpected(error, sys.argv[1:])
            live.say("The page has ended. The recording goes on; Ctrl-C ends it.")
        while session.recorder is not None and not over() and attachment.alive:
            live.say_all(attachment.notices())
            time.sleep(0.1)
        attachment.close()
        live.say_all(attachment.notices())
        attachment.check()
    return live.conclude(session, restored=attachment.restored)


def _show(
    attachment: Attachment,
    recorder: Recorder | None,
    arguments: argparse.Namespace,
    settings: Settings,
    over: Callable[[], bool],
) -> None:
    """Serve the page until it is over. An error of the page is raised here."""
    from companion.pages.live import LiveFeed  # noqa: PLC0415  (viser is slow to import)
    from companion.view import LiveViewer, ReplayChoice  # noqa: PLC0415

    chosen, view = settings.integration, settings.view
    how = Integration(chosen.method, chosen.middle, chosen.segments, limits=limits_of(settings))
    choice = ReplayChoice(imu=arguments.imu, how=how, gravity=chosen.gravity)
    vehicle = None if arguments.vehicle == "all" else arguments.vehicle
    window_s = 60.0 * settings.live.window_min
    with (
        contextlib.closing(LiveFeed(attachment, choice, vehicle, settings)) as feed,
        LiveViewer(feed, window_s=window_s, host=view.host, port=view.port, token=view.token) as viewer,
    ):
        _warn(settings, viewer)
        where = f"recording into {recorder.path}" if recorder else "not recorded"
        live.print_line(f"Live view of {arguments.log}, {where}: {viewer.url}  (Ctrl-C ends it)")
        if arguments.open:
            webbrowser.open(viewer.url)
        due = 0.0
        while not over() and not viewer.stopped and attachment.alive:
            live.say_all(feed.news())
            if time.monotonic() >= due:
                due = time.monotonic() + _GIVE_BACK_S
                give_back()
            time.sleep(0.1)
        if over():
            attachment.close()  # first of all: the vehicle gets its intervals back
        viewer.close()  # its thread takes no more sentences from the link's
        live.say_all(feed.news())
