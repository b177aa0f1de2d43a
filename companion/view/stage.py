"""What stands behind the page: the flight shown, the clock, and the order in which the browser hears of a change.

Everything here runs in the view thread, which alone writes to viser.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import assert_never

import numpy as np
import viser

from companion.errors import CompanionError
from companion.tracks import Array, Flight
from companion.view import events, export, palette
from companion.view.browsers import Browsers
from companion.view.choice import Examine, Offer, Recompute
from companion.view.framing import FIELD_OF_VIEW, Framing, camera, frame, grid_cell, readable_span, screen_up
from companion.view.home import home_position
from companion.view.marks import Mark, text_marks
from companion.view.moment import Footage, with_insight
from companion.view.panel import Panel
from companion.view.player import Player
from companion.view.plots import Plots
from companion.view.saving import PAGE, REPORT, Saver
from companion.view.scene import Scene
from companion.view.shapes import drone_for
from companion.view.timeline import Timeline
from companion.view.transport import move
from companion.view.verdict import VerdictTab
from companion.view.work import Opinion, Outcome, Work

LABEL_HZ, TRAIL_HZ, PLOT_HZ, PROGRESS_HZ = 8.0, 8.0, 4.0, 2.0
APART = 0.4
"""s between a chart's new size and its new data: a slow page must not take them for one change (Plots.relayout)."""
SIDE = 330  # width of either panel, pixels


class Stage:
    """One session: built when the server is up, then turned over and over by the view thread."""

    def __init__(
        self,
        server: viser.ViserServer,
        flights: Sequence[Flight],
        recompute: Recompute,
        examine: Examine,
        offer: Offer,
        first: Outcome,
        film: Footage,
        post: events.Post,
    ) -> None:
        self._server, self._flights = server, flights
        self._flight, self._choice, self._film = first.flight, first.choice, film
        self._work, self._report = Work(recompute, examine), offer.report
        self._saver = Saver()
        self.player = Player(film.start, film.end)
        self.pose_updates = 0
        self._marks: list[Mark] = []
        self._trail = events.SetTrail(None)
        self._size: float | None = 1.0
        self._dark = False
        self._relayouts: list[float] = []
        self._due = dict.fromkeys(("labels", "trails", "plots", "progress"), 0.0)
        self._trouble = False
        self._drone = drone_for(first.flight.vehicle.type)
        self._theme()
        self.scene = Scene(server.scene, self._drone)
        self._panel = Panel(server.gui, flights, offer, post)
        self._timeline = Timeline(server.gui, self._panel.playing, post)
        side = server.gui.add_panel()
        with side.add_tab("Charts", viser.Icon.CHART_LINE):
            self._plots = Plots(server.gui, post)
        with side.add_tab("Verdict", viser.Icon.GAVEL):
            self._verdict = VerdictTab(server.gui, post)
        server.gui.main_panel.dock_right()
        server.gui.main_panel.set_width(SIDE)
        side.dock_left()
        side.set_width(SIDE)
        self._browsers = Browsers(server, self._panel.picture, post)
        self._framing = self._load()
        self._work.examine(first)

    @property
    def browsers(self) -> int:
        """How many pages are open."""
        return len(self._browsers)

    def close(self) -> None:
        """End the workers."""
        self._work.close()
        self._saver.close()

    def turn(self, now: float, dt: float) -> None:
        """What has been reckoned, the clock, the picture: at `now`, s of any steady clock, `dt` after the last turn."""
        done = self._work.poll()
        if isinstance(done, Outcome):
            self._take(done)
        elif isinstance(done, Opinion):
            self._hear(done)
        elif self._is_due("progress", PROGRESS_HZ, now):
            progress = self._work.progress()
            if progress or not self._trouble:
                self._panel.status(progress)
        said = self._saver.poll()
        if said is not None:
            self._complain(said)
        self.player.advance(dt)
        self._draw(now)

    def handle(self, event: events.Event) -> None:
        """Do what a control of a page asks for."""
        match event:
            case events.Choose(choice):
                self._work.reckon(self._flight, choice)
            case events.StartHere():
                self._work.reckon(self._flight, replace(self._choice, start_s=self.player.time))
            case events.PickFlight(index):
                if 0 <= index < len(self._flights):
                    other = self._flights[index]
                    self._work.reckon(other, replace(self._choice, imu=other.default_imu, others=(), start_s=None))
            case events.PickCharts(page):
                self._plots.pick(page)
            case (
                events.SetCamera()
                | events.SetTrail()
                | events.SetSize()
                | events.SetRange()
                | events.SetArrows()
                | events.SetDark()
            ):
                self._look(event)
            case events.Save(browser, what):
                self._save(browser, what)
            case events.Joined(browser):
                self._browsers.join(browser, self._framing)
                now = time.monotonic()
                self._relayouts = [now + 1.0, now + 2.5, now + 5.0]  # a page is laid out after 1 to 3 s
            case events.Left(browser):
                self._browsers.leave(browser)
            case _ if isinstance(event, events.Move):
                move(self.player, event, self._film, self._marks)
                if isinstance(event, events.SetPart):
                    self._timeline.choose_part(self.player)
                    self._plots.choose_part((self.player.start, self.player.end))

    def _look(self, event: events.Look) -> None:
        match event:
            case events.SetCamera(browser, mode):
                self._browsers.choose(browser, mode, self._framing)
            case events.SetTrail():
                self._trail = event
                self._due["trails"] = 0.0
            case events.SetSize(size):
                self._size = size
            case events.SetRange(shown):
                self.scene.expected.shown = shown
            case events.SetArrows(shown):
                self.scene.arrows.shown = shown
            case events.SetDark(dark):
                self._dark = dark
                self._theme()
                self.scene.ground.shade(dark=dark)
            case _:
                assert_never(event)

    def _save(self, browser: int, what: str) -> None:
        client = self._server.get_clients().get(browser)
        if client is None:
            return
        if what == "picture":
            self._saver.picture(client, dark=self._dark)
            return
        flight, choice, film = self._flight, self._choice, self._film
        if what == "report" and (report := self._report) is not None:
            self._saver.page(client, REPORT, lambda: report(flight, choice, film))
        elif what == "page":
            drone, colours, home, dark = self._drone, self._colours, self._home, self._dark
            self._saver.page(client, PAGE, lambda: export.page(film, drone, colours, home, dark=dark))

    def _take(self, outcome: Outcome) -> None:
        if isinstance(outcome.result, CompanionError):
            self._complain(str(outcome.result))
            return
        self._trouble = False
        other_flight = outcome.flight is not self._flight
        self._flight, self._choice, self._film = outcome.flight, outcome.choice, outcome.result
        self.player.load(self._film.start, self._film.end, None if other_flight else self.player.time)
        self._framing = self._load()
        self._work.examine(outcome)
        if other_flight:
            self._browsers.reframe(self._framing)

    def _hear(self, opinion: Opinion) -> None:
        """The analysis has come: findings, tables, what is expected. The picture stays as it is."""
        if opinion.film is not self._film:
            return
        if isinstance(opinion.result, CompanionError):
            self._verdict.wait(str(opinion.result))
            return
        self._film = with_insight(self._film, opinion.result)
        self._say()

    def _complain(self, why: str) -> None:
        self._trouble = True
        self._panel.status(why, trouble=True)

    def _load(self) -> Framing:
        """Lay out everything that stays the same until the next reckoning."""
        replay = self._film.replay
        framing = frame(replay.position_ref, replay.position_imu)
        if not replay.has_position:
            framing = replace(framing, ground=0.5 * framing.radius)  # both hang in the air above the origin
        if self._drone is not drone_for(self._flight.vehicle.type):
            self._drone = drone_for(self._flight.vehicle.type)
        self._colours, self._home = palette.of_imus(self._flight.imus), home_position(self._flight)
        self.scene.load(self._film, framing, self._drone, self._colours, self._home)
        self._verdict.wait("The analysis is at work.")
        self._say()
        view = camera("Free", framing)
        initial = self._server.initial_camera
        initial.position, initial.look_at = view.position, view.look_at
        initial.near, initial.far, initial.fov = view.near, view.far, float(FIELD_OF_VIEW)
        return framing

    def _say(self) -> None:
        """Lay out what is said of the footage beside the picture."""
        film, insight = self._film, self._film.insight
        self._marks = text_marks(self._flight)
        if insight is not None:
            self._marks = sorted([*self._marks, *insight.marks], key=lambda mark: mark.t)
        self._plots.load(film, self._flight, self._colours, (self.player.start, self.player.end))
        self._panel.load(self._flight, self._choice, film, self._colours)
        self._timeline.load(self.player, self._marks, film.replay.anchors.tolist())
        self._verdict.load(insight, self._colours)
        self._due = dict.fromkeys(self._due, 0.0)

    def _draw(self, now: float) -> None:
        """Write the instant of the clock: poses every turn, the rest as often as it can be read."""
        moment = self._film.at(self.player.time)
        with self._server.atomic():
            self.scene.show(moment)
            self._browsers.show(moment)
        self.pose_updates += 1
        if self._is_due("labels", LABEL_HZ, now):
            eye, pose = self._browsers.last_moved(self._framing)
            target = pose.apply(moment.position_ref)
            apart = pose.apply(moment.position_imu) - target
            imu_above = float(apart @ screen_up(target - eye)) >= 0
            self.scene.annotate(moment, self._span(eye, target), imu_above=imu_above)
            self.scene.ground.rule(grid_cell(float(np.linalg.norm(eye - target)), self.scene.ground.cell))
            self._panel.show(moment, self._film, self.scene.ground.cell)
            self._timeline.show(self.player)
        if self._is_due("trails", TRAIL_HZ, now):
            since = -np.inf if self._trail.seconds is None else moment.t - self._trail.seconds
            self.scene.trails(since, np.inf if self._trail.ahead else moment.t)
        if self._relayouts and now >= self._relayouts[0] - APART:
            self._due["plots"] = self._relayouts[0] + APART
            if now >= self._relayouts[0]:
                self._relayouts.pop(0)
                self._plots.relayout()
                self._browsers.settle(self._framing)
        elif self._is_due("plots", PLOT_HZ, now):
            self._plots.show(moment)

    def _is_due(self, what: str, rate: float, now: float) -> bool:
        if now < self._due[what]:
            return False
        self._due[what] = now + 1.0 / rate
        return True

    def _span(self, eye: Array, target: Array) -> float:
        """How large to draw the drones at `target`, m."""
        if self._size is None:
            return self._drone.span_m
        return readable_span(float(np.linalg.norm(eye - target)), self._drone.span_m, self._size)

    def _theme(self) -> None:
        self._server.gui.configure_theme(
            dark_mode=self._dark, show_logo=False, show_share_button=False, brand_color=palette.CONTROLS
        )
