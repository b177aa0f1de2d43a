"""The list of long tests."""

from __future__ import annotations

import re

from tests.conftest import LONG
from tests.recordings import ROOT


def test_every_one_exists() -> None:
    for name in LONG.read_text(encoding="utf-8").splitlines():
        path, _, function = name.partition("[")[0].partition("::")
        source = (ROOT / path).read_text(encoding="utf-8")
        assert not function or re.search(rf"^def {function}\(", source, re.MULTILINE), name
