"""What the live page costs: `python benchmarks/live/figures.py [MINUTES [IMU_HZ]]`.

A simulated vehicle sends RAW_IMU, 100 Hz of ATTITUDE and 50 of LOCAL_POSITION_NED from a process of its own;
`companion view` runs as its users run it, with one page open in headless Chromium. Printed: samples lost, resident
memory after the first minute and at the end, CPU of the companion and of the verdict's processes, and how old a pose
is when it is written to viser, from the moment at which the simulator sent the packet or could have.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from playwright.sync_api import sync_playwright

import companion as c
from companion.links import open_port, parse_address
from companion.simulate import SimulatedVehicle, fly, serve

RATES_HZ = {"ATTITUDE": 100.0, "LOCAL_POSITION_NED": 50.0}
LINK, PAGE = 14_771, 8_771
POSES = "poses.f64"  # time of the flight and of the machine's steady clock, s, of each
CHROMIUM = os.environ.get("CHROMIUM", "/usr/bin/chromium-headless-shell")
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
EVERY_S = 10.0


def vehicle(seconds: float, imu_hz: float, begun: Any) -> None:
    """The simulator's process. begun: s of the machine's steady clock, when the vehicle booted."""
    flying = SimulatedVehicle(fly(seconds), streams={"RAW_IMU": imu_hz, **RATES_HZ})
    port = open_port(parse_address(f"udpout:127.0.0.1:{LINK}"))
    begun.value = time.monotonic()
    serve(flying, port)


def page(folder: str) -> None:
    """The companion's process: the command, with a note of every pose that is written."""
    from companion.cli import main  # noqa: PLC0415  (only here)
    from companion.view.scene.scene import Scene  # noqa: PLC0415

    show, latest = Scene.show, -1.0
    words = ["view", f"udpin:127.0.0.1:{LINK}", "--listen-only", "--port", str(PAGE), "-o", f"{folder}/live.tlog"]
    with Path(folder, POSES).open("wb") as notes:  # kept here they would look like memory of the companion's

        def noted(self: Scene, sample: Any, *more: Any) -> None:
            nonlocal latest
            show(self, sample, *more)
            if latest != sample.t:
                latest = sample.t
                notes.write(np.array([sample.t, time.monotonic()]).tobytes())

        Scene.show = noted  # type: ignore[method-assign]
        code = main(words)
    sys.exit(code)


def beside(process: psutil.Process) -> float:
    """CPU time of its processes so far, s: the one that judges."""
    times = [child.cpu_times() for child in process.children(recursive=True)]
    return float(sum(one.user + one.system for one in times))


def run(minutes: float, imu_hz: float, folder: str) -> None:
    """Measure and print."""
    begun = multiprocessing.get_context("spawn").Value("d", 0.0)
    simulator = multiprocessing.get_context("spawn").Process(target=vehicle, args=(60 * minutes + 60, imu_hz, begun))
    command = [sys.executable, __file__, "page", folder]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as served, sync_playwright() as playwright:
        assert served.stdout is not None
        print(served.stdout.readline().strip(), flush=True)
        simulator.start()
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        tab = browser.new_page(viewport={"width": 1280, "height": 800})
        tab.goto(f"http://127.0.0.1:{PAGE}")
        tab.get_by_text("LIVE", exact=True).wait_for(timeout=60_000)
        process = psutil.Process(served.pid)
        resident, cpu, verdicts, begin = [], [process.cpu_times()], [beside(process)], time.monotonic()
        while time.monotonic() - begin < 60 * minutes:
            tab.wait_for_timeout(1000 * EVERY_S)
            resident.append(process.memory_info().rss / 1e6)
            cpu.append(process.cpu_times())
            verdicts.append(beside(process))
        elapsed = time.monotonic() - begin
        browser.close()
        served.send_signal(signal.SIGINT)
        print(served.stdout.read().strip())
    simulator.terminate()
    (flight,) = c.open_log(f"{folder}/live.tlog")
    imu = flight.imu("RAW_IMU")
    sent = round((imu.t[-1] - imu.t[0]) * imu_hz) + 1
    own = cpu[-1].user + cpu[-1].system - cpu[0].user - cpu[0].system
    minute = int(60 / EVERY_S) - 1
    t, at = np.fromfile(f"{folder}/{POSES}").reshape(-1, 2).T
    late = 1e3 * (at - begun.value - t)[len(t) // 20 :]
    print(f"{elapsed:.0f} s: {sent - len(imu)} of {sent} RAW_IMU samples lost, {flight.duration:.0f} s recorded")
    print(f"companion {own / elapsed:.1%} of a core, verdicts beside it {(verdicts[-1] - verdicts[0]) / elapsed:.1%}")
    tens = ", ".join(f"{one:.1f}" for one in resident[minute :: 10 * (minute + 1)])
    print(f"resident, MB: every ten minutes {tens}, {resident[-1]:.1f} at the end, {max(resident):.1f} most")
    print(f"pose latency {np.median(late):.0f} ms median, {np.percentile(late, 95):.0f} ms p95 ({len(late)} poses)")


if __name__ == "__main__":
    if sys.argv[1:2] == ["page"]:
        page(sys.argv[2])
    parser = argparse.ArgumentParser(description="what the live page costs")
    parser.add_argument("minutes", nargs="?", type=float, default=10.0)
    parser.add_argument("imu_hz", nargs="?", type=float, default=400.0)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        run(asked.minutes, asked.imu_hz, str(Path(scratch)))
