"""The page in headless Chromium: charts and playback appear, nothing is asked of the network, nothing hostile runs."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Locator, Page

from companion.present import palette
from tests.report.pages import DEMO, report
from tests.report.test_page import hostile_log
from tests.view.browsing import near, new_page, until

pytestmark = pytest.mark.browser


class Watched:
    """A page, what it complained of and what it asked for."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.trouble: list[str] = []
        self.requests: list[str] = []
        page.on("console", lambda m: self.trouble.append(m.text) if m.type == "error" else None)
        page.on("pageerror", lambda error: self.trouble.append(str(error)))
        page.on("request", lambda request: self.requests.append(request.url))

    def open(self, path: Path) -> Page:
        """Go there and wait until every chart is drawn."""
        self.page.goto(path.as_uri())
        self.page.wait_for_selector("html[data-ready=yes]")
        return self.page


def pixels(part: Locator) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """What a part of the page looks like, (H, W, 3)."""
    return np.asarray(Image.open(io.BytesIO(part.screenshot())).convert("RGB"))


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of the demo, with its playback."""
    path = tmp_path_factory.mktemp("report") / "report.html"
    report(DEMO, path)
    return path


@pytest.fixture(scope="module")
def opened(browser: Browser, path: Path) -> Iterator[Watched]:
    """Its page: to load it takes most of what a test of it takes."""
    with new_page(browser, 1100, looking=True, color_scheme="dark") as page:
        watched = Watched(page)
        watched.open(path)
        page.evaluate("document.querySelectorAll('details').forEach(one => one.open = true)")
        until(
            lambda: page.evaluate("[...document.querySelectorAll('.chart')].every(c => c.querySelector('.main-svg'))")
        )
        yield watched


def test_the_page_asks_nobody_and_complains_of_nothing(opened: Watched, path: Path) -> None:
    page = opened.page
    charts = page.locator(".chart")
    assert charts.count() >= 9
    assert page.locator(".chart .main-svg").count() >= charts.count()
    assert page.evaluate("[...document.querySelectorAll('.chart')].every(c => c.data.length > 0)")

    page.get_by_role("button", name="Load the 3D playback").click()
    page.frame_locator("iframe").locator("canvas").first.wait_for()
    until(lambda: near(pixels(page.locator("iframe")), palette.IMU) > 50, "the IMU's path in the playback")
    assert page.locator("iframe").get_attribute("sandbox") == "allow-scripts"

    words = page.locator(".chart .main-svg text").first
    fill = "text => getComputedStyle(text).fill"
    assert words.evaluate(fill) == "rgb(230, 233, 236)"
    page.emulate_media(media="print")
    until(lambda: words.evaluate(fill) == "rgb(0, 0, 0)", "black on paper, in charts drawn anew for its width")
    assert not page.locator("iframe").is_visible()
    page.locator("iframe").evaluate("player => player.remove()")  # it plays, which takes a core from the tests after

    assert opened.trouble == []
    assert [url for url in opened.requests if not url.startswith(("data:", "blob:"))] == [path.as_uri()]


def test_a_link_to_a_part_unfolds_it_and_one_to_nothing_harms_nothing(opened: Watched) -> None:
    page, part = opened.page, "document.querySelector('#noise > details').open"
    page.evaluate("document.querySelector('#noise > details').open = false")
    page.evaluate("location.hash = '#1'")
    page.evaluate("location.hash = '#noise'")
    until(lambda: page.evaluate(part), "the part open")
    assert opened.trouble == []


def test_no_request_could_leave_the_page(opened: Watched) -> None:
    refused = opened.page.evaluate("fetch('http://127.0.0.1:9/').then(() => 'sent', e => String(e))")
    assert "Failed to fetch" in refused
    assert any("Content Security Policy" in words for words in opened.trouble)


def test_a_telephone_scrolls_down_and_not_sideways(opened: Watched) -> None:
    page = opened.page
    page.emulate_media(media="screen")
    page.set_viewport_size({"width": 360, "height": 700})
    until(lambda: page.evaluate("document.documentElement.scrollWidth") <= 360, "no wider than the telephone")


def test_charts_are_as_wide_as_their_places_though_the_window_stays(opened: Watched) -> None:
    page = opened.page
    over = "[...document.querySelectorAll('.chart')].map(c => c.querySelector('.main-svg').clientWidth - c.clientWidth)"
    for padding in (60, 10):
        page.evaluate("padding => document.body.style.padding = `0 ${padding}px`", padding)
        until(lambda: all(abs(one) <= 1 for one in page.evaluate(over)), "charts as wide as their places")


def test_what_a_vehicle_says_does_not_run(browser: Browser, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    report(hostile_log(tmp_path), path)
    with new_page(browser, 360, 700) as page:
        watched = Watched(page)
        watched.open(path)
        assert page.evaluate("document.documentElement.scrollWidth") <= 360, "a telephone scrolls down, not sideways"
        page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
        page.get_by_role("button", name="Load the 3D playback").click()
        page.frame_locator("iframe").locator("canvas").first.wait_for()
        assert page.evaluate("window.hacked") is None
        assert page.locator("text=window.hacked=3").count() > 0
        assert watched.trouble == []
