"""Work that nobody waits for any more holds nobody up; see also test_choice."""

from __future__ import annotations

import subprocess
import sys
import threading
import time

from companion.tracks import Flight
from companion.view import Footage, Insight, ReplayChoice, Viewer
from tests.view.circles import examine, recompute


def test_a_long_work_holds_up_neither_the_end_nor_the_process() -> None:
    program = """
import time
from companion.view.newest import Newest
worker = Newest("test", lambda order: time.sleep(order))
worker.request(60.0)
worker.request(61.0)
worker.close()
"""
    begin = time.monotonic()
    subprocess.run([sys.executable, "-c", program], check=True, timeout=30.0)
    assert time.monotonic() - begin < 20.0


def test_a_page_is_left_at_once_while_it_is_analysed(flight: Flight) -> None:
    analysed, over = threading.Event(), threading.Event()

    def endless(flight: Flight, choice: ReplayChoice, film: Footage) -> Insight:
        analysed.set()
        over.wait(30.0)
        return examine(flight, choice, film)

    viewer = Viewer([flight], recompute, endless, port=0)
    try:
        assert analysed.wait(10.0)
        begin = time.monotonic()
        viewer.close()
        assert time.monotonic() - begin < 5.0
    finally:
        over.set()
