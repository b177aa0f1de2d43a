"""Where the recordings are that tests read."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
BUNDLED = ROOT / "tlogs"
SHARED = ROOT.parent / "shared" / "tlogs"


def shared(name: str) -> Path:
    """A recording that is not part of the project. Without it the test is skipped, but in CI it fails."""
    path = SHARED / name
    if not path.exists():
        if os.environ.get("CI") == "true":
            pytest.fail(f"{path} is missing, and CI must not skip")
        pytest.skip(f"{path} is not on this machine")
    return path


def all_shared() -> list[Path]:
    """Every recording beside the project, none where there are none."""
    return sorted(p for p in SHARED.rglob("*") if p.suffix.lower() in {".tlog", ".bin", ".ulg"})
