"""Deprecated: what was here is in `companion.comparison` and `companion.verdict`, and goes with the next release."""

from __future__ import annotations

import warnings

from companion import comparison, model, verdict


def __getattr__(name: str) -> object:
    for room in (comparison, verdict, model):
        if not name.startswith("_") and hasattr(room, name):
            warnings.warn(f"companion.analysis.{name} is {room.__name__}.{name} now", DeprecationWarning, stacklevel=2)
            return getattr(room, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
