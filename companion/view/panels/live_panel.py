"""What can be chosen and read beside the live picture. Nothing in here reaches the vehicle: anybody may press it."""

from __future__ import annotations

from dataclasses import replace

import viser

from companion.view.panels import live_text
from companion.view.panels.controls import ChooseCamera, Controls, bounded, write
from companion.view.panels.dead_reckoning import Change, integration_controls, on_choice
from companion.view.panels.verdict import ChecksFolders
from companion.view.state.feed import Feed
from companion.view.state.sending import update
from companion.view.state.trajectory import FlightChecks

BEST = "Automatic"
LONGEST_REANCHOR_S = 20.0
"""That the page offers; whoever keeps the messages keeps two such periods."""


class LivePanel:
    """The controls. Built once; only the view thread may call it."""

    def __init__(
        self,
        controls: Controls,
        feed: Feed,
        window_s: float,
        change: Change,
        choose_camera: ChooseCamera,
    ) -> None:
        """What `pause`, `back` and `vehicle` do is up to whoever builds it."""
        gui = controls.gui
        self._vehicles: tuple[str, ...] = ()
        self._imus: tuple[str, ...] = (BEST,)
        longest = max(LONGEST_REANCHOR_S, float(feed.reanchor_s))
        self._verdict = gui.add_html("")
        self._link = gui.add_html("")
        self.pause = gui.add_button("Pause", icon=viser.Icon.PLAYER_PAUSE)
        self.back = gui.add_slider(
            "Look back, s", -window_s, 0.0, 0.1, 0.0, hint="The picture is held while the recording goes on"
        )
        controls.cameras(choose_camera)
        self._legend = gui.add_html("")
        self.numbers = gui.add_html("")
        self.flight = gui.add_html("")
        self._checks = ChecksFolders(gui, before_takeoff=True)
        with gui.add_folder("Dead reckoning", expand_by_default=False):
            self.vehicle = gui.add_dropdown("Vehicle", ("none",), visible=False)
            self._imu = gui.add_dropdown("IMU", (BEST,))
            integration_controls(controls, feed.choice.how, change)
            period = gui.add_number(
                "Re-anchor, s",
                float(feed.reanchor_s),
                min=0.5,
                max=longest,
                step=0.5,
                hint="Restart from the autopilot's state at this interval",
            )
            anchor = gui.add_button("Anchor now", icon=viser.Icon.ANCHOR, hint="Also begins the free run again")
        with gui.add_folder("Verdict and drift so far"):
            self._drift = gui.add_html("")
        with gui.add_folder("Link"):
            self._health = gui.add_html("")
        with gui.add_folder("Messages", expand_by_default=False):
            self._messages = gui.add_html("")
        controls.on_change(period, lambda s: setattr(feed, "reanchor_s", bounded(s, 0.5, 10.0, longest)))
        on_choice(controls, change, self._imu, lambda c, name: replace(c, imu=name if name in self._imus[1:] else None))
        controls.on_click(anchor, feed.anchor_now)
        controls.command("Anchor now", "A", feed.anchor_now)

    def introduce(self, vehicle: str, imus: tuple[str, ...], chosen: str | None, *, has_position: bool) -> None:
        """Show which vehicle it is, which IMUs it has and which of them was chosen; None: the page's own choice."""
        if self._imus != (BEST, *imus):
            self._imus = (BEST, *imus)
            self._imu.options = self._imus
            write(self._imu, chosen if chosen in imus else BEST)
        self._legend.content = live_text.legend(vehicle, has_position=has_position)

    def report(self, feed: Feed, held_s: float | None) -> None:
        """Write how everything stands. held_s: how long ago the held picture was; None: live."""
        state = feed.link
        update(self._verdict, content=live_text.verdict(feed.verdict, state, feed.why_not))
        update(self._link, content=live_text.link(state, feed.why_not, held_s))
        update(self._health, content=live_text.health(state))
        update(self._drift, content=live_text.drift(feed.drift, feed.verdict, feed.other_verdicts))
        self._checks.load(FlightChecks(preflight=feed.preflight))
        update(self._messages, content=live_text.messages(feed.messages))
        vehicles = tuple(feed.vehicles)
        if vehicles and vehicles != self._vehicles:
            self._vehicles = self.vehicle.options = vehicles
            self.vehicle.visible = len(vehicles) > 1

    def hold(self, at_s: float | None, duration_s: float) -> None:
        """The picture is held at so many s before its end (0 or less); None: it is live. duration_s: how far back."""
        paused = at_s is not None
        self.pause.label = "Live" if paused else "Pause"
        self.pause.icon = viser.Icon.PLAYER_PLAY if paused else viser.Icon.PLAYER_PAUSE
        low = -max(round(duration_s, 1), 0.1)
        if paused and self.back.min != low:
            self.back.min = low
        write(self.back, max(at_s or 0.0, low))
