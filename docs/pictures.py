"""The pictures of README and docs, made anew: `python docs/pictures.py [NAME...]`, all of them without a name.

Each is of `companion view` as its users run it, in headless Chromium, of a bundled or simulated flight. It needs
playwright and Chromium; CHROMIUM names another than chromium-headless-shell. On a slow machine it takes minutes.
"""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, FloatRect, Page, sync_playwright

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "images"
CHROMIUM = os.environ.get("CHROMIUM", "/usr/bin/chromium-headless-shell")
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
VERDICT = re.compile("No IMU fault found| wrong|Cannot tell|Too little")
FAULTY = ROOT / "tests" / "data" / "dataflash__sitl__copter-imu1-fail.BIN.xz"
LINK = "127.0.0.1:14650"
SETTLED_MS = 4000  # until what is laid out late is drawn
LEAVE_MS = 7000  # until the remark of viser on software drawing has gone


@contextlib.contextmanager
def running(*words: str) -> Iterator[subprocess.Popen[str]]:
    """A command of companion, ended in the end as by Ctrl-C."""
    command = [sys.executable, "-m", "companion", *words]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        yield process
        process.send_signal(signal.SIGINT)


@contextlib.contextmanager
def opened(browser: Browser, width: int, height: int, *words: str) -> Iterator[Page]:
    """The page that `companion view` serves."""
    with running("view", *words, "--port", "0") as process:
        assert process.stdout is not None
        address = next(filter(None, (re.search(r"http://\S+", line) for line in process.stdout)))
        page = browser.new_page(viewport={"width": width, "height": height})
        page.set_default_timeout(240_000.0)
        page.goto(address[0])
        page.wait_for_selector("canvas[data-engine]")
        page.wait_for_timeout(LEAVE_MS)
        yield page
        page.close()


def replayed(browser: Browser, name: str, log: str, size: tuple[int, int], then: Callable[[Page], object]) -> None:
    """A picture of a log's page, once the analysis is there."""
    with opened(browser, *size, log) as page:
        page.get_by_text(VERDICT).first.wait_for()
        page.get_by_text("calibrated 1σ").first.wait_for()
        then(page)
        page.wait_for_timeout(SETTLED_MS)
        page.get_by_text("The analysis has worked").first.wait_for(state="hidden")
        keep(page, name)


def keep(page: Page, name: str) -> None:
    """Write it, as a JPEG where its name says so; of the page with the tables their panel alone."""
    panel = FloatRect(x=0, y=0, width=334, height=688) if name == "viewer-verdict.jpg" else None
    with tempfile.TemporaryDirectory() as folder:
        page.screenshot(path=f"{folder}/page.png", clip=panel)
        picture = Image.open(f"{folder}/page.png").convert("RGB")
        if name.endswith("png"):
            picture.quantize(256, dither=Image.Dither.NONE).save(FOLDER / name, optimize=True)
        else:
            picture.save(FOLDER / name, quality=88, optimize=True)
    print(FOLDER / name, flush=True)


def tab(name: str) -> Callable[[Page], None]:
    """Choose a tab."""
    return lambda page: page.get_by_role("tab", name=name, exact=True).click()


def all_imus(page: Page) -> None:
    """Show the other IMU, the ellipsoid and the arrows."""
    for folder in ("Dead reckoning", "Picture"):
        page.get_by_text(folder, exact=True).click()
    for box in ("SCALED_IMU2", "3σ ellipsoid", "Arrows"):
        page.get_by_role("checkbox", name=re.compile(box)).click()
    page.get_by_text("Picture", exact=True).click()


def live(browser: Browser, name: str) -> None:
    """A vehicle that stands disarmed, on a link."""
    words = (f"udpin:{LINK}", "--no-record")
    with opened(browser, 1280, 800, *words) as page, running("simulate", f"udpout:{LINK}", "--motion", "rest"):
        page.get_by_text(re.compile("Before take-off: (go|no-go)")).first.wait_for()
        page.get_by_text("No IMU fault found").first.wait_for()
        page.wait_for_timeout(SETTLED_MS)
        keep(page, name)


PICTURES: dict[str, Callable[[Browser, str], None]] = {
    "replay.png": lambda browser, name: replayed(browser, name, str(FAULTY), (1440, 900), bool),
    "viewer.jpg": lambda browser, name: replayed(browser, name, "demo", (1440, 900), bool),
    "viewer-verdict.jpg": lambda browser, name: replayed(browser, name, "demo", (1440, 900), tab("Drift")),
    "viewer-charts.jpg": lambda browser, name: replayed(browser, name, "demo", (1440, 900), tab("Charts")),
    "viewer-imus.jpg": lambda browser, name: replayed(browser, name, "demo", (1440, 900), all_imus),
    "viewer-phone.jpg": lambda browser, name: replayed(browser, name, str(FAULTY), (390, 844), bool),
    "live.png": live,
}
"""Name in docs/images → how it is made."""


def main(names: list[str]) -> None:
    """Make them."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        for name in names or PICTURES:
            PICTURES[name](browser, name)
        browser.close()


if __name__ == "__main__":
    main(sys.argv[1:])
