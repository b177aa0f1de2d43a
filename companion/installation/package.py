"""The installation: settings and bundled flights, the libraries that companion needs, and those of its extras.

Which are installed, which are too old, and the command that adds an extra, by the tool that installed companion: pip,
pipx or uv.
"""

from __future__ import annotations

import json
import re
import shlex
import sys
import sysconfig
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal
from urllib.parse import urlsplit

from companion.model import InputError

if TYPE_CHECKING:
    from importlib.metadata import Distribution

DEMO = "demo"
"""The name of the bundled flight, in place of a path."""


def data_folder(name: Literal["config", "tlogs"]) -> Path:
    """The folder of settings or bundled flights. Raises InputError when the installation has neither."""
    package = Path(str(files("companion")))
    for folder in (package / "data" / name, package.parent / name):
        if folder.is_dir():
            return folder
    raise InputError(f"this installation has no {name}/ folder. Install companion again, or run it from a checkout.")


def log_path(name: str | Path) -> Path:
    """The path of a log: `demo` is the bundled flight, unless there is a file of that name."""
    if str(name) == DEMO and not Path(name).exists():
        return data_folder("tlogs") / "copter-demo-100hz.tlog"
    return Path(name)


EXTRAS = {
    "report": "charts in a notebook",
    "export": "companion export --format parquet, mcap, foxglove and rosbag2",
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
    installed = _installed(_NAME)
    return () if installed is None else tuple(_parsed(installed.requires or []))


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


def _installed(name: str) -> Distribution | None:
    from importlib.metadata import PackageNotFoundError, distribution  # noqa: PLC0415  (a tenth of what a command needs)

    try:
        return distribution(name)
    except PackageNotFoundError:
        return None


def _version(name: str) -> str | None:
    return None if (installed := _installed(name)) is None else installed.version


def _within(installed: str, bound: str) -> bool:
    sign, number = re.fullmatch(r"(>=|<)\s*([\d.]+)", bound.strip()).groups()  # type: ignore[union-attr]  # our own
    return (_numbers(installed) >= _numbers(number)) == (sign == ">=")


def _numbers(text: str) -> tuple[int, ...]:
    return tuple(map(int, re.match(r"[\d.]*\d", text)[0].split(".")))  # type: ignore[index]  # every version begins so


def missing(extra: str, purpose: str) -> InputError:
    """The error for a library of an extra that is not installed, with the command that installs it.

    purpose: what needs which library, as a sentence without its full stop.
    """
    return InputError(f"{purpose}. Install it: {install_command(extra)}")


def install_command(extra: str) -> str:
    """As it is typed in the working folder.

    pipx and uv mark the environments that they make for a program; INSTALLER names the tool in any other.
    """
    installed = _installed(_NAME)
    if installed is None:  # a checkout on PYTHONPATH
        return f"{_pip()} install {_quoted(f'{_NAME}[{extra}]')}"
    environment = Path(sys.prefix)
    if (environment / "pipx_metadata.json").is_file():
        return f"pipx inject {_quoted(environment.name)} {' '.join(map(_quoted, _libraries(installed, extra)))}"
    if (receipt := environment / "uv-receipt.toml").is_file():
        return f"uv tool install {_requirement(installed, {extra} | _extras_of_tool(receipt))}"
    by_uv = (installed.read_text("INSTALLER") or "").strip() == "uv"
    tool = f"uv pip install --python {_quoted(_shown(environment))}" if by_uv else f"{_pip()} install"
    return f"{tool} {_requirement(installed, {extra})}"


def _requirement(installed: Distribution, extras: set[str]) -> str:
    """companion with extras, from where it came: the index, a checkout, a repository or an archive."""
    from urllib.request import url2pathname  # noqa: PLC0415  (with all of http)

    names = f"[{','.join(sorted(extras))}]"
    origin: dict[str, Any] = json.loads(installed.read_text("direct_url.json") or "{}")
    url = str(origin.get("url", ""))
    folder = Path(url2pathname(urlsplit(url).path))
    if "dir_info" in origin and folder.is_dir():
        editable = "-e " if origin["dir_info"].get("editable") else ""
        return editable + _quoted(f"{'.' if folder == Path.cwd() else folder}{names}")
    if (vcs := origin.get("vcs_info")) is not None:
        revision = f"@{vcs['requested_revision']}" if "requested_revision" in vcs else ""
        return _quoted(f"{_NAME}{names} @ {vcs['vcs']}+{url}{revision}")
    if "archive_info" in origin and (not url.startswith("file:") or folder.is_file()):
        return _quoted(f"{_NAME}{names} @ {url}")
    return _quoted(_NAME + names)


def _libraries(installed: Distribution, extra: str) -> list[str]:
    """What an extra adds, without markers: `pipx inject` keeps what is there already."""
    parts = [requirement.partition(";") for requirement in installed.requires or []]
    return [library.strip() for library, _, marker in parts if f"extra == '{extra}'" in marker.replace('"', "'")]


def _extras_of_tool(receipt: Path) -> set[str]:
    """Those that a uv tool has: installing it again with another would take them away."""
    requirements = tomllib.loads(receipt.read_text(encoding="utf-8"))["tool"]["requirements"]
    return {extra for one in requirements if one["name"] == _NAME for extra in one.get("extras", [])}


def _pip() -> str:
    """The pip of this environment."""
    pip = Path(sysconfig.get_path("scripts"), "pip.exe" if sys.platform == "win32" else "pip")
    return _quoted(_shown(pip)) if pip.is_file() else f"{_quoted(sys.executable)} -m pip"


def _shown(path: Path) -> str:
    """Relative to the working folder where it lies in it."""
    here = Path.cwd()
    return str(path.relative_to(here)) if path.is_relative_to(here) else str(path)


def _quoted(text: str) -> str:
    return f'"{text}"' if sys.platform == "win32" else shlex.quote(text)


def own_version() -> str:
    """As it was installed; "unknown" where the package's own description is gone."""
    return _version(_NAME) or "unknown"
