"""Headless Chromium for the tests of the pages: how to start it, wait, look and choose."""

from __future__ import annotations

import contextlib
import ctypes
import io
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from PIL import Image
from playwright.sync_api import Browser, Page, expect

from tests.waiting import LIMIT_S, wait_for

_BROWSERS = ("chromium-headless-shell", "chromium")  # the one without windows takes two thirds of the other's time
CHROMIUM = Path(os.environ.get("CHROMIUM") or next(filter(None, map(shutil.which, _BROWSERS)), "/usr/bin/chromium"))
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
SCREENSHOTS = Path(os.environ["SCREENSHOTS"]) if "SCREENSHOTS" in os.environ else None
"""The folder in which every picture that is looked at, and some more, are kept; None: they are not."""

# A picture is drawn two or three times a second: without a graphics card a page that plays would take a whole core, and
# on a busy machine it would have time for nothing else.
_SLOWLY = """(() => {
    const draw = window.requestAnimationFrame.bind(window), waiting = new Map();
    let last = 0;
    window.requestAnimationFrame = then => {
        const id = ++last;
        waiting.set(id, setTimeout(() => draw(t => { if (waiting.delete(id)) then(t); }), 400));
        return id;
    };
    window.cancelAnimationFrame = id => { clearTimeout(waiting.get(id)); waiting.delete(id); };
})()"""

# Nor is the scene drawn at all but while somebody looks: a fifth of what a test of the page takes.
_BLINDLY = """(() => {
    window.companionDraws = 0;
    for (const kind of [WebGLRenderingContext, WebGL2RenderingContext])
        for (const name of ['drawArrays', 'drawElements', 'drawArraysInstanced', 'drawElementsInstanced']) {
            const draw = kind.prototype[name];
            if (draw) kind.prototype[name] = function (...how) {
                if (!window.companionLooks) return;
                window.companionDraws += 1;
                draw.apply(this, how);
            };
        }
})()"""

# What fades or slides in would be drawn sixty times a second meanwhile, and a click would wait until it stands still.
# It still ends: by that what has slid away is taken out of the page.
_AT_ONCE = """addEventListener('DOMContentLoaded', () => {
    const style = document.createElement('style');
    style.textContent = `*, *::before, *::after {
        transition-duration: 1ms !important; transition-delay: 0s !important; animation: none !important;
    }`;
    document.head.append(style);
})"""

expect.set_options(timeout=1e3 * LIMIT_S)


def rank_with_the_tests() -> None:
    """Where the tests run as root Chromium's GPU process would set itself to nice -8, before the viewer that it shows.

    Whatever this thread starts from now on has no right to.
    """
    if sys.platform == "linux":
        drop_from_bounding_set, sys_nice = 24, 23  # linux/prctl.h, linux/capability.h
        ctypes.CDLL(None).prctl(drop_from_bounding_set, sys_nice, 0, 0, 0)  # refused to those who have none anyway


@contextlib.contextmanager
def new_page(
    browser: Browser, width: int = 1280, height: int = 800, *, looking: bool = False, **options: Any
) -> Iterator[Page]:
    """A page in a window of this size. looking: its scenes are drawn all the time, not only for `looked_at`."""
    context = browser.new_context(viewport={"width": width, "height": height}, **options)
    context.set_default_timeout(1e3 * LIMIT_S)
    context.add_init_script(_SLOWLY)
    context.add_init_script(_AT_ONCE)
    if not looking:
        context.add_init_script(_BLINDLY)
    yield context.new_page()
    context.close()


def next_port(page: Page) -> int:
    """Where an open page looks for its next server, to be given to that before it starts; 0 where none is open yet.

    A page that finds its way to a new server is not loaded anew, which takes most of what a test of it takes. It begins
    as one that was opened for the first time: nothing is remembered, and what it shows of the last server is marked.
    """
    if not page.url.startswith("http"):
        return 0
    page.evaluate("""() => {
        document.querySelectorAll('[data-companion-log]').forEach(log => delete log.dataset.companionLog);
        localStorage.clear();  // for good: of no log there is anything to remember, until the next server's is there
        document.title = '';
        document.querySelectorAll('[role=tab]').forEach(tab => tab.setAttribute('data-past', ''));
    }""")
    return urlsplit(page.url).port or 0


def open_page(page: Page, url: str, *, charts: bool = True) -> Page:
    """Go there and wait until the picture is: of half the resolution, for without a graphics card its pixels cost most.

    An address that says more than where is opened as it is, and one where the page is already comes to it by itself.
    charts: choose their tab; a phone has none on a link.
    """
    if page.url.startswith(f"{url}/"):
        expect(page.locator("[data-past], #companion-ended")).to_have_count(0)
    else:
        page.goto(url if "?" in url else f"{url}/?fixedDpr=0.5")
    page.wait_for_selector("canvas[data-engine]")
    expect(page.get_by_text("companion", exact=True)).to_be_visible()  # the panel
    if charts:
        page.get_by_role("tab", name="Charts", exact=True).click()
    # viser's remark that this machine has no graphics card: true, and in the way
    # which goes by itself too: a click that waits for it may wait for ever
    page.get_by_role("alert").get_by_role("button").evaluate_all("buttons => buttons.forEach(one => one.click())")
    return page


def until(condition: Callable[[], bool], what: str = "") -> None:
    """`wait_for`, without looking far more often than a page draws: a screenshot takes a tenth of a second of CPU."""
    wait_for(condition, what, look_s=0.15)


@contextlib.contextmanager
def looked_at(page: Page) -> Iterator[None]:
    """The scene is drawn meanwhile, once at least before it begins."""
    page.evaluate("() => { companionDraws = 0; companionLooks = true; }")
    page.wait_for_function("() => companionDraws > 0")
    yield
    page.evaluate("() => { companionLooks = false; }")


def shoot(page: Page, name: str) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """The pixels of what a page shows (H, W, 3), kept as a picture where pictures are."""
    with looked_at(page):
        png = page.screenshot()
    if SCREENSHOTS is not None:
        SCREENSHOTS.mkdir(parents=True, exist_ok=True)
        (SCREENSHOTS / f"{name}.png").write_bytes(png)
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


def keep(page: Page, name: str) -> None:
    """A picture for who wants to see what the tests see: SCREENSHOTS=folder keeps it there."""
    if SCREENSHOTS is not None:
        shoot(page, name)


def near(pixels: np.ndarray[tuple[int, ...], np.dtype[np.uint8]], colour: tuple[int, int, int]) -> int:
    """How many pixels have about this colour."""
    return int((np.abs(pixels.astype(int) - colour).max(axis=2) < 40).sum())


def unfold(page: Page, *folders: str) -> None:
    """Open folders of the panel."""
    for name in folders:
        page.get_by_text(name, exact=True).click()


def choose(page: Page, label: str, option: str) -> None:
    """Choose from one of the panel's lists."""
    page.get_by_role("combobox", name=label, exact=True).click()
    page.get_by_role("option", name=option, exact=True).click()
