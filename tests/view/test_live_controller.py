"""What stands behind the live page, without a browser."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
import viser

from companion.comparison.replay import FreeState
from companion.model import Flight
from companion.model.tracks import NavState
from companion.verdict import LiveVerdict
from companion.view import LinkState, LiveStatus, LiveViewer, ReplayChoice, Seen, live_controller
from companion.view.live_controller import LiveController
from companion.view.state.trajectory import samples_of
from tests.view.browsing import until
from tests.view.circles import dead_reckon


@dataclass
class Script:
    """A feed that shows what it is given."""

    now: Seen | None = None
    reanchor_s: float = 10.0
    choice: ReplayChoice = field(default_factory=ReplayChoice)
    status: LiveStatus = field(
        default_factory=lambda: LiveStatus(LinkState("a link"), LiveVerdict("", ""), vehicles=("1:1", "2:1"))
    )

    def wait(self, timeout_s: float) -> None:
        """It is all there."""

    def look(self) -> Seen | None:
        return self.now

    def choose(self, choice: ReplayChoice) -> None:
        self.choice = choice

    def anchor_now(self) -> None:
        """There is nothing to begin anew."""

    def pick(self, vehicle: str) -> None:
        """There is one."""


def test_a_position_that_comes_after_the_first_attitude_is_shown(flight: Flight) -> None:
    replay = dead_reckon(flight, ReplayChoice(imu="RAW_IMU"))
    nowhere = np.zeros_like(replay.position_ref)
    attitude = replace(
        replay, has_position=False, position_ref=nowhere, position_imu=nowhere, position_error=nowhere
    )  # as it is before the first LOCAL_POSITION_NED
    feed = Script()
    with LiveViewer(feed, window_s=60.0, port=0) as viewer:
        time.sleep(0.1)
        assert not viewer.controller.scene.imu.place.visible, "nobody has been heard"
        feed.now = Seen(flight, "RAW_IMU", attitude, None)
        until(lambda: viewer.controller.scene.imu.place.visible, "the attitude")
        assert viewer.controller.scene.imu.label.text == "IMU alone"
        feed.now = Seen(flight, "RAW_IMU", replay, None)
        apart = float(np.linalg.norm(replay.position_error[-1]))
        assert apart > 1.0
        imu, autopilot = viewer.controller.scene.imu, viewer.controller.scene.autopilot
        until(
            lambda: np.linalg.norm(imu.position - autopilot.position) == pytest.approx(apart, abs=0.01), "their places"
        )


def test_the_numbers_are_of_the_imu_that_is_named(
    flight: Flight, server: viser.ViserServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another IMU begins its free run anew: the older run of the former one is never shown below its name."""
    replay = dead_reckon(flight, ReplayChoice(imu="RAW_IMU"))
    now = float(replay.t[-1])
    last = NavState(now, replay.q_imu[-1], replay.velocity_imu[-1], replay.position_imu[-1])

    def left_alone(for_s: float) -> FreeState:
        return FreeState(now - for_s, last, np.zeros(3), np.zeros(3), np.zeros(3))

    ages: list[float] = []
    monkeypatch.setattr(live_controller, "numbers", lambda _sample, free, **_: ages.append(free.age_s))
    feed = Script(Seen(flight, "RAW_IMU", replay, left_alone(70.0)))
    controller = LiveController(server, feed, 60.0, lambda _call: None)
    controller.turn(100.0, 0.05)
    feed.now = Seen(flight, "SCALED_IMU2", replay, left_alone(3.0))
    controller.turn(100.05, 0.05)
    assert ages == pytest.approx([70.0, 3.0])


def heard(flight: Flight, seconds: float = 20.0) -> list[Seen]:
    """A minute of looks; of messages only the last seconds are kept."""
    replay = dead_reckon(flight, ReplayChoice(imu="RAW_IMU"))
    parts = [samples_of(replay, slice(0, i)) for i in range(50, len(replay.t), 50)]
    return [
        Seen(replace(flight, start=float(part.t[-1]) - seconds, duration=seconds), "RAW_IMU", part, None)
        for part in parts
    ]


def test_the_numbers_go_back_with_the_picture(flight: Flight, server: viser.ViserServer) -> None:
    feed = Script()
    controller = LiveController(server, feed, 60.0, lambda _call: None)
    for i, feed.now in enumerate(heard(flight)):
        controller.turn(100.0 + i, 1.0)
    controller.hold(-40.0)
    controller.turn(200.0, 1.0)
    altitude = -float(controller.scene.autopilot.position[2])
    assert f"{altitude:.1f} m, " in controller._panel.flight.content


def test_what_is_held_ends_with_its_boot(flight: Flight, server: viser.ViserServer) -> None:
    feed = Script()
    controller = LiveController(server, feed, 60.0, lambda _call: None)
    seen = heard(flight)
    for i, feed.now in enumerate(seen):
        controller.turn(100.0 + i, 1.0)
    controller.hold(-10.0)
    feed.now = replace(seen[-1], flight=replace(seen[-1].flight, boot=2))
    controller.turn(200.0, 1.0)
    assert (controller._panel.pause.label, controller._panel.back.value) == ("Pause", 0.0)


def test_the_list_names_the_vehicle_that_is_looked_at(flight: Flight, server: viser.ViserServer) -> None:
    second = replace(flight, vehicle=replace(flight.vehicle, sysid=2))
    feed = Script(Seen(second, "RAW_IMU", dead_reckon(flight, ReplayChoice(imu="RAW_IMU")), None))
    controller = LiveController(server, feed, 60.0, lambda _call: None)
    controller.turn(100.0, 1.0)
    assert controller._panel.vehicle.value == "2:1"
