"""What stands behind the page: the flight shown, the clock, and the order in which the browser hears of a change.

Everything here runs in the view thread, which alone writes to viser.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import viser

from companion.model import CompanionError, Flight
from companion.present import palette
from companion.view import export
from companion.view.charts.chart_pages import ChartPages
from companion.view.export import PAGE, REPORT, Saver
from companion.view.ground_map import MapLayer
from companion.view.panels.adjustments import EXTRA_PATHS, TRAILS, Adjustments
from companion.view.panels.bands import bands, outside
from companion.view.panels.controls import dock, listen_to_clicks
from companion.view.panels.replay_panel import Panel
from companion.view.panels.timeline import Timeline
from companion.view.panels.verdict_panel import DriftTab, FindingsTab
from companion.view.scene.cameras import frame_of
from companion.view.scene.picking import picked
from companion.view.scene.vehicle_shapes import drone_for
from companion.view.state import events
from companion.view.state.cadence import Cadence
from companion.view.state.choice import Examine, Offer, Recompute, ReplayChoice
from companion.view.state.marks import Mark, text_marks
from companion.view.state.places import best_path, gps_path, home_position
from companion.view.state.player import Player, instant, move
from companion.view.state.sample import Footage, with_insight
from companion.view.state.work import Opinion, Outcome, Work
from companion.view.viewport import Viewport

APART = 0.4
"""s between a chart's new size and its new data: a slow page must not take them for one change (Plots.relayout)."""
OPENING, UNSEEN = 1.5, 2.0
"""s after a page is opened, or after the start if none is, that the first analysis waits: until then a page that is
being built needs the machine for itself."""


class ReplayController:
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
        self._asked = first.choice  # for last: what is shown may still be the one before
        self._work, self._report = Work(recompute, examine), offer.report
        self._saver = Saver()
        self.player = Player(film.start, film.end)
        self._marks: list[Mark] = []
        self._trail = next(iter(TRAILS.values()))
        self._is_due = Cadence(labels=8.0, trails=8.0, plots=4.0, progress=2.0)
        self._trouble = False
        self._asked_for = False  # whether an address has asked for an instant or an IMU
        # A phone shows the panels one below the other, in this order.
        self._panel = Panel(server.gui, flights, post)
        bottom, side, more = (server.gui.add_panel() for _ in range(3))
        with side.add_tab("Findings", viser.Icon.LIST_DETAILS):
            self._findings = FindingsTab(server.gui, post)
        with side.add_tab("Charts", viser.Icon.CHART_LINE):
            self._charts = ChartPages(server.gui, post)
        with side.add_tab("Drift", viser.Icon.TABLE):
            self._drift = DriftTab(server.gui)
        with more.add_tab("Adjust", viser.Icon.ADJUSTMENTS):
            self._adjustments = Adjustments(server.gui, first.flight, offer, post)
        self._timeline = Timeline(server.gui, bottom, self._adjustments.playing, post)
        dock(server.gui, side)
        more.dock_below(server.gui.main_panel)
        bottom.expand()
        listen_to_clicks(server.scene, post)
        drone = drone_for(first.flight.vehicle.type)
        self.viewport = Viewport(server, self._adjustments.picture, drone, frame_of(film), post)
        self._load()
        self._map = MapLayer(offer.map_url, self._adjustments.choose_map, self._complain)
        if offer.map_shown:
            self._map.show(True, self._flight, self.viewport.framing)
        self._examine_at = time.monotonic() + UNSEEN  # inf: it has been ordered

    def close(self) -> None:
        """End the workers."""
        self._work.close()
        self._saver.close()
        self._map.close()

    def wait(self) -> None:
        """A recording has it all already."""

    def turn(self, now: float, dt: float) -> None:
        """What has been reckoned, the clock, the picture: at `now`, s of any steady clock, `dt` after the last turn."""
        done = self._work.poll()
        if isinstance(done, Outcome):
            self._take(done)
        elif isinstance(done, Opinion):
            self._hear(done)
        elif self._is_due("progress", now):
            progress = self._work.progress()
            if progress or not self._trouble:
                self._panel.status(progress)
        said = self._saver.poll()
        if said is not None:
            self._complain(said)
        self._map.turn(self.viewport.scene.ground.show_map)
        if now >= self._examine_at:
            self._examine()
        self.player.advance(dt)
        self._draw(now)

    def handle(self, event: events.Event) -> None:
        """Do what a control of a page asks for."""
        match event:
            case events.Change(change):
                self._reckon(self._flight, change(self._asked))
            case events.StartHere():
                self._reckon(self._flight, replace(self._asked, start_s=self.player.time))
            case events.PickFlight(index):
                if 0 <= index < len(self._flights):
                    other = self._flights[index]
                    self._reckon(other, replace(self._asked, imu=other.default_imu, others=(), start_s=None))
            case events.PickCharts(page):
                self._charts.pick(page)
            case events.SetTrail():
                self._trail = event
                self._is_due.at_once("trails")
            case events.Visit():
                self._visit(event)
            case events.Save(browser, what):
                self._save(browser, what)
            case _ if isinstance(event, events.Move):
                move(self.player, event, self._film, self._marks)
                if isinstance(event, events.SetPart):
                    self._timeline.choose_part(self.player)
                    self._charts.choose_part((self.player.start, self.player.end))
            case events.PickPlace():
                self._pick(event)
            case _ if isinstance(event, events.Look):
                self._look(event)

    def _look(self, event: events.Look) -> None:
        if isinstance(event, events.Joined) and self._examine_at < np.inf:
            self._examine_at = time.monotonic() + OPENING
        self.viewport.handle(event)
        if isinstance(event, events.SetMap):
            self._map.show(event.shown, self._flight, self.viewport.framing)
        if isinstance(event, events.SetPath):
            self._legend()

    def _pick(self, event: events.PickPlace) -> None:
        """Go to where a path was clicked on."""
        pose = self.viewport.browsers.pose(event.browser)
        if pose is None:
            return
        origin, direction = pose.back(np.array(event.origin)), pose.back_along(np.array(event.direction))
        t = picked(self._film, origin, direction)
        if t is not None:
            self.player.go(t)

    def _visit(self, visit: events.Visit) -> None:
        """Show what an address asks for, as far as there is such a thing; what a page remembers, where all is new."""
        if visit.again and (self._asked_for or len(self.viewport.browsers) > 1 or self.player.time > self.player.start):
            return
        self._asked_for = True
        seconds, imu = instant(visit.t), visit.imu
        if seconds is not None:
            self.player.go(seconds)
        if imu in self._flight.imus and imu != self._asked.imu:
            others = tuple(name for name in self._asked.others if name != imu)
            self._reckon(self._flight, replace(self._asked, imu=imu, others=others))

    def _save(self, browser: int, what: str) -> None:
        client = self._server.get_clients().get(browser)
        if client is None:
            return
        if what == "picture":
            self._saver.picture(client, dark=self.viewport.dark)
            return
        flight, choice, film = self._flight, self._choice, self._film
        if what == "report" and (report := self._report) is not None:
            self._saver.page(client, REPORT, lambda: report(flight, choice, film))
        elif what == "page":
            drone, colours, home, dark = self.viewport.drone, self._colours, self._home, self.viewport.dark
            self._saver.page(client, PAGE, lambda: export.page(film, drone, colours, home, dark=dark))

    def _take(self, outcome: Outcome) -> None:
        if isinstance(outcome.result, CompanionError):
            self._complain(str(outcome.result))
            self._asked = self._choice
            self._panel.choose_flight(self._flight)
            self._adjustments.load(self._flight, self._asked, self._film.start)
            if self._film.insight is None:  # the analysis of what is still shown was given up for this
                self._examine()
            return
        self._trouble = False
        other_flight = outcome.flight is not self._flight
        self._flight, self._choice, self._film = outcome.flight, outcome.choice, outcome.result
        self.player.load(self._film.start, self._film.end, None if other_flight else self.player.time)
        self._load()
        self._examine()
        if other_flight:
            self.viewport.reframe()
            self._map.show(self._map.shown, self._flight, self.viewport.framing)

    def _reckon(self, flight: Flight, choice: ReplayChoice) -> None:
        self._examine_at = np.inf  # what is shown now is soon to be replaced
        self._asked = choice
        self._work.reckon(flight, choice)

    def _examine(self) -> None:
        self._examine_at = np.inf
        self._work.examine(Outcome(self._flight, self._choice, self._film))

    def _hear(self, opinion: Opinion) -> None:
        """The analysis has come: findings, tables, what is expected. The picture stays as it is."""
        if opinion.film is not self._film:
            return
        if isinstance(opinion.result, CompanionError):
            self._wait(str(opinion.result))
            return
        self._film = with_insight(self._film, opinion.result)
        self._say()

    def _complain(self, why: str) -> None:
        self._trouble = True
        self._panel.status(why, trouble=True)

    def _load(self) -> None:
        """Lay out everything that stays the same until the next reckoning."""
        self.viewport.drone = drone_for(self._flight.vehicle.type)
        self.viewport.place(frame_of(self._film))
        self._colours, self._home = palette.of_imus(self._flight.imus), home_position(self._flight)
        self.viewport.scene.load(self._film, self.viewport.framing, self.viewport.drone, self._colours, self._home)
        self._wait("Analysis in progress.")
        self._say()

    def _wait(self, why: str) -> None:
        self._findings.wait(why)
        self._panel.wait(why)

    def _say(self) -> None:
        """Lay out what is said of the footage beside the picture."""
        film, insight = self._film, self._film.insight
        self._marks = text_marks(self._flight)
        if insight is not None:
            self._marks = sorted([*self._marks, *insight.marks], key=lambda mark: mark.t)
        best = insight.assessment.best if insight is not None else None
        third = None if best is None else best_path(self._flight, best)
        self.viewport.scene.extra_paths.load(gps_path(self._flight), third, 1e-3 * self.viewport.framing.distance)
        self._charts.load(film, self._flight, self._colours, (self.player.start, self.player.end))
        self._panel.load(self._flight, film)
        self._legend()
        self._adjustments.load(self._flight, self._asked, film.start)
        below = bands(self._flight, film)
        self._timeline.load(self.player, self._marks, film.replay.anchors.tolist(), below)
        self._findings.load(insight, outside(below.findings, film.start, film.end))
        self._drift.load(insight, self._colours)
        self._is_due.at_once()

    def _legend(self) -> None:
        extra_paths = self.viewport.scene.extra_paths
        self._panel.introduce(self._film, self._colours, [name for name in EXTRA_PATHS if extra_paths.visible(name)])
        for name in EXTRA_PATHS:
            self._adjustments.offer(name, extra_paths.there[name])

    def _draw(self, now: float) -> None:
        """Write the instant of the clock: poses every turn, the rest as often as it can be read."""
        sample = self._film.at(self.player.time)
        self.viewport.show(sample)
        if self._is_due("labels", now):
            self.viewport.annotate(sample)
            self._panel.show(sample, self._film, self.viewport.scene.ground.cell)
            self._timeline.show(self.player)
        if self._is_due("trails", now):
            since = -np.inf if self._trail.seconds is None else sample.t - self._trail.seconds
            self.viewport.scene.trails(since, np.inf if self._trail.ahead else sample.t)
        left = self.viewport.to_lay_out(now)
        if left < APART:
            self._is_due.wait("plots", now + left + APART)
            if left <= 0:
                self._charts.relayout()
                self.viewport.laid_out()
        elif self._is_due("plots", now):
            self._charts.show(sample)
