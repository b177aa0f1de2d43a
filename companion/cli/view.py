"""`companion view LOG`: the replay in the browser."""

from __future__ import annotations

import argparse
import webbrowser
from dataclasses import replace

from companion.analysis import Assessment, expected_since_anchor, gravity_for, replay
from companion.cli import options
from companion.examination import assess_imu, integration_of
from companion.tracks import Flight


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    parser = options.add_command(
        commands,
        "view",
        "See the flight twice in the browser: as the autopilot had it and as the IMU alone would have it.",
        "companion view flight.tlog --open",
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
    parser.add_argument("--open", action="store_true", help="open the browser")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Serve the replay until Ctrl-C."""
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
