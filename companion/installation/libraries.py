"""The libraries that companion needs and those of its extras: which are installed, and which are too old."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass

EXTRAS = {
    "report": "charts in a notebook",
    "export": "companion export --format parquet, mcap and rosbag2",
    "zstd": "logs packed with Zstandard",
    "fleet": "companion fleet",
    "mcp": "companion mcp: assistants that ask about logs",
    "watch": "companion watch-folder",
}
"""Extra → what it is for, in the order in which they are listed. `all` has all of them."""

_REQUIREMENT = re.compile(r"(?P<name>[\w.-]+)(?:\[[^]]*\])?\s*(?P<bounds>[^;]*?)\s*(?:;\s*(?P<marker>.*))?")
_NAME = "mavlink-companion"


@dataclass(frozen=True, slots=True)
class Library:
    """One that companion or an extra of it needs."""

    name: str
    bounds: str  # as in >=1.1,<1.2
    extra: str  # "" for what every command needs
    installed: str | None  # version

    @property
    def fits(self) -> bool:
        """Whether it is there, in a version that is within the bounds."""
        return self.installed is not None and all(_within(self.installed, one) for one in self.bounds.split(",") if one)


def libraries() -> tuple[Library, ...]:
    """Those that the installed package names; none where companion runs from a checkout on PYTHONPATH alone."""
    from importlib.metadata import PackageNotFoundError, distribution  # noqa: PLC0415  (0.1 s, in this case alone)

    try:
        requires = distribution(_NAME).requires or []
    except PackageNotFoundError:
        return ()
    return tuple(_parsed(requires))


def _parsed(requires: list[str]) -> Iterator[Library]:
    """In our own requirements extras and bounds of Python's version are the only markers, >= and < the only bounds."""
    for text in requires:
        match = _REQUIREMENT.fullmatch(text)
        assert match is not None, text
        marker = (match["marker"] or "").replace('"', "'")
        extra = re.search(r"extra == '([\w-]+)'", marker)
        python = re.search(r"python_version < '([\d.]+)'", marker)
        if python and not _within(f"{sys.version_info.major}.{sys.version_info.minor}", f"<{python[1]}"):
            continue
        if match["name"] != _NAME and (extra is None or extra[1] in EXTRAS):
            yield Library(match["name"], match["bounds"], extra[1] if extra else "", _version(match["name"]))


def _version(name: str) -> str | None:
    from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415

    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _within(installed: str, bound: str) -> bool:
    sign, number = re.fullmatch(r"(>=|<)\s*([\d.]+)", bound.strip()).groups()  # type: ignore[union-attr]  # our own
    return (_numbers(installed) >= _numbers(number)) == (sign == ">=")


def _numbers(text: str) -> tuple[int, ...]:
    return tuple(map(int, re.match(r"[\d.]*\d", text)[0].split(".")))  # type: ignore[index]  # every version begins so
