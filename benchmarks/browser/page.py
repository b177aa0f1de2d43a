"""How soon the page of a log is there, and how soon it answers: `python benchmarks/browser/page.py [LOG...]`.

Without a log: the bundled flight, ten minutes and an hour at 100 Hz from the simulator. `companion view` runs as its
users run it; headless Chromium draws 1440 x 900 by software, as on a computer without a graphics card, which is most
of what is measured. Printed for each: seconds from the command to its address, from there to the first picture of the
flight and to the verdict; ms from a key to the first frame that shows what it asks for, median and worst.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, sync_playwright

from companion.simulate import SimulatedVehicle, fly, write_flight

DEMO = Path(__file__).resolve().parents[2] / "tlogs" / "copter-demo-100hz.tlog"
STREAMS = {"RAW_IMU": 100.0, "ATTITUDE": 50.0, "LOCAL_POSITION_NED": 20.0, "GPS_RAW_INT": 5.0}
CHROMIUM = os.environ.get("CHROMIUM", "/usr/bin/chromium-headless-shell")
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
KEYS = 15

# What is in a frame is read where it has just been drawn: the first with paths and drones, which alone have colours,
# and after a key the first that differs from the one before.
WATCH = """(() => {
    const draw = window.requestAnimationFrame.bind(window);
    const colour = (pixels, i) =>
        Math.max(pixels[i], pixels[i + 1], pixels[i + 2]) - Math.min(pixels[i], pixels[i + 1], pixels[i + 2]);
    let canvas = null, before = 0;
    window.changes = [];
    for (const name of ['drawArrays', 'drawElements', 'drawArraysInstanced', 'drawElementsInstanced']) {
        const own = WebGL2RenderingContext.prototype[name];
        WebGL2RenderingContext.prototype[name] = function (...how) { canvas = this; own.apply(this, how); };
    }
    window.requestAnimationFrame = then => draw(t => {
        canvas = null;
        then(t);
        if (!canvas || (window.seen && !window.pressed)) return;
        const [w, h] = [canvas.drawingBufferWidth, canvas.drawingBufferHeight];
        const pixels = new Uint8Array(4 * w * h);
        canvas.readPixels(0, 0, w, h, canvas.RGBA, canvas.UNSIGNED_BYTE, pixels);
        if (!window.seen) {
            let count = 0;
            for (let i = 0; i < pixels.length; i += 4) count += colour(pixels, i) > 30;
            if (count > 2000) window.seen = performance.now();
            return;
        }
        let sum = 0;
        for (const word of new Uint32Array(pixels.buffer)) sum = (Math.imul(sum, 31) + word) | 0;
        if (before && sum !== before) window.changes.push(performance.now() - window.pressed);
        before = sum;
    });
    window.addEventListener('keydown', () => { window.pressed = performance.now(); window.changes = []; }, true);
})()"""


def answers(page: Page) -> list[float]:
    """ms from a key that steps through the flight to the frame that it changes."""
    page.mouse.click(700, 400)
    took = []
    for _ in range(KEYS + 1):
        page.keyboard.press("ArrowRight")
        page.wait_for_timeout(1000.0)
        took += page.evaluate("() => window.changes.slice(0, 1)")
    return took[1:]  # before the first one there was no frame to compare with


def measured(page: Page, log: Path) -> str:
    """One line."""
    command = [sys.executable, "-m", "companion", "view", str(log), "--port", "0"]
    begun = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as served:
        assert served.stdout is not None
        address = re.search(r"http://\S+", served.stdout.readline())
        assert address, "no address"
        there = time.perf_counter()
        page.goto(address[0])
        drawn = page.wait_for_function("() => window.seen").json_value() / 1e3  # since the address was opened
        page.get_by_text(re.compile("No IMU fault found| wrong|Cannot tell|Too little")).first.wait_for()
        judged = time.perf_counter()
        keys = answers(page)
        served.send_signal(signal.SIGINT)
    return (
        f"{log.name}: address {there - begun:.1f} s, first picture {drawn:.1f} s later, verdict "
        f"{judged - there:.1f} s; key to picture {np.median(keys):.0f} ms, worst {max(keys):.0f} ({len(keys)} keys)"
    )


def simulated(folder: Path, minutes: int) -> Path:
    """A log of so many minutes at 100 Hz."""
    path = folder / f"{minutes}-minutes.tlog"
    write_flight(SimulatedVehicle(fly(60.0 * minutes), streams=STREAMS), path)
    return path


def main(logs: list[Path]) -> None:
    """Measure and print."""
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        logs = logs or [DEMO, *(simulated(Path(folder), minutes) for minutes in (10, 60))]
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        print(f"load before: {os.getloadavg()[0]:.2f}, {len(os.sched_getaffinity(0))} CPUs")
        for log in logs:
            page = browser.new_page(viewport={"width": 1440, "height": 900})
            page.add_init_script(WATCH)
            print(measured(page, log), flush=True)
            page.close()
        browser.close()


if __name__ == "__main__":
    main([Path(argument) for argument in sys.argv[1:]])
