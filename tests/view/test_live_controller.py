"""What stands behind the live page, without a browser."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from companion.analysis import DriftRow
from companion.model import Flight
from companion.view import Judgement, LinkState, LiveViewer, ReplayChoice, Seen
from tests.view.browsing import until
from tests.view.circles import reckon


@dataclass
class Script:
    """A feed that shows what it is told to."""

    now: Seen | None = None
    reanchor_s: float = 10.0
    choice: ReplayChoice = field(default_factory=ReplayChoice)
    why_not: str = ""
    vehicles: tuple[str, ...] = ()
    said: tuple[str, ...] = ()
    link: LinkState = field(default_factory=lambda: LinkState("a link"))
    drift: tuple[DriftRow, ...] = ()
    judgement: Judgement = field(default_factory=lambda: Judgement("", ""))

    def look(self) -> Seen | None:
        return self.now

    def choose(self, choice: ReplayChoice) -> None:
        self.choice = choice

    def anchor_now(self) -> None:
        """There is nothing to begin anew."""

    def pick(self, vehicle: str) -> None:
        """There is one."""


def test_a_position_that_comes_after_the_first_attitude_is_shown(flight: Flight) -> None:
    replay = reckon(flight, ReplayChoice(imu="RAW_IMU"))
    nowhere = np.zeros_like(replay.position_ref)
    attitude = replace(
        replay, has_position=False, position_ref=nowhere, position_imu=nowhere, position_error=nowhere
    )  # as it is before the first LOCAL_POSITION_NED
    feed = Script()
    with LiveViewer(feed, window_s=60.0, port=0) as viewer:
        time.sleep(0.1)
        assert not viewer.scene.imu.visible, "nobody has been heard"
        feed.now = Seen(flight, "RAW_IMU", attitude, None)
        until(lambda: viewer.scene.imu.visible, "the attitude")
        assert viewer.scene.imu.name == "IMU alone"
        feed.now = Seen(flight, "RAW_IMU", replay, None)
        apart = float(np.linalg.norm(replay.position_error[-1]))
        assert apart > 1.0
        until(lambda: viewer.scene.apart == pytest.approx(apart, abs=0.01), "the line between them")
