"""`companion view`: a log replayed in the browser, or a link as it is now."""

from __future__ import annotations

import argparse
import shlex
import sys
import webbrowser
from pathlib import Path

from companion.cli import live, options, parsers
from companion.links import is_link
from companion.model import SettingsError


def add_options(parser: parsers.Parser) -> None:
    """The command's options."""
    parsers.add_log(parser, takes_link=True)
    parsers.add_flight_choice(parser)
    parsers.add_integration(parser)
    parsers.add_imu_model(parser)
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
    parsers.add_reanchor(parser)
    parsers.add_correction(parser)
    parsers.add_anchor(parser)
    parser.add_argument(
        "--map", action="store_true", help="show a map of the ground from the start: its tiles come from the network"
    )
    parser.add_argument(
        "--map-url", metavar="URL", help="server of the map's tiles, with {z}, {x} and {y} (default: OpenStreetMap's)"
    )
    on_link = parser.add_argument_group("on a link")
    live.add_request_options(on_link)
    on_link.add_argument("-o", "--output", metavar="FILE", help=live.OUTPUT)
    on_link.add_argument("--no-record", action="store_true", help="record nothing")
    parser.add_argument("--open", action="store_true", help="open the browser")


def run(arguments: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C or SIGTERM."""
    if is_link(arguments.log) and not Path(arguments.log).is_file():
        from companion.cli import view_link  # noqa: PLC0415  (viser is slow to import)

        if arguments.boot is not None:
            raise SettingsError("--boot chooses a flight of a log; a link shows the present one.")
        if arguments.anchor == "rest":
            raise SettingsError("--anchor rest is for a log: on a link the flight has only begun.")
        if arguments.map or arguments.map_url:
            raise SettingsError("--map is for a log: a link's page has no map.")
        return view_link.run(arguments)
    live.refuse_link_options(arguments, "no-record")
    return _replay(arguments)


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
        if other := options.other_port(settings.view.port, viewer.port):
            options.say(other)
        if viewer.warning:
            options.say(viewer.warning)
        with live.until_signal(outlive_terminal=False) as ended:
            print(f"Replay of {arguments.log}: {viewer.url}  (Ctrl-C ends it)", flush=True)
            if arguments.open:
                webbrowser.open(viewer.url)
            viewer.run(ended)
    return 0
