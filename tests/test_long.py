"""The list of long tests."""

from __future__ import annotations

import re

from tests.conftest import LONG
from tests.recordings import ROOT


def test_every_one_exists() -> None:
    for name in LONG.read_text(encoding="utf-8").split():
        path, _, function = name.partition("::")
        assert re.search(rf"^def {function}\(", (ROOT / path).read_text(encoding="utf-8"), re.MULTILINE), name
