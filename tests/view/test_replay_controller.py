"""What stands behind the page of a log, without a browser."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import viser

from companion.model import DataError, Flight
from companion.view import AnalysisResult, DisplayTrajectory, Offer, ReplayChoice, display_trajectory
from companion.view.replay_controller import ReplayController
from tests.view.browsing import until
from tests.view.circles import dead_reckon, make_flight, recompute

CHOICE = ReplayChoice(imu="RAW_IMU")


def without_position(flight: Flight, choice: ReplayChoice) -> DisplayTrajectory:
    """The first vehicle as it is, the others without a position."""
    if flight.vehicle.sysid == 1:
        return recompute(flight, choice)
    shown = dead_reckon(flight, choice)
    none = np.zeros_like(shown.position_ref)
    attitude = replace(shown, has_position=False, position_ref=none, position_imu=none, position_error=none)
    return display_trajectory(attitude, flight.imu(choice.imu))


def fails(*_: object) -> AnalysisResult:
    raise DataError("No <usable> window.")


def controller_of(
    server: viser.ViserServer, *flights: Flight, examine: Callable[..., AnalysisResult] = fails
) -> ReplayController:
    first = flights[0]
    shown = without_position(first, CHOICE)
    return ReplayController(
        server, flights, without_position, examine, Offer(), first, CHOICE, shown, lambda _call: None
    )


def turned(controller: ReplayController, done: Callable[[], bool]) -> Callable[[], bool]:
    def look() -> bool:
        controller.turn(time.monotonic() + 10.0, 0.01)
        return done()

    return look


def test_an_analysis_that_cannot_be_made_is_not_in_progress(flight: Flight, server: viser.ViserServer) -> None:
    controller = controller_of(server, flight)
    until(turned(controller, lambda: "&lt;usable&gt;" in controller._panel._banner.content), "the analysis")
    controller.charts.pick("Drift by horizon")
    for place in (controller._drift, controller.charts._hint):
        assert "No &lt;usable&gt; window." in place.content
    controller.close()


def test_progress_does_not_take_the_place_of_what_has_failed(flight: Flight, server: viser.ViserServer) -> None:
    done = threading.Event()

    def slow(*_: object) -> AnalysisResult:
        done.wait()
        raise DataError("none")

    controller = controller_of(server, flight, examine=slow)
    status = controller._panel._status
    turned(controller, bool)()
    controller._complain("No map.")
    until(turned(controller, lambda: "has worked" in status.content), "progress")
    done.set()
    until(turned(controller, lambda: "No map." in status.content), "the complaint")
    controller.close()


def test_another_flight_has_nothing_of_the_one_before(flight: Flight, server: viser.ViserServer) -> None:
    other = make_flight(sysid=2)
    controller = controller_of(server, flight, other)
    turned(controller, bool)()
    assert controller._timeline._played is not None
    assert not controller.scene.autopilot.label.visible, "both drones have one name where they are together"
    controller.pick_flight(other)
    until(turned(controller, lambda: controller._flight is other), "the other flight")
    pointed_at = (controller._timeline._played, controller._timeline._moment)
    assert not any(pointed_at)
    assert controller.scene.autopilot.label.visible
    controller.close()


def test_the_control_shows_the_direction_in_which_it_plays(flight: Flight, server: viser.ViserServer) -> None:
    controller = controller_of(server, flight)
    backwards = controller._timeline._backwards
    controller.player.backwards = True
    until(turned(controller, lambda: bool(backwards.value)), "the direction")
    controller._timeline.play()
    until(turned(controller, lambda: not backwards.value), "the other direction")
    controller.close()
