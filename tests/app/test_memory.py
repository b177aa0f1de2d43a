"""What was freed is given back."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from companion.app.memory import give_back


@pytest.mark.skipif(sys.platform != "linux", reason="other allocators give it back themselves")
def test_what_was_freed_is_no_longer_resident() -> None:
    def resident() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1]) * 4096

    many = [np.ones(2000) for _ in range(4000)]  # 16 kB each: too small for glibc to give them back one by one
    last = np.ones(2000)  # what is in use above them
    held = resident()
    many.clear()
    give_back()
    assert held - resident() > 40_000_000
    assert last.sum() == 2000.0
