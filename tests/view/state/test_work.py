"""Work that nobody waits for any more holds nobody up; see also test_choice."""

from __future__ import annotations

import subprocess
import sys
import threading

from companion.model import Flight
from companion.view import AnalysisResult, DisplayTrajectory, ReplayChoice, Viewer
from tests.view.circles import examine, recompute
from tests.waiting import LIMIT_S


def test_a_long_work_holds_up_neither_the_end_nor_the_process() -> None:
    program = """
import time
from companion.view.state.work import Worker
worker = Worker("test")
worker.request(lambda: time.sleep(600.0), print)
worker.request(lambda: time.sleep(601.0), print)
worker.close()
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=LIMIT_S)


def test_a_page_is_left_at_once_while_it_is_analysed(flight: Flight) -> None:
    analysed, over, done = threading.Event(), threading.Event(), threading.Event()

    def endless(flight: Flight, choice: ReplayChoice, display: DisplayTrajectory) -> AnalysisResult:
        analysed.set()
        over.wait(2 * LIMIT_S)
        done.set()
        return examine(flight, choice, display)

    viewer = Viewer([flight], recompute, endless, port=0)
    try:
        assert analysed.wait(LIMIT_S)
        viewer.close()
        assert not done.is_set()
    finally:
        over.set()
