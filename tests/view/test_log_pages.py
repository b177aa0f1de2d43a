"""The page of real and simulated logs, with the analysis behind it: headless Chromium, a viewer in this process."""

from __future__ import annotations

import contextlib
import re
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

import companion as c
from companion.app.examination import examine
from companion.app.recording import Source
from companion.app.settings import Settings
from companion.model import Flight, words
from companion.pages.replay import Answers, open_replay
from companion.present import headline, palette
from companion.simulate import SimulatedVehicle, fly, write_flight
from companion.view import Viewer
from companion.view.state.moments import moment_of
from tests.recordings import BUNDLED
from tests.view.browsing import choose, keep, near, new_page, next_port, open_page, shoot, unfold, until

pytestmark = pytest.mark.browser

DEMO = c.open_log(BUNDLED / "copter-demo-100hz.tlog")[0]
ANSWERS = Answers(Settings())  # one for all pages: what was examined last is remembered


@contextlib.contextmanager
def viewing(page: Page, *flights: Flight) -> Iterator[Viewer]:
    path = BUNDLED / "copter-demo-100hz.tlog"
    source = Source(path, "tlog", path.stat().st_size, 1)
    with open_replay(ANSWERS, flights, source=source, port=next_port(page)) as viewer:
        yield viewer


def tab(page: Page, name: str) -> None:
    page.get_by_role("tab", name=name, exact=True).click()


def test_the_verdict_and_a_jump_to_a_finding(page: Page) -> None:
    found = examine(DEMO, Settings()).assessment
    first = found.verdict.findings[0]
    with viewing(page, DEMO) as viewer:
        open_page(page, viewer.url)
        expect(page.get_by_text(headline(found.verdict).sentence).first).to_be_visible()
        tab(page, "Findings")
        viewer.post(partial(viewer.player.seek, viewer.player.end))
        page.get_by_role("button", name=f"Note: {words(first.kind)}").click()
        strongest = moment_of(first, viewer.controller._display).strongest_s
        until(lambda: abs(viewer.player.time - strongest) < 0.05, "the finding")
        expect(page.get_by_text(first.evidence).first).to_be_visible()
        tab(page, "Drift")
        row, expected = found.drift.rows[2], found.expected[2]
        assert expected is not None
        assert row.attitude_deg is not None
        lines = page.get_by_role("row")
        cells = lines.filter(has_text=re.compile(r"^5 s")).get_by_role("cell").all_inner_texts()
        assert cells[:3] == ["5 s", "median", f"{row.attitude_deg.median:.3f}"]
        cells = lines.filter(has_text=re.compile(rf"^{row.windows} windows")).get_by_role("cell").all_inner_texts()
        assert cells[:3] == [f"{row.windows} windows", "95 %", f"{row.attitude_deg.p95:.3f}"]
        tables = "[...document.querySelectorAll('.companion-table')]"
        assert page.evaluate(f"{tables}.filter(t => t.scrollWidth > t.parentElement.clientWidth).length") == 0
        expect(page.get_by_role("cell", name=f"{expected.position_m:.2f}", exact=True)).to_be_visible()
        expect(page.get_by_role("cell", name="SCALED_IMU2")).to_be_visible()
        keep(page, "verdict")
        tab(page, "Charts")
        choose(page, "Charts", "Drift by horizon")
        median = "() => Object.values(window.__viserTestpoints.uplots).map(p => Array.from(p.chart.data[1]))"
        sizes = [len(found.drift.rows)] * 3  # the charts of the page before are three too, and much longer
        until(lambda: [len(line) for line in page.evaluate(median)] == sizes, "charts of attitude, velocity, position")
        assert page.evaluate(median)[0] == pytest.approx(
            [r.attitude_deg.median for r in found.drift.rows if r.attitude_deg]
        )
        assert page.evaluate("() => Object.values(window.__viserTestpoints.uplots)[0].chart.scales.x.distr") == 3
        width = "() => Math.min(...Object.values(window.__viserTestpoints.uplots).map(p => p.chart.width))"
        until(lambda: page.evaluate(width) > 200.0, "charts as wide as their panel, which they are after their data")
        keep(page, "drift-by-horizon")
        choose(page, "Charts", "IMU noise")
        labels = "() => Object.values(window.__viserTestpoints.uplots).map(p => p.chart.series[0].label)"
        until(lambda: page.evaluate(labels) == ["Hz or s"] * 4, "spectra and Allan deviations")
        keep(page, "imu-noise")
        page.get_by_text("Save", exact=True).click()
        with page.expect_download() as download:
            page.get_by_role("button", name="The report (HTML)").click()
        report = Path(download.value.path()).read_text(encoding="utf-8")
        assert headline(found.verdict).sentence in report


def test_several_imus_a_correction_and_another_horizon(page: Page) -> None:
    names = "() => Object.values(window.__viserTestpoints.uplots)[0]?.chart.series.map(s => s.label) ?? []"
    with viewing(page, DEMO) as viewer:
        open_page(page, viewer.url)
        viewer.post(partial(viewer.player.seek, viewer.player.start + 48.0))
        unfold(page, "Dead reckoning", "Picture")
        choose(page, "Paths", "Whole path")
        page.get_by_role("checkbox", name="SCALED_IMU2", exact=True).click()
        until(lambda: "SCALED_IMU2 tilt" in page.evaluate(names), "a line of the other IMU")
        page.get_by_role("checkbox", name="3σ ellipsoid").click()
        ellipsoid = viewer.controller.scene.expected.node
        until(lambda: ellipsoid.visible, "the ellipsoid")
        axes = np.sort(ellipsoid.scale)
        assert axes[2] > 1.05 * axes[0] > 0  # not a ball
        colours = (palette.IMUS[0], palette.IMUS[1], palette.AUTOPILOT)

        def all_drawn() -> bool:
            canvas = shoot(page, "several-imus")[:, 340:940]
            return all(near(canvas, colour) > 100 for colour in colours)

        until(all_drawn, "the paths of all three")
        choose(page, "Readings", "Corrected by this flight's calibration")
        choose(page, "Charts", "IMU readings")
        until(lambda: "forward raw" in page.evaluate(names), "the readings before and after the correction")
        keep(page, "corrected-readings")
        choose(page, "Charts", "Errors over the horizon")
        choose(page, "Horizon", "10 s")
        expect(page.get_by_text("Attitude error after 10 s, °")).to_be_visible()
        choose(page, "IMU", "SCALED_IMU2")
        expect(page.get_by_text("Solid: SCALED_IMU2 alone")).to_be_visible()
        choose(page, "Charts", "Rates and gaps")
        until(
            lambda: page.evaluate(names)[1:5] == ["RAW_IMU", "SCALED_IMU2", "ATTITUDE", "LOCAL_POSITION_NED"], "rates"
        )
        keep(page, "rates-and-gaps")


def test_a_log_without_position(page: Page) -> None:
    with viewing(page, replace(DEMO, position=None)) as viewer:
        open_page(page, viewer.url)
        expect(page.get_by_text("This log has no position")).to_be_visible()
        expect(page.get_by_text("Velocity error")).to_have_count(0)
        expect(page.get_by_text(re.compile("No IMU fault|wrong|Cannot tell")).first).to_be_visible()
        before = viewer.player.time
        page.get_by_role("button", name="Forward 10 s", exact=True).click()
        until(lambda: viewer.player.time > before + 9.9, "ten seconds on")
        assert not viewer.controller.scene.imu.position.any()
        until(lambda: near(shoot(page, "attitude-only")[:, 340:940], palette.IMU) > 100, "the IMU's drone")


def test_a_log_with_two_vehicles(page: Page, tmp_path: Path) -> None:
    flown = fly(20.0, motion="circle", seed=1)
    streams = {"RAW_IMU": 50.0, "ATTITUDE": 20.0, "LOCAL_POSITION_NED": 10.0}
    for sysid in (1, 7):
        write_flight(SimulatedVehicle(flown, sysid=sysid, streams=streams, seed=sysid), tmp_path / f"{sysid}.tlog")
    both = tmp_path / "both.tlog"
    both.write_bytes(b"".join((tmp_path / f"{sysid}.tlog").read_bytes() for sysid in (1, 7)))
    flights = c.open_log(both)
    assert [f.vehicle.sysid for f in flights] == [1, 7]
    with viewing(page, *flights) as viewer:
        open_page(page, viewer.url)
        expect(page.get_by_text("vehicle 1:1, boot 1").first).to_be_visible()
        option = f"2: vehicle 7:1, boot 1, {flights[1].duration:.0f} s"
        choose(page, "Flight", option)
        expect(page.get_by_text(re.compile("vehicle 7:1, boot 1")).first).to_be_visible()
        viewer.post(partial(viewer.player.seek_share, 0.5))
        until(
            lambda: bool(np.linalg.norm(viewer.controller.scene.autopilot.position) > 0.1), "the other vehicle's place"
        )
        keep(page, "two-vehicles")


OVERLAPS = """() => {
    const all = [...document.querySelectorAll('button, label, td, input, .uplot')];
    const boxes = all.map(e => [e, e.getBoundingClientRect()])
        .filter(([e, r]) => r.width > 0 && r.height > 0 && e.checkVisibility());
    const cut = boxes.filter(([e, r]) => e.scrollWidth > e.clientWidth + 1 && e.clientWidth > 0 && e.tagName != 'INPUT'
        && getComputedStyle(e).display != 'inline').map(([e]) => e.innerText);
    const outside = boxes.filter(([e, r]) => r.left < -1 || r.right > innerWidth + 1).map(([e]) => e.innerText);
    return {cut, outside, wide: document.documentElement.scrollWidth};
}"""


def test_nothing_is_cut_off_on_a_laptop(page: Page) -> None:
    with viewing(page, DEMO) as viewer:
        open_page(page, viewer.url)
        expect(page.get_by_text("No IMU fault found").first).to_be_visible()
        fits = {"cut": [], "outside": [], "wide": 1280}
        until(lambda: page.evaluate(OVERLAPS) == fits, "nothing cut off")
        time.sleep(0.5)
        assert page.evaluate(OVERLAPS) == fits, "and so it stays"
        play, charts, legend = (
            page.get_by_role("button", name="Play", exact=True),
            page.locator(".uplot").first,
            page.get_by_text("Solid: RAW_IMU alone"),
        )
        boxes = [where.bounding_box() for where in (charts, play, legend)]
        edges = [(box["x"], box["x"] + box["width"]) for box in boxes if box]
        assert len(edges) == 3
        assert edges[0][1] < edges[1][0] < edges[1][1] < edges[2][0]  # left, middle, right
        keep(page, "window-1280x800")
        tab(page, "Drift")
        expect(page.get_by_role("row", name=re.compile(r"^30 s"))).to_be_visible()
        until(lambda: page.evaluate(OVERLAPS)["cut"] == [], "nothing cut off in the tables")
        page.set_viewport_size({"width": 1024, "height": 768})
        narrow = {"cut": [], "outside": [], "wide": 1024}
        until(lambda: page.evaluate(OVERLAPS) == narrow, "nothing cut off in a narrow window")
        width = "() => Math.max(...[...document.querySelectorAll('canvas')].map(e => e.getBoundingClientRect().width))"
        until(lambda: page.evaluate(width) > 0.4 * 1024, "the panels leave room for the picture")
        page.set_viewport_size({"width": 1280, "height": 800})


def test_a_phone(browser: Browser) -> None:
    with new_page(browser, 390, 844, has_touch=True) as page, viewing(page, DEMO) as viewer:
        open_page(page, viewer.url)
        expect(page.get_by_text("No IMU fault found").first).to_be_visible()
        page.get_by_role("button", name="Play", exact=True).click()
        until(lambda: viewer.player.playing, "the play button")
        page.get_by_role("button", name="Pause", exact=True).click()
        viewer.post(partial(viewer.player.seek_share, 0.3))
        until(lambda: near(shoot(page, "window-390x844")[:330], palette.IMU) > 50, "the drone is above the sheet")
        fits = {"cut": [], "outside": [], "wide": 390}
        until(lambda: page.evaluate(OVERLAPS) == fits, "nothing cut off")
        page.get_by_text("companion", exact=True).click()  # fold the sheet away
        expect(page.get_by_text("s since the anchor").first).not_to_be_visible()
        keep(page, "phone-folded")
