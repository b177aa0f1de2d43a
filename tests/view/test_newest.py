"""Work that nobody waits for any more holds nobody up; see also test_choice."""

from __future__ import annotations

import subprocess
import sys
import time


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
