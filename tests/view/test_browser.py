"""The page as a user has it: headless Chromium against a viewer in this process."""

from __future__ import annotations

import io
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page, expect, sync_playwright

from companion.analysis import Replay
from companion.tracks import Flight, Vehicle
from companion.view import ReplayChoice, Viewer
from tests.view.circles import make_flight, recompute

pytestmark = pytest.mark.browser

CHROMIUM = Path(os.environ.get("CHROMIUM", "/usr/bin/chromium"))
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-timer-throttling",
]
SCREENSHOTS = Path(__file__).parents[2] / "screenshots"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    if not CHROMIUM.exists():
        reason = f"no Chromium at {CHROMIUM}: apt-get install chromium, or set CHROMIUM to its path"
        if os.environ.get("CI") == "true":
            pytest.fail(reason)
        pytest.skip(reason)
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield chromium
        chromium.close()


@pytest.fixture
def page(browser: Browser) -> Iterator[Page]:
    context = browser.new_context(viewport={"width": 1600, "height": 900})
    yield context.new_page()
    context.close()


def visit(page: Page, viewer: Viewer) -> Page:
    """Open the viewer's page and wait until all of it is there."""
    page.goto(viewer.url)
    page.wait_for_selector("canvas")
    expect(page.get_by_role("button", name="Play", exact=True)).to_be_visible()
    # viser's remark that this machine has no graphics card: true, and in the way
    remark = page.get_by_role("alert").get_by_role("button")
    if remark.count():
        remark.first.click()
    return page


def until(condition: Callable[[], bool], what: str, seconds: float = 15.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"not within {seconds} s: {what}"
        time.sleep(0.05)


def shoot(page: Page, name: str) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Save a screenshot and give the pixels of it (H, W, 3)."""
    SCREENSHOTS.mkdir(exist_ok=True)
    png = page.screenshot(path=SCREENSHOTS / f"{name}.png")
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


def near(pixels: np.ndarray[tuple[int, ...], np.dtype[np.uint8]], colour: tuple[int, int, int]) -> int:
    """How many pixels have about this colour."""
    return int((np.abs(pixels.astype(int) - colour).max(axis=2) < 40).sum())


def choose(page: Page, label: str, option: str) -> None:
    """Choose from one of the panel's lists."""
    page.get_by_role("combobox", name=label, exact=True).click()
    page.get_by_role("option", name=option, exact=True).click()


def cursor(page: Page) -> float:
    """Where the first chart in the page has its line, s."""
    script = """() => {
        const chart = Object.values(window.__viserTestpoints.uplots)[0].chart;
        const line = chart.data[chart.data.length - 1];
        return chart.data[0][line.indexOf(2)];
    }"""
    return float(page.evaluate(script))


def test_play(page: Page, flight: Flight) -> None:
    with Viewer([flight], recompute, port=0) as viewer:
        visit(page, viewer)
        before = (viewer.player.time, viewer.scene.imu.position, viewer.scene.imu.wxyz, cursor(page))
        shoot(page, "before-play")
        page.get_by_role("button", name="Play", exact=True).click()
        expect(page.get_by_role("button", name="Pause", exact=True)).to_be_visible()

        updates, start = viewer.pose_updates, time.monotonic()
        time.sleep(3.0)
        rate = (viewer.pose_updates - updates) / (time.monotonic() - start)
        print(f"{rate:.1f} pose updates/s with one client")
        assert rate >= 20.0

        page.get_by_role("button", name="Pause", exact=True).click()
        until(lambda: not viewer.player.playing, "paused")
        assert 2.0 < viewer.player.time - before[0] < 10.0
        assert np.linalg.norm(viewer.scene.imu.position - before[1]) > 1.0
        assert np.abs(viewer.scene.imu.wxyz - before[2]).max() > 0.01
        until(lambda: abs(cursor(page) - before[3] - (viewer.player.time - before[0])) < 0.1, "the charts' cursor")
        choose(page, "Paths", "Whole path")
        time.sleep(1.0)
        pixels = shoot(page, "after-play")
        canvas = pixels[:, 400:1230]
        assert pixels.std() > 10
        for colour in ((230, 97, 1), (0, 114, 178)):  # a trail of each source
            assert near(canvas, colour) > 200


def test_scrub_and_keys(page: Page, flight: Flight) -> None:
    with Viewer([flight], recompute, port=0) as viewer:
        visit(page, viewer)
        page.mouse.click(800, 850)  # on the ground: the keys go to the page
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
        page.get_by_role("button", name="+10", exact=True).click()
        until(lambda: viewer.player.time > viewer.player.start + 9.9, "the button that steps forward")
        slider = page.get_by_role("slider").first
        box = slider.locator("xpath=ancestor::*[contains(@class,'Slider-root')]").bounding_box()
        assert box is not None
        page.mouse.click(box["x"] + 0.75 * box["width"], box["y"] + box["height"] / 2)
        middle = viewer.player.start + 0.75 * viewer.player.duration
        until(lambda: abs(viewer.player.time - middle) < 3.0, "the slider")


def test_controls_reckon_anew(page: Page, flight: Flight) -> None:
    asked: list[ReplayChoice] = []

    def listen(flight: Flight, choice: ReplayChoice) -> Replay:
        asked.append(choice)
        return recompute(flight, choice)

    with Viewer([flight], listen, port=0) as viewer:
        visit(page, viewer)
        choose(page, "Integrator", "Euler (simplest)")
        until(lambda: asked[-1].method == "euler", "the integrator")
        choose(page, "IMU", "SCALED_IMU2")
        until(lambda: asked[-1].imu == "SCALED_IMU2", "the IMU")
        choose(page, "Joined by", "Straight lines (linear)")
        until(lambda: asked[-1].middle == "linear", "the middle sample")
        page.get_by_role("button", name="+10", exact=True).click()
        page.get_by_role("button", name="Start from the instant shown").click()
        until(lambda: asked[-1].start_s == pytest.approx(110.0, abs=0.1), "the start")
        until(lambda: viewer.player.start == pytest.approx(110.0, abs=0.1), "the new interval")
        page.get_by_role("checkbox", name="Re-anchor").click()
        until(lambda: asked[-1].reanchor_s is None, "free running")
        page.get_by_role("button", name="+10", exact=True).click()
        expect(page.get_by_text("10.0 s since anchor")).to_be_visible()
        choose(page, "Camera", "Follow")
        choose(page, "Drones", "Smaller")
        time.sleep(1.0)
        shoot(page, "free-running-follow")


def test_a_flight_chooser_and_hostile_names(page: Page) -> None:
    evil = "<img src=x onerror=\"document.title='owned'\">"
    first = make_flight()
    second = replace(make_flight(radius=20.0), vehicle=Vehicle(7, 1, evil, "**bold**<script>"))
    with Viewer([first, second], recompute, port=0) as viewer:
        visit(page, viewer)
        choose(page, "Flight", "2: vehicle 7:1, boot 1, 61 s")
        expect(page.get_by_text("<img src=x onerror=")).to_be_visible()  # as text
        time.sleep(0.5)
        assert page.title() != "owned"
        shoot(page, "two-flights")


def test_a_flight_without_position(page: Page, flight: Flight) -> None:
    def attitude_only(flight: Flight, choice: ReplayChoice) -> Replay:
        replay = recompute(flight, choice)
        nothing = np.zeros_like(replay.position_ref)
        return replace(
            replay,
            has_position=False,
            velocity_imu=nothing,
            position_imu=nothing,
            velocity_ref=nothing,
            position_ref=nothing,
            velocity_error=nothing,
            position_error=nothing,
        )

    with Viewer([flight], attitude_only, port=0) as viewer:
        visit(page, viewer)
        expect(page.get_by_text("This log has no position")).to_be_visible()
        expect(page.get_by_text("Velocity error")).to_have_count(0)
        page.get_by_role("button", name="+10", exact=True).click()
        time.sleep(1.0)
        assert shoot(page, "attitude-only").std() > 5


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)])
def test_smaller_windows(browser: Browser, flight: Flight, width: int, height: int) -> None:
    context = browser.new_context(viewport={"width": width, "height": height})
    with Viewer([flight], recompute, port=0) as viewer:
        page = context.new_page()
        page.goto(viewer.url)
        page.wait_for_selector("canvas")
        time.sleep(2.0)
        assert shoot(page, f"window-{width}x{height}").std() > 5
    context.close()
