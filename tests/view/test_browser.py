"""The page as a user has it: headless Chromium against a viewer in this process."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page, expect

from companion.comparison import Replay
from companion.model import Flight, StatusText, Vehicle
from companion.verdict import Cause, Finding, Verdict
from companion.view import (
    AnalysisResult,
    DisplayTrajectory,
    ReplayChoice,
    Viewer,
    chosen_track,
    controller,
    display_trajectory,
    export,
)
from companion.view.panels.chart import Chart, LogChart, relayout
from companion.view.panels.chart_pages import ChartPages
from companion.view.panels.dead_reckoning import GYRO_UNIT
from companion.view.scene.cameras import FIELD_OF_VIEW, screen_up
from companion.view.state.moments import moment_of
from tests.view.browsing import choose, keep, looked_at, near, new_page, next_port, open_page, shoot, unfold, until
from tests.view.circles import BOOT, dead_reckon, examine, make_flight, recompute
from tests.waiting import LIMIT_S

pytestmark = pytest.mark.browser


def visit(page: Page, viewer: Viewer) -> Page:
    """Open the viewer's page and wait until all of it is there."""
    open_page(page, viewer.url)
    expect(page.get_by_role("button", name="Play", exact=True)).to_be_visible()
    return page


def cursor(page: Page) -> float:
    """Where the first chart in the page has its line, s, boot clock."""
    script = """() => {
        const chart = Object.values(window.__viserTestpoints.uplots)[0].chart;
        const line = chart.data[chart.data.length - 1];
        return chart.data[0][line.indexOf(2)];
    }"""
    return float(page.evaluate(script))


def begin(viewer: Viewer) -> None:
    """Go to the start: the page opens where the flight differs most."""
    viewer.post(partial(viewer.player.go, BOOT))
    until(lambda: viewer.player.time == BOOT, "the start")


def hear_all(page: Page, viewer: Viewer, t: float) -> None:
    """Go to t s and wait until the charts say so: what the page was sent before has arrived too."""
    viewer.post(partial(viewer.player.seek, t))
    until(lambda: abs(cursor(page) - t) < 0.2, "the instant in the charts")


def test_play(wide_page: Page, flight: Flight) -> None:
    page = wide_page
    with Viewer([flight], recompute, examine, port=next_port(page)) as viewer:
        visit(page, viewer)
        before = (
            viewer.player.time,
            viewer.controller.scene.imu.position,
            viewer.controller.scene.imu.attitude.wxyz.copy(),
            cursor(page),
        )
        keep(page, "before-play")
        page.get_by_role("button", name="Play", exact=True).click()
        expect(page.get_by_role("button", name="Pause", exact=True)).to_be_visible()

        updates = viewer.controller.pose_updates
        until(
            lambda: viewer.player.time > before[0] + 1.0 and viewer.controller.pose_updates > updates + 20, "it plays"
        )
        page.get_by_role("button", name="Pause", exact=True).click()
        until(lambda: not viewer.player.playing, "paused")
        assert np.linalg.norm(viewer.controller.scene.imu.position - before[1]) > 1.0
        assert np.abs(viewer.controller.scene.imu.attitude.wxyz - before[2]).max() > 0.01
        until(lambda: abs(cursor(page) - before[3] - (viewer.player.time - before[0])) < 0.1, "the charts' cursor")
        unfold(page, "Picture")
        choose(page, "Paths", "Whole path")

        def both_drawn() -> bool:
            canvas = shoot(page, "after-play")[:, 400:1230]
            return all(near(canvas, colour) > 200 for colour in ((230, 97, 1), (0, 114, 178)))

        until(both_drawn, "a trail of each source")


def where_is(replay: Replay, t: float, page: Page, viewer: Viewer) -> tuple[float, float]:
    """Where in the only page the autopilot's path is at t s, seen by its camera as it stands.

    The picture lies between the panels, whose widths depend on how the window came to its size.
    """
    (browser,) = viewer.controller.browsers._open.values()
    view, box = browser.client.camera, page.locator("canvas").first.bounding_box()
    assert box is not None
    along = view.look_at - view.position
    along, up = along / np.linalg.norm(along), screen_up(along)
    up /= np.linalg.norm(up)
    offset = replay.position_ref[np.searchsorted(replay.t, t)] - view.position
    scale = box["height"] / (2 * float(np.tan(FIELD_OF_VIEW / 2)) * float(offset @ along))
    right, above = scale * float(offset @ np.cross(along, up)), scale * float(offset @ up)
    return box["x"] + box["width"] / 2 + right, box["y"] + box["height"] / 2 - above


def test_scrub_and_keys(page: Page, flight: Flight) -> None:
    with Viewer([flight], recompute, examine, port=next_port(page)) as viewer:
        visit(page, viewer)
        page.mouse.click(640, 250)  # on the ground: the keys go to the page
        page.keyboard.press("End")
        until(lambda: viewer.player.time == viewer.player.end, "the End key")
        page.keyboard.press("ArrowLeft")
        until(lambda: viewer.player.time == pytest.approx(viewer.player.end - 1.0), "the left arrow")
        page.keyboard.press("Home")
        until(lambda: viewer.player.time == viewer.player.start, "the Home key")
        page.keyboard.press("Space")
        until(lambda: viewer.player.playing, "the space bar")
        page.keyboard.press("Space")
        until(lambda: not viewer.player.playing, "the space bar again")
        page.keyboard.press("5")
        until(lambda: viewer.player.time == pytest.approx(viewer.player.start + 0.5 * viewer.player.duration), "5")
        page.keyboard.press("PageDown")
        until(lambda: viewer.player.time == pytest.approx(BOOT + 30.0), "the next anchor")
        page.keyboard.press("Shift+ArrowRight")
        until(lambda: viewer.player.time == pytest.approx(BOOT + 30.02), "one sample on")
        page.keyboard.press("i")
        until(lambda: viewer.player.start == pytest.approx(BOOT + 30.02), "a part from here")
        page.keyboard.press("b")
        until(lambda: viewer.player.part == viewer.player.whole, "the whole again")
        page.keyboard.press("Home")
        page.get_by_role("button", name="Forward 10 s", exact=True).click()
        until(lambda: viewer.player.time > viewer.player.start + 9.9, "the button that steps forward")
        flown = dead_reckon(flight, ReplayChoice())
        page.keyboard.press("f")  # all of it in the picture

        def clicked() -> bool:
            """The picture may be drawn anew under the pointer: a click that nothing hears is made again."""
            page.mouse.click(*where_is(flown, BOOT + 20.0, page, viewer))
            return abs(viewer.player.time - BOOT - 20.0) < 1.0

        until(clicked, "a click on the path")
        slider = page.get_by_role("slider").first
        box = slider.locator("xpath=ancestor::*[contains(@class,'Slider-root')]").bounding_box()
        assert box is not None
        page.mouse.click(box["x"] + 0.75 * box["width"], box["y"] + box["height"] / 2)
        middle = viewer.player.start + 0.75 * viewer.player.duration
        until(lambda: abs(viewer.player.time - middle) < 3.0, "the slider")


def test_controls_reckon_anew(page: Page, flight: Flight) -> None:
    requested: list[ReplayChoice] = []
    seen = threading.Event()

    def listen(flight: Flight, choice: ReplayChoice) -> DisplayTrajectory:
        requested.append(choice)
        if choice.how.method == "euler" and len(requested) == 2:
            seen.wait(LIMIT_S)  # longer work
        return recompute(flight, choice)

    with Viewer([flight], listen, examine) as viewer:  # loaded anew: of the last server the page keeps what was typed
        visit(page, viewer)
        unfold(page, "Dead reckoning", "Picture")
        begin(viewer)
        choose(page, "Integrator", "Euler (simplest)")
        until(lambda: requested[-1].how.method == "euler", "the integrator")
        expect(page.get_by_text(re.compile(r"Recomputing for \d+ s"))).to_be_visible()
        seen.set()
        expect(page.get_by_text("Recomputing for")).to_have_count(0)  # done
        choose(page, "IMU", "SCALED_IMU2")
        until(lambda: requested[-1].imu == "SCALED_IMU2", "the IMU")
        choose(page, "Interpolation", "Linear")
        until(lambda: requested[-1].how.middle == "linear", "the middle sample")
        page.get_by_role("button", name="Forward 10 s", exact=True).click()
        page.get_by_role("button", name="Start from the instant shown").click()
        until(lambda: requested[-1].start_s == pytest.approx(110.0, abs=0.1), "the start")
        until(lambda: viewer.player.start == pytest.approx(110.0, abs=0.1), "the new interval")
        page.get_by_role("textbox", name="Segments").fill("4")
        until(lambda: requested[-1].how.segments == 4, "the segments")
        choose(page, "Gravity, m/s²", "Where it flew (WGS-84)")
        until(lambda: requested[-1].gravity == "normal", "the gravity")
        page.get_by_text("Subtract a bias from the IMU").click()
        label = f"//label[.='Gyro forward, {GYRO_UNIT}']"
        row = f"xpath={label}/ancestor::div[contains(@class,'Flex')][1]//input[@type='text']"
        page.locator(row).fill("3")
        until(lambda: requested[-1].gyro_bias == pytest.approx((3e-3, 0.0, 0.0)), "a gyro bias")
        page.get_by_role("button", name="No bias").click()
        until(lambda: requested[-1].gyro_bias == (0.0, 0.0, 0.0), "no bias")
        page.get_by_role("checkbox", name="Re-anchor").click()
        until(lambda: requested[-1].reanchor_s is None, "free running")
        page.get_by_role("button", name="Forward 10 s", exact=True).click()
        expect(page.get_by_role("cell", name="10.0 s since the anchor", exact=True)).to_be_visible()
        choose(page, "Camera", "Follow")
        choose(page, "Drones", "Smaller")
        keep(page, "free-running-follow")


def test_a_hostile_vehicle_that_is_chosen_is_only_text(page: Page, flight: Flight) -> None:
    evil = "<img src=x onerror=\"document.title='owned'\"><script>document.title='owned'</script>"
    reported = tuple(StatusText(BOOT + 10.0 * i, 4, f"{i} {evil}") for i in range(1, 4))
    hostile = Vehicle(7, 1, evil, "**bold**<script>")
    speaking = replace(make_flight(radius=20.0), vehicle=hostile, texts=reported, parameters={evil: 1.0})

    def find(flight: Flight, choice: ReplayChoice, display: DisplayTrajectory) -> AnalysisResult:
        result = examine(flight, choice, display)
        found = Finding("frozen", "imu", "error", BOOT + 45.0, BOOT + 46.0, f"seen {evil}", f"do {evil}")
        verdict = Verdict("imu_suspect", f"Suspect {evil}", (found,))
        return replace(result, assessment=replace(result.assessment, verdict=verdict))

    with Viewer([flight, speaking], recompute, find, port=next_port(page)) as viewer:
        visit(page, viewer)
        choose(page, "Flight", "2: vehicle 7:1, boot 1, 61 s")
        expect(page.get_by_text(re.compile("<img src=x onerror=.*vehicle 7:1"))).to_be_visible()  # as text
        page.get_by_role("tab", name="Findings", exact=True).click()
        expect(page.get_by_text("seen <img src=x onerror=").first).to_be_visible()
        begin(viewer)
        unfold(page, "Playing")
        page.get_by_role("button", name="Next event").click()
        until(lambda: viewer.player.time == pytest.approx(BOOT + 10.0), "the first thing it said")
        page.get_by_role("combobox", name="Go to", exact=True).click()
        page.get_by_role("option", name="4: 145.0 s, frozen").click()
        until(lambda: viewer.player.time == pytest.approx(BOOT + 45.0), "the finding")
        time.sleep(0.5)
        assert page.title() != "owned"
        assert page.locator("img[src=x]").count() == 0
        keep(page, "hostile-texts")


def test_a_zoom_stays_while_it_plays(page: Page, flight: Flight, monkeypatch: pytest.MonkeyPatch) -> None:
    laid_out, load, known = list[int](), ChartPages.load, list[bool]()

    def counted(charts: Sequence[Chart | LogChart]) -> None:
        relayout(charts)
        laid_out.append(len(charts))

    def loaded(plots: ChartPages, display: DisplayTrajectory, *rest: Any) -> None:
        load(plots, display, *rest)
        known.append(display.result is not None)

    monkeypatch.setattr(controller, "relayout", counted)
    monkeypatch.setattr(ChartPages, "load", loaded)
    zoom = """() => Object.values(window.__viserTestpoints.uplots).map(
        p => [p.createCount, p.chart.scales.x.min, p.chart.scales.x.max])"""
    with Viewer([flight], recompute, examine, port=next_port(page)) as viewer:
        visit(page, viewer)
        until(lambda: any(known), "the analysis, whose expected band builds the charts anew")
        until(lambda: len(laid_out) >= 2, "the charts are laid out twice; the third time must keep the zoom")
        hear_all(page, viewer, BOOT + 1.0)
        chart = page.locator(".u-over").first

        def zoomed() -> bool:
            """Drag over the second quarter of the chart, wherever it is now: what comes in above it moves it."""
            box = chart.bounding_box()
            if box is None:
                return False
            y = box["y"] + box["height"] / 2
            page.mouse.dblclick(box["x"] + 0.25 * box["width"], y)
            page.mouse.down()
            page.mouse.move(box["x"] + 0.5 * box["width"], y, steps=5)
            page.mouse.up()
            return bool(page.evaluate(zoom)[0][1:] == pytest.approx([BOOT + 15.0, BOOT + 30.0], abs=1.0))

        until(zoomed, "the chart zoomed to the second quarter")
        before = page.evaluate(zoom)
        assert page.locator(".u-legend .u-value").first.inner_text() != "--"  # the values where the pointer is
        viewer.post(viewer.player.toggle)
        until(lambda: len(laid_out) >= 3, "the third layout")
        viewer.post(viewer.player.toggle)
        hear_all(page, viewer, BOOT + 2.0)
        assert page.evaluate(zoom) == before
        keep(page, "zoomed")
        viewer.post(partial(viewer.player.seek, BOOT + 40.0))
        viewer.post(partial(viewer.player.cut, "from"))  # a part is a zoom that all charts share, and is thinned anew
        until(lambda: page.evaluate(zoom)[0][1] == pytest.approx(BOOT + 40.0), "the charts of the part")


def test_two_browsers_have_a_camera_each(browser: Browser, page: Page, flight: Flight) -> None:
    with Viewer([flight], recompute, examine, port=next_port(page)) as viewer, new_page(browser) as other:
        pages = [visit(each, viewer) for each in (other, page)]
        for each in pages:
            unfold(each, "Picture")
        choose(pages[0], "Camera", "Chase")
        viewer.post(partial(viewer.player.seek, BOOT + 20.0))
        expect(pages[0].get_by_role("combobox", name="Camera", exact=True)).to_have_value("Chase")
        expect(pages[1].get_by_role("combobox", name="Camera", exact=True)).to_have_value("Free")

        def differ() -> bool:
            shots = [shoot(page, f"two-browsers-{i}")[:, 350:900].astype(int) for i, page in enumerate(pages)]
            return bool(np.abs(shots[0] - shots[1]).mean() > 1)

        until(differ, "two pictures")
        pages[0].context.close()
        choose(pages[1], "Camera", "Follow")  # whoever stays is served on
        viewer.post(partial(viewer.player.seek, BOOT + 30.0))
        until(lambda: viewer.player.time == BOOT + 30.0, "the instant")


def test_names_have_no_white_ground_on_a_dark_page(browser: Browser, flight: Flight) -> None:
    """viser draws them black on white, 1,500 pixels for each; nothing else in the picture is as white."""
    with Viewer([flight], recompute, examine, port=0) as viewer, new_page(browser, color_scheme="dark") as page:
        visit(page, viewer)

        def picture() -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
            return shoot(page, "dark-names")[120:560, 350:930]

        until(lambda: near(picture(), (230, 97, 1)) > 200, "the drones")
        assert near(picture(), (255, 255, 255)) < 300


def test_what_is_expected_and_what_is_not_known(wide_page: Page, flight: Flight) -> None:
    page = wide_page

    def with_a_gap(flight: Flight, choice: ReplayChoice) -> DisplayTrajectory:
        replay = dead_reckon(flight, choice)
        known = np.abs(replay.t - (BOOT + 33.0)) > 2.0
        return display_trajectory(replace(replay, reference_valid=known), chosen_track(flight, choice))

    with Viewer([flight], with_a_gap, examine, port=next_port(page)) as viewer:
        visit(page, viewer)
        viewer.post(partial(viewer.player.seek, BOOT + 33.0))
        unfold(page, "Picture")
        page.get_by_role("checkbox", name="Arrows").click()
        expect(page.get_by_text("autopilot silent here")).to_be_visible()
        viewer.post(partial(viewer.player.seek, BOOT + 28.0))
        series = "() => Object.values(window.__viserTestpoints.uplots)[0].chart.series.length"
        until(lambda: page.evaluate(series) == 6, "the lines of what is expected")
        keep(page, "envelope")
        choose(page, "Charts", "IMU readings")
        expect(page.get_by_text("Gyro, °/s")).to_be_visible()
        expect(page.get_by_text("Position error, m", exact=True)).to_have_count(0)
        keep(page, "imu-readings")


def test_the_picture_and_the_replay_can_be_taken_along(
    browser: Browser, page: Page, flight: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(export, "RENDER_TIMEOUT_S", LIMIT_S)  # a busy machine without a graphics card draws slowly
    with Viewer([flight], recompute, examine, port=next_port(page)) as viewer:
        visit(page, viewer)
        unfold(page, "Picture", "Save")
        page.get_by_role("checkbox", name="Dark").click()
        with looked_at(page), page.expect_download() as download:
            page.get_by_role("button", name="This picture (PNG)").click()
        download.value.save_as(tmp_path / "picture.png")
        pixels = np.asarray(Image.open(tmp_path / "picture.png").convert("RGB"))
        assert near(pixels, (230, 97, 1)) > 100
        with page.expect_download() as download:
            page.get_by_role("button", name="The 3D replay (HTML)").click()
        download.value.save_as(tmp_path / "replay.html")
    with new_page(browser) as saved:
        saved.context.set_offline(True)
        saved.goto((tmp_path / "replay.html").as_uri())
        saved.wait_for_selector("canvas")
        until(lambda: near(shoot(saved, "replay-page"), (230, 97, 1)) > 100, "the path in the page")
        saved.get_by_role("button", name="Close").or_(saved.locator(".mantine-Notification-closeButton")).click()
        assert near(shoot(saved, "replay-page"), (255, 255, 255)) < 300, "no name has a white ground"


def test_a_page_finds_its_way_back_to_a_server_that_was_restarted(page: Page, flight: Flight) -> None:
    with Viewer([flight], recompute, examine, port=next_port(page)) as viewer:
        port = viewer.port
        visit(page, viewer)
        begin(viewer)
        page.get_by_role("button", name="Forward 10 s", exact=True).click()
        until(lambda: page.evaluate("localStorage['companion-views'] ?? ''").count('"110'), "the view is remembered")
    with Viewer([flight], recompute, examine, port=port) as viewer:
        assert viewer.port == port
        until(lambda: len(viewer.controller.browsers) == 1, "the page comes back")
        begin(viewer)
        page.get_by_role("button", name="Forward 10 s", exact=True).click()
        until(lambda: viewer.player.time == pytest.approx(BOOT + 10.0), "its buttons work")
        unfold(page, "Picture")
        choose(page, "Camera", "Chase")  # a list of the new session
        keep(page, "reconnected")


def test_a_page_with_a_token_is_opened_and_opened_again(wide_page: Page, flight: Flight) -> None:
    """The cookie goes with the WebSocket, and with a reload of the address that no longer has the token."""
    with Viewer([flight], recompute, examine, port=0, token=True) as viewer:
        visit(wide_page, viewer)
        assert wide_page.url == viewer.url.partition("?")[0]
        wide_page.reload()
        expect(wide_page.get_by_role("button", name="Play", exact=True)).to_be_visible()
        assert len(viewer.controller.browsers) == 1


def test_it_opens_at_the_fault_plays_what_led_to_it_and_goes_to_a_findings_worst(page: Page, flight: Flight) -> None:
    """The error grows from each anchor, every 10 s: the worst of the fault is not where it begins."""

    def find(flight: Flight, choice: ReplayChoice, display: DisplayTrajectory) -> AnalysisResult:
        result = examine(flight, choice, display)
        cause = Cause("gyro_bias", "imu", BOOT + 33.0, BOOT + 44.0, 0.1, "gyro", "z", side_probability=0.98)
        found = Finding("gyro_bias", "imu", "error", BOOT + 33.0, BOOT + 44.0, "it is off", "warm it up", cause=cause)
        verdict = Verdict("imu_suspect", "Suspect the IMU: it is off.", (found,), cause)
        return replace(result, assessment=replace(result.assessment, verdict=verdict))

    with Viewer([flight], recompute, find, port=next_port(page)) as viewer:
        visit(page, viewer)
        expect(page.get_by_text("Gyro z wrong, 133-144 s")).to_be_visible()
        expect(page.get_by_text("probability 98 %")).to_be_visible()
        until(lambda: BOOT + 39.9 < viewer.player.time < BOOT + 40.0, "the largest error before the next anchor")
        page.get_by_role("button", name="Play these 10 s").click()
        until(lambda: viewer.player.playing and viewer.player.time < BOOT + 39.9, "from 3 s before the onset on")
        viewer.post(partial(setattr, viewer.player, "speed", 20.0))
        until(lambda: not viewer.player.playing, "it pauses")
        assert viewer.player.time == pytest.approx(BOOT + 40.0)
        page.get_by_role("tab", name="Findings", exact=True).click()
        expect(page.get_by_text("What to do: warm it up")).to_be_visible()
        page.get_by_role("button", name="Fault: gyro bias").click()
        (found,) = viewer.controller._display.result.assessment.verdict.findings  # type: ignore[union-attr]
        strongest = moment_of(found, viewer.controller._display).strongest_s
        until(lambda: viewer.player.time == pytest.approx(strongest), "its strongest moment")
        expect(page.get_by_text("Attitude error since the anchor, °")).to_be_visible()
        keep(page, "finding")
