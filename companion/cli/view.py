"""`companion view`: a log replayed in the browser, or a link as it is now."""

from __future__ import annotations

import argparse
import webbrowser
from dataclasses import replace
from pathlib import Path

from companion.analysis import Assessment, expected_since_anchor, gravity_for, replay
from companion.cli import live, options
from companion.errors import SettingsError
from companion.examination import assess_imu, integration_of
from companion.mavlink import is_link
from companion.tracks import Flight

_OF_LINKS = ("rate", "listen-only", "output", "no-record")


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    parser = options.add_command(
        commands,
        "view",
        "See the flight twice in the browser: as the autopilot had it and as the IMU alone would have it. "
        "A log is replayed; a link is shown live, and recorded.",
        "companion view flight.tlog --open, companion view udpin:0.0.0.0:14550",
        takes_link=True,
    )
    options.add_flight_choice(parser)
    options.add_integration(parser)
    parser.add_argument("--host", help="address to serve on (default: 127.0.0.1, this computer alone)")
    parser.add_argument("--port", type=int, help="port to serve on (default: 8080; the next free one when taken)")
    parser.add_argument(
        "--reanchor",
        dest="reanchor_s",
        type=float,
        metavar="S",
        help="start again from the autopilot's state every S seconds; 0 lets it run free (default: 10)",
    )
    on_link = parser.add_argument_group("on a link")
    live.add_manners(on_link)
    on_link.add_argument("-o", "--output", metavar="FILE", help=live.OUTPUT)
    on_link.add_argument("--no-record", action="store_true", help="record nothing")
    parser.add_argument("--open", action="store_true", help="open the browser")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C."""
    if is_link(arguments.log) and not Path(arguments.log).is_file():
        from companion.cli import view_link  # noqa: PLC0415  (viser is slow to import)

        if arguments.boot is not None:
            raise SettingsError("--boot chooses a flight of a log; a link shows the present one.")
        return view_link.run(arguments)
    given = [f"--{name}" for name in _OF_LINKS if getattr(arguments, name.replace("-", "_"))]
    if given:
        raise SettingsError(f"{' and '.join(given)} is for a link, and {arguments.log} is none.")
    return _replay(arguments)


def _replay(arguments: argparse.Namespace) -> int:
    from companion.view import (  # noqa: PLC0415  (viser is slow to import)
        Envelope,
        Mark,
        Reckoning,
        ReplayChoice,
        Viewer,
        without_bias,
    )

    settings = options.settings_of(arguments)
    recording = options.read(arguments, settings)
    chosen = options.choose(recording.flights, arguments)
    integration = settings.integration
    known: dict[tuple[int, str | None], Assessment] = {}

    def assessed(flight: Flight, imu: str | None) -> Assessment:
        """The same numbers as `companion analyze`, once for each IMU."""
        if (id(flight), imu) not in known:
            known[id(flight), imu] = assess_imu(flight, settings, imu=imu)
        return known[id(flight), imu]

    def recompute(flight: Flight, choice: ReplayChoice) -> Reckoning:
        shown = replay(
            without_bias(flight, choice),
            imu=choice.imu,
            how=replace(
                integration_of(settings, flight),
                method=choice.method,
                middle=choice.middle,
                segments=choice.segments,
                gravity=gravity_for(flight, choice.gravity),
            ),
            reanchor_s=choice.reanchor_s,
            start_s=choice.start_s,
        )
        found = assessed(flight, choice.imu)
        marks = tuple(
            Mark(f.start_s, f"{f.kind.replace('_', ' ')}: {f.evidence}", "finding") for f in found.verdict.findings
        )
        sigma = expected_since_anchor(found, shown)
        return Reckoning(shown, envelope=Envelope(*sigma) if sigma else None, findings=marks)

    start = ReplayChoice(
        imu=arguments.imu,
        method=integration.method,
        middle=integration.middle,
        reanchor_s=settings.view.reanchor_s or None,
        start_s=None,
        segments=integration.segments,
        gravity=integration.gravity,
    )
    with Viewer(
        recording.flights,
        recompute,
        flight=chosen,
        choice=start,
        host=settings.view.host,
        port=settings.view.port,
    ) as viewer:
        if viewer.port != settings.view.port:
            options.say(f"port {settings.view.port} is taken: using {viewer.port}")
        if viewer.warning:
            options.say(viewer.warning)
        print(f"Replay of {arguments.log}: {viewer.url}  (Ctrl-C ends it)", flush=True)
        if arguments.open:
            webbrowser.open(viewer.url)
        viewer.run()
    return 0
