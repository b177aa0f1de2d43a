"""Numbers in sentences."""

from __future__ import annotations


def counted(count: int, noun: str) -> str:
    """1 window, 2 windows, 1,024 switches, 3 fixes."""
    plural = "" if count == 1 else "es" if noun.endswith(("ch", "x")) else "s"
    return f"{count:,} {noun}{plural}"
