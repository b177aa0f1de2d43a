"""The live page as its users have it: the command in a process of its own, a simulated vehicle, headless Chromium."""

from __future__ import annotations

import contextlib
import math
import re
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

import companion as c
from tests.processes import COMPANION, Process, ended, next_line, started
from tests.simulated import flying, free_port
from tests.view.browsing import choose, keep, near, new_page, open_page, shoot, unfold, until

pytestmark = pytest.mark.browser


@contextlib.contextmanager
def viewing(link: str, folder: Path, *options: str, port: int) -> Iterator[tuple[Process, str]]:
    """The command in a process of its own, and the address of its page."""
    with started(*COMPANION, "view", link, "--port", str(port), *options, cwd=folder) as process:
        found = re.search(r"http://\S+", next_line(process, process.stdout))
        assert found
        yield process, found[0]


def since_anchor(page: Page) -> tuple[float, float]:
    """s, of the reckoning that is anchored again and again, and of the free run; NaN for what is not shown."""
    cells = page.get_by_role("row", name="since anchor").get_by_role("cell").all_inner_texts()
    imu, free = (float(cell.split()[0]) if cell else math.nan for cell in cells[1:] or ["", ""])
    return imu, free


def anchor_now(page: Page) -> None:
    """Press the button, and wait until the free run has begun anew.

    A run only grows older, and on a busy machine the new one may be seen late for the first time: it is known by being
    no older than the press, the second before it from which it begins, and the rounding of what is shown.
    """
    until(lambda: since_anchor(page)[1] > 2.0)
    pressed = time.monotonic()
    page.get_by_role("button", name="Anchor now").click()
    until(lambda: since_anchor(page)[1] < time.monotonic() - pressed + 2.0)


def stands_still(page: Page, recording: Path, more: int) -> bool:
    """Whether what is shown stays as it is while so many bytes more are recorded."""
    held, size = since_anchor(page), recording.stat().st_size
    until(lambda: recording.stat().st_size > size + more)
    return since_anchor(page) == held


def chart_ends(page: Page) -> tuple[float, int]:
    """Where the first chart ends, and how many points it has."""
    script = """() => {
        const t = Object.values(window.__viserTestpoints.uplots)[0].chart.data[0];
        return [t[t.length - 1], t.length];
    }"""
    end, count = page.evaluate(script)
    return float(end), int(count)


def both_drawn(page: Page) -> bool:
    """Whether both drones and their trails are in the picture; one of them is see-through."""
    picture = shoot(page, "live")[:, 340:940]
    return all(near(picture, colour) > 40 for colour in ((230, 97, 1), (0, 114, 178)))


def dead_reckon_otherwise(page: Page) -> None:
    """From another IMU, by another integrator, and back again."""
    unfold(page, "Dead reckoning")
    choose(page, "IMU", "SCALED_IMU2")
    expect(page.get_by_text("vehicle 1:1, boot 1, SCALED_IMU2")).to_be_visible()
    choose(page, "Integrator", "Euler (simplest)")
    anchor_now(page)
    choose(page, "IMU", "Automatic")
    expect(page.get_by_text("vehicle 1:1, boot 1, HIGHRES_IMU")).to_be_visible()


def each_has_its_own_camera(leaves: Page, stays: Page) -> None:
    """Two browsers on a link: one picture for all, and whoever stays is served on."""
    pages = (leaves, stays)
    for page in pages:
        unfold(page, "Picture")
    choose(leaves, "Camera", "From above")
    cameras = [page.get_by_role("combobox", name="Camera", exact=True) for page in pages]
    expect(cameras[0]).to_have_value("From above")
    expect(cameras[1]).to_have_value("Follow")
    stays.get_by_role("button", name="Pause", exact=True).click()
    for page in pages:  # whoever holds the picture says so to everyone
        expect(page.get_by_text("PAUSED")).to_be_visible()

    def differ() -> bool:
        shots = [shoot(page, f"live-two-browsers-{i}")[:, 350:900].astype(int) for i, page in enumerate(pages)]
        return bool(np.abs(shots[0] - shots[1]).mean() > 1)

    until(differ)
    leaves.get_by_role("button", name="Live", exact=True).click()
    expect(stays.get_by_text("LIVE", exact=True)).to_be_visible()
    leaves.context.close()
    before = since_anchor(stays)[1]
    until(lambda: since_anchor(stays)[1] > before + 1.0)


def test_a_live_session_and_the_next_one(browser: Browser, page: Page, tmp_path: Path) -> None:
    link_port, page_port = free_port(), free_port()
    recording = tmp_path / "a.tlog"
    with flying(link_port, since=8.0, streams={"SCALED_IMU2": 50.0}) as vehicle:
        with viewing(f"udpin:127.0.0.1:{link_port}", tmp_path, "-o", "a.tlog", port=page_port) as (process, url):
            open_page(page, url)
            expect(page.get_by_text("LIVE", exact=True)).to_be_visible()
            expect(page.get_by_text("ArduPilot 4.7.0 quadrotor, vehicle 1:1, boot 1, HIGHRES_IMU")).to_be_visible()
            expect(page.get_by_text("● Recording a.tlog")).to_be_visible()
            row = page.get_by_role("row", name="RAW_IMU")
            expect(row).to_have_text(re.compile("RAW_IMU(9[5-9]|10[0-5]) . 100 Hz"))
            until(lambda: since_anchor(page)[1] > 4.0)
            until(lambda: both_drawn(page))
            until(lambda: chart_ends(page)[1] > 50)
            assert chart_ends(page)[0] == pytest.approx(0.0, abs=1e-6)

            page.get_by_role("button", name="Pause", exact=True).click()
            expect(page.get_by_text("PAUSED")).to_be_visible()
            until(lambda: stands_still(page, recording, 10_000))  # the last numbers may still be on their way
            held = since_anchor(page)
            assert stands_still(page, recording, 20_000)
            page.mouse.click(640, 250)  # on the ground: the keys go to the page
            for _ in range(3):
                page.keyboard.press("ArrowLeft")
            until(lambda: abs(since_anchor(page)[1] - (held[1] - 3.0)) < 1.1)
            keep(page, "live-look-back")
            page.get_by_role("button", name="Live", exact=True).click()
            expect(page.get_by_text("LIVE", exact=True)).to_be_visible()

            dead_reckon_otherwise(page)
            anchor_now(page)
            page.get_by_role("button", name="Free run").click()

            vehicle.reboot()
            expect(page.get_by_text("vehicle 1:1, boot 2")).to_be_visible()
            keep(page, "live-second-boot")
            reported: list[str] = []
            page.on("console", lambda message: reported.append(message.text))
            _, sent = ended(process, signal.SIGTERM)
            assert process.returncode == 0
            assert "Traceback" not in sent
            until(lambda: vehicle.interval_us("RAW_IMU") == -1)  # as it was before
        first, second = c.open_log(recording)
        assert (first.boot, second.boot) == (1, 2)
        assert (first.messages["RAW_IMU"].longest_gap_s or 9.0) < 0.02, "no sample lost"
        # the page is still open: it finds the next server by itself, however long that takes. A browser makes a page
        # that knocked in vain every second wait for ever longer, until viser has given up each time before it may try.
        expect(page.get_by_text("companion has ended")).to_be_visible()
        assert sum(text.startswith("Connecting to") for text in reported) <= 1
        again = viewing(f"udpin:127.0.0.1:{link_port}", tmp_path, "--no-record", port=page_port)
        with again as (process, url), new_page(browser) as other:
            expect(page.get_by_text("Not recorded")).to_be_visible()
            for each in (page, open_page(other, url, charts=False)):
                expect(each.get_by_text("LIVE", exact=True)).to_be_visible()
            keep(page, "live-reconnected")
            each_has_its_own_camera(leaves=other, stays=page)
            _, sent = ended(process, signal.SIGTERM)
            assert (process.returncode, "Traceback" in sent) == (0, False)


def test_a_silent_link_on_a_small_window(browser: Browser, tmp_path: Path) -> None:
    port = free_port()
    with (
        new_page(browser, 390, 844) as page,
        viewing(f"udpin:127.0.0.1:{port}", tmp_path, port=free_port()) as (_, url),
    ):
        open_page(page, url, charts=False)
        expect(page.get_by_text("WAITING")).to_be_visible()
        expect(page.get_by_text("nobody has sent anything yet").first).to_be_visible()
        with flying(port, since=8.0, streams={"ATTITUDE": 10.0}):
            expect(page.get_by_text("LIVE", exact=True)).to_be_visible()
        expect(page.get_by_text("RECONNECTING")).to_be_visible()
        expect(page.get_by_text(re.compile("silent for [0-9]+ s")).first).to_be_visible()
        keep(page, "live-390x844")
