"""What stands behind the page: the flight shown, the clock, and the order in which the browsers get a change.

Everything here runs in the view thread, which alone writes to viser.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from html import escape
from typing import Any, ClassVar
from urllib.parse import urlsplit

import numpy as np
import viser

from companion.model import CompanionError, Flight
from companion.present import palette
from companion.verdict import Finding, Verdict
from companion.view import export
from companion.view.controller import Controller
from companion.view.export import PAGE, PICTURE, REPORT, Saver
from companion.view.ground_map import MapLayer
from companion.view.panels.chart_pages import ChartPages
from companion.view.panels.controls import Controls, Post, dock, write
from companion.view.panels.dead_reckoning import DeadReckoningControls
from companion.view.panels.markup import block
from companion.view.panels.replay_panel import Panel
from companion.view.panels.strip import bands, outside
from companion.view.panels.timeline import Timeline
from companion.view.panels.verdict import FindingsTab, drift_tab
from companion.view.scene.cameras import frame_between, frame_of, picked
from companion.view.scene.vehicle_shapes import drone_for
from companion.view.state.moments import (
    AFTER_S,
    PLAYED_S,
    Moment,
    decisive,
    errors_in,
    marks_of,
    moment_of,
    shown_curve,
)
from companion.view.state.places import best_path, gps_path, home_position
from companion.view.state.player import Player
from companion.view.state.trajectory import (
    AnalysisResult,
    DisplayTrajectory,
    Examine,
    FlightChecks,
    Offer,
    Recompute,
    ReplayChoice,
    TrailSpan,
    with_result,
)
from companion.view.state.work import Worker

PATIENCE_S = 1.0  # of work before it is spoken of
OPENING, UNSEEN = 0.3, 2.0
"""s after a page is opened, or after the start if none is, that the first analysis waits: until then a page that is
being built needs the machine for itself."""
_ROUNDED_S = 0.02  # by which the instant that a page remembers may differ
TRAILS = {
    "Since the anchor": TrailSpan(None, anchored=True),
    "Last 60 s": TrailSpan(60.0),
    "Last 10 s": TrailSpan(10.0),
    "Path so far": TrailSpan(None),
    "Whole path": TrailSpan(None, ahead=True),
}


class ReplayController(Controller):
    """One session: built when the server is up, then turned over and over by the view thread."""

    charts: ChartPages
    trails = TRAILS
    rates: ClassVar = {"labels": 8.0, "charts": 4.0, "progress": 2.0}
    expects = True

    def __init__(
        self,
        server: viser.ViserServer,
        flights: Sequence[Flight],
        recompute: Recompute,
        examine: Examine,
        offer: Offer,
        flight: Flight,
        choice: ReplayChoice,
        display: DisplayTrajectory,
        post: Post,
    ) -> None:
        self._flight, self._choice, self._display = flight, choice, display
        self._requested = choice  # last: what is shown may still be the one before
        self._recompute, self._offer = recompute, offer
        # Two workers, so that the next dead reckoning need not wait for the analysis of the one before.
        self._computer, self._examiner = Worker("dead-reckon"), Worker("examine")
        self._saver = Saver(self._complain)
        self.player = player = Player(display.start, display.end)
        self._trouble = ""  # what has failed, until the next dead reckoning
        self._visited = False  # an address has requested an instant or an IMU
        self._opening = self._moment = decisive(display)  # where the page opens; what is pointed at
        controls, gui = Controls(server.gui, post), server.gui
        # A phone shows the panels one below the other, in this order.
        self._panel = Panel(controls, flights, self.pick_flight)
        bottom, side = gui.add_panel(), gui.add_panel()
        self._add_tabs(controls, side)
        # What makes each part of the analysis, and what takes it: the verdict is known seconds before the rest.
        stages: tuple[tuple[Any, Callable[[Any], object]], ...] = (
            (offer.judge, self._panel.judge),
            (examine, self._take_result),
            (offer.check, self._findings.checks.load),
        )
        self._stages = [one for one in stages if one[0] is not None]
        self._adjustments = DeadReckoningControls(controls, offer, choice.gravity, self.change, lambda: player.time)
        map_host = urlsplit(offer.map_url or "").hostname or ""
        super().__init__(server, controls, drone_for(flight.vehicle.type), frame_of(display), map_host)
        self._timeline = Timeline(controls, bottom, player, self.choose_camera)
        self._add_save(controls)
        dock(gui, side)
        bottom.expand()

        @server.scene.on_click()  # type: ignore[arg-type]  # an async one runs in order: viser does not declare it
        async def _(click: viser.SceneClickEvent) -> None:  # where no control is and nothing was dragged
            post(partial(self._pick_place, click.client_id, click.ray_origin, click.ray_direction))

        self._load()
        self._open()
        self._map = MapLayer(offer.map_url, self.scene.ground.show_map, partial(write, self.map_box), self._complain)
        controls.on_change(self.map_box, lambda shown: self._show_map(shown is True))
        self._show_map(offer.map_shown)
        self._examine_at = time.monotonic() + UNSEEN  # inf: it has been ordered

    def close(self) -> None:
        """End the workers."""
        for worker in (self._computer, self._examiner, self._saver, self._map):
            worker.close()

    def turn(self, now: float, dt: float) -> None:
        """What has been dead-reckoned, the clock, the picture."""
        for worker in (self._computer, self._examiner, self._saver, self._map):
            worker.poll()
        if self.is_due("progress", now):
            progress = self._progress()
            self._panel.status(progress or self._trouble, trouble=not progress)
        if now >= (self.joined_at + OPENING if self.joined_at and self._examine_at < np.inf else self._examine_at):
            self._examine()
        self.player.advance(dt)
        self._draw(now)

    def change(self, part: Callable[[ReplayChoice], ReplayChoice]) -> None:
        """Dead-reckon otherwise in one respect."""
        self._compute(self._flight, part(self._requested))

    def pick_flight(self, flight: Flight) -> None:
        """Show another flight."""
        self._compute(flight, replace(self._requested, imu=flight.default_imu, others=(), start_s=None))

    def visit(self, t: str, imu: str, *, again: bool) -> None:
        """Show what an address requests, as far as there is such a thing; what a page remembers, where all is new."""
        if not (t or imu) or (again and (self._visited or len(self.browsers) > 1 or not self._untouched)):
            return
        with contextlib.suppress(ValueError):
            if again and abs(float(t) - self._opened_s) < _ROUNDED_S:
                return  # where the page opened by itself: it may go on to what the analysis finds
            self.player.go(float(t))
        self._visited = True
        if imu in self._flight.imus and imu != self._requested.imu:
            others = tuple(name for name in self._requested.others if name != imu)
            self._compute(self._flight, replace(self._requested, imu=imu, others=others))

    def _pick_place(self, browser: int, origin: Sequence[float], direction: Sequence[float]) -> None:
        """Go to the place of a path that was clicked on: a ray in a browser's own world, m."""
        if (pose := self.browsers.pose(browser)) is not None:
            t = picked(self._display, pose.back(np.array(origin)), pose.back_along(np.array(direction)))
            if t is not None:
                self.player.go(t)

    def _show_map(self, shown: bool) -> None:
        self._map.show(shown, self._flight, self.browsers.framing)

    def _add_tabs(self, controls: Controls, side: viser.PanelHandle) -> None:
        with side.add_tab("Findings"):
            self._findings = FindingsTab(controls, self._show_finding)
        with side.add_tab("Charts"):
            self.charts = ChartPages(controls)
        with side.add_tab("Drift"):
            self._drift = controls.gui.add_html("")

    def _add_save(self, controls: Controls) -> None:
        gui, file = controls.gui, viser.Icon.FILE_EXPORT
        with gui.add_folder("Save", expand_by_default=False):
            buttons = {
                PICTURE: gui.add_button("This picture (PNG)", icon=viser.Icon.CAMERA),
                PAGE: gui.add_button("The 3D replay (HTML)", icon=file),
            }
            if self._offer.report is not None:
                hint = "Verdict, charts and tables of what is shown, to mail or print"
                buttons[REPORT] = gui.add_button("The report (HTML)", icon=file, hint=hint)
        for name, button in buttons.items():
            controls.on_click_in(button, partial(self._save, name))

    def _save(self, name: str, browser: int) -> None:
        """Send a browser a file of what is shown now."""
        client, dark, report = self._server.get_clients().get(browser), self.dark, self._offer.report
        if client is None:
            return
        flight, choice, display = self._flight, self._choice, self._display
        makers: dict[str, Callable[[], bytes]] = {
            PICTURE: lambda: export.picture(client, dark=dark),
            PAGE: lambda: export.replay_page(display, flight, dark=dark).encode(),
        }
        if report is not None:
            makers[REPORT] = lambda: report(flight, choice, display).encode()
        self._saver.save(client, name, makers[name])

    def _take(self, flight: Flight, choice: ReplayChoice, computed: DisplayTrajectory | CompanionError) -> None:
        if isinstance(computed, CompanionError):
            self._complain(str(computed))
            self._requested = self._choice
            self._panel.choose_flight(self._flight)
            self._adjustments.load(self._flight, self._requested, self._display.start)
            if self._display.result is None:  # the analysis of what is still shown was given up for this
                self._examine()
            return
        self._trouble = ""
        other_flight = flight is not self._flight
        self._flight, self._choice, self._display = flight, choice, computed
        self.player.load(computed.start, computed.end, None if other_flight else self.player.time)
        if other_flight:
            self._opening = self._moment = decisive(computed)
            self._visited = False
        self._load()
        self._examine()
        if other_flight:
            self._open()
            self.browsers.reframe()
            self._show_map(self._map.shown)

    def _compute(self, flight: Flight, choice: ReplayChoice) -> None:
        self._examine_at = np.inf  # what is shown now is soon to be replaced
        self._requested = choice
        self._examiner.forget()
        self._computer.request(partial(self._recompute, flight, choice), partial(self._take, flight, choice))

    def _examine(self, stage: int = 0) -> None:
        """Order the analysis of what is shown: the verdict, what it rests on, what else is said of the flight."""
        self._examine_at = np.inf
        work, _ = self._stages[stage]
        request = partial(work, self._flight, self._choice, self._display)
        self._examiner.request(request, partial(self._take_stage, stage))

    def _take_stage(self, stage: int, answer: Verdict | AnalysisResult | FlightChecks | CompanionError) -> None:
        work, take = self._stages[stage]
        if not isinstance(answer, CompanionError):
            take(answer)
            if stage + 1 < len(self._stages):
                self._examine(stage + 1)
        elif work is not self._offer.check:
            self._wait(str(answer))

    def _take_result(self, result: AnalysisResult) -> None:
        """The analysis has come: findings, tables, what is expected. The page opens at what they say, if untouched."""
        untouched = self._untouched
        self._display = with_result(self._display, result)
        self._opening = decisive(self._display)
        if untouched or self._moment is None:
            self._moment = self._opening
        self._place()
        self._say()
        if untouched:
            self._open()

    @property
    def _untouched(self) -> bool:
        """Whether nobody has moved the clock since the page opened."""
        return not self._visited and not self.player.playing and self.player.time == self._opened_s

    def _open(self) -> None:
        """Go where the page opens: what is wrong shows there, and what led to it can be played."""
        if (moment := self._opening) is not None:
            self.player.seek(moment.opens_at(self._display))
            self._point(moment, moment.begins_at(self._display.replay.anchors))
        else:
            self._timeline.forget()
        self._opened_s = self.player.time

    def _show_finding(self, browser: int, finding: Finding) -> None:
        """Go to the strongest moment of a finding that was pressed, and look at it more closely."""
        moment = moment_of(finding, self._display)
        anchors = self._display.replay.anchors
        before = anchors[anchors < moment.strongest_s]
        start = max(float(before[-1]) if len(before) else self._display.start, moment.strongest_s - PLAYED_S)
        self.player.go(moment.strongest_s)
        self._point(moment, moment.strongest_s + AFTER_S - PLAYED_S)
        self.browsers.look(
            frame_between(self._display, self.browsers.framing, start, moment.strongest_s + AFTER_S), browser
        )

    def _point(self, moment: Moment, played_s: float) -> None:
        """Show the error in which a moment shows, and offer to play it from an instant on."""
        self._moment = moment
        self._timeline.point(moment, shown_curve(self._display, moment.error), (played_s, played_s + PLAYED_S))

    def _progress(self) -> str:
        """What goes on, in words, when it takes long."""
        if (seconds := self._computer.busy_s) >= PATIENCE_S:
            return f"Recomputing for {seconds:.0f} s. Changing a setting restarts it."
        seconds = self._examiner.busy_s
        return f"The analysis has worked for {seconds:.0f} s." if seconds >= PATIENCE_S else ""

    def _complain(self, why: str) -> None:
        self._trouble = why
        self._panel.status(why, trouble=True)

    def _load(self) -> None:
        """Lay out everything that stays the same until the next dead reckoning."""
        self.drone = drone_for(self._flight.vehicle.type)
        self._colours = palette.of_imus(self._flight.imus)
        self._place()
        self._wait("Analysis in progress.")
        self._findings.checks.load(FlightChecks())
        self._say()

    def _place(self) -> None:
        """Lay out the picture, and where cameras stand in it."""
        whole, moment = frame_of(self._display), self._opening
        near = frame_between(self._display, whole, moment.begins_s, moment.begins_s + PLAYED_S) if moment else None
        self.browsers.place(whole, near)
        self.scene.load(self._display, whole, self.drone, self._colours, home_position(self._flight))

    def _wait(self, why: str) -> None:
        self._findings.wait(why)
        self._panel.wait(why)
        self.charts.wait(why)
        self._drift.content = block(escape(why))

    def _say(self) -> None:
        """Lay out what stands beside the picture."""
        display, result = self._display, self._display.result
        marks = marks_of(self._flight, result.assessment.verdict.findings if result is not None else ())
        best = result.assessment.best if result is not None else None
        third = None if best is None else best_path(self._flight, best)
        self.scene.extra_paths.load(gps_path(self._flight), third, 1e-3 * self.browsers.framing.distance)
        self.charts.load(display, self._flight, self._colours, self.player.part)
        below = bands(self._flight, display)
        self._panel.load(self._flight, display, below, self._colours)
        self._adjustments.load(self._flight, self._requested, display.start)
        self.player.stops = {
            "anchor": display.replay.anchors,
            "event": np.array([mark.t for mark in marks]),
            "sample": display.replay.t,
        }
        error = errors_in(display)[-1] if self._moment is None else self._moment.error
        curve, colour = shown_curve(display, error), self._colours.get(display.source, palette.IMU)
        self._timeline.load(marks, display.replay.anchors.tolist(), below, curve, colour)
        self._findings.load(result, outside(below.findings, display.start, display.end))
        self._drift.content = drift_tab(result, self._colours)
        self.is_due.at_once()

    def _draw(self, now: float) -> None:
        """Write the instant of the clock: poses every turn, the rest as often as it can be read."""
        if self.charts.part != self.player.part:
            self._timeline.choose_part()
            self.charts.choose_part(self.player.part)
        sample = self._display.at(self.player.time)
        self.draw(sample)
        if self.is_due("labels", now):
            self.annotate(sample)
            for name, there in self.scene.extra_paths.there.items():
                self.extra_path_boxes[name].visible = there
            self._panel.show(sample, self.scene.ground.cell, self.scene.extra_paths.visible)
            self._timeline.show()
        self.draw_trails(now, sample, self.scene.trails)
        self.draw_charts(now, lambda: self.charts.show(sample))
