"""The arrows of the house: mavlink → telemetry → model ← strapdown ← estimation ← analysis ← cli: never back up."""

from __future__ import annotations

import ast
import importlib
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import companion

PACKAGE = Path(companion.__file__).parent
MODULES = sorted(p for p in PACKAGE.rglob("*.py") if "data" not in p.relative_to(PACKAGE).parts)

GROUND = {"model"}
MAY_IMPORT = {
    "model": set[str](),
    "toml_file": GROUND,
    "destination": GROUND,
    "settings": GROUND | {"toml_file"},
    "correction": GROUND | {"toml_file", "analysis"},
    "sensors": GROUND | {"toml_file", "settings", "analysis"},
    "mavlink": GROUND,
    "telemetry": GROUND | {"mavlink"},
    "strapdown": GROUND,
    "estimation": GROUND | {"strapdown"},
    "analysis": GROUND | {"strapdown", "estimation"},
    "recording": GROUND | {"mavlink", "telemetry"},
    "simulate": GROUND | {"mavlink", "strapdown"},
    "examination": GROUND | {"settings", "sensors", "correction", "analysis"},
    "documents": GROUND | {"recording", "estimation", "analysis", "examination"},
    "export": GROUND | {"strapdown", "estimation", "analysis"},
    "live": GROUND | {"mavlink", "telemetry", "analysis"},
    "memory": set[str](),
    "running_verdict": GROUND | {"memory", "settings", "mavlink", "analysis", "examination", "live"},
    "view": GROUND | {"strapdown", "estimation", "analysis"},
    "report": GROUND
    | {"settings", "recording", "strapdown", "estimation", "analysis", "examination", "documents", "view", "report"},
    "fleet": GROUND
    | {"destination", "settings", "sensors", "mavlink", "recording", "examination", "documents", "export", "report"},
    "cli": GROUND
    | {
        "destination",
        "settings",
        "sensors",
        "correction",
        "examination",
        "documents",
        "mavlink",
        "telemetry",
        "recording",
        "strapdown",
        "estimation",
        "analysis",
        "simulate",
        "live",
        "memory",
        "running_verdict",
        "view",
        "report",
        "export",
        "fleet",
        "cli",
    },
    "__main__": {"cli"},
    "__init__": {"api"},
    "plot": GROUND | {"estimation", "analysis", "view", "report"},
    "api": GROUND | {"settings", "recording", "strapdown", "estimation", "analysis", "examination", "export", "plot"},
}
"""Part of the house → the other parts that it may import."""

LIBRARIES = {
    "model": {"numpy"},
    "strapdown": {"numpy"},
    "estimation": {"numpy", "scipy", "pygeomag"},
    "analysis": {"numpy"},
    "settings": {"msgspec"},
    "mavlink": {"numpy", "pymavlink", "serial"},
    "simulate": {"numpy"},
    "telemetry": {"numpy", "pyulog"},
    "recording": {"numpy"},
    "sensors": {"msgspec"},
    "correction": {"msgspec", "numpy"},
    "examination": {"msgspec", "numpy"},
    "documents": {"msgspec", "numpy"},
    "running_verdict": {"msgspec"},
    "export": {"numpy", "msgspec", "pyarrow", "mcap"},
    "view": {"numpy", "viser", "rich", "msgspec", "websockets"},
    "report": {"numpy", "msgspec", "plotly"},
    "plot": {"numpy", "plotly"},
    "fleet": {"numpy", "msgspec", "dask", "distributed", "pyarrow"},
    "cli": {"numpy", "msgspec", "rich", "shtab"},
}
"""Part of the house → what it may import from outside, beside the standard library."""

PURE = {"__future__", "collections", "dataclasses", "enum", "functools", "itertools", "math", "re", "types", "typing"}
"""What the core may take from the standard library: nothing that reads, waits, prints or runs."""

IMPURE_CALLS = {"open", "print", "input", "exec", "eval", "__import__"}


def part_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports(path: Path) -> Iterator[str]:
    """Every module that a file imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_module_imports_only_what_its_part_may(path: Path) -> None:
    part = part_of(path)
    for name in imports(path):
        top, *rest = name.split(".")
        if top == "companion":
            other = rest[0]
            if part in ("__init__", other):
                continue
            assert other in MAY_IMPORT[part], f"{part} imports {name}, against the arrow"
            if (PACKAGE / other).is_dir() and rest[1:]:
                door = importlib.import_module(f"companion.{other}")
                assert rest[1:] in [[public] for public in door.__all__], (
                    f"{part} reaches into {name}: use the front door"
                )
        elif top not in sys.stdlib_module_names:
            assert top in LIBRARIES.get(part, set()), f"{part} imports {name}"


@pytest.mark.parametrize("part", ["model", "strapdown", "estimation", "analysis"])
def test_the_core_is_pure(part: str) -> None:
    for path in (p for p in MODULES if part_of(p) == part):
        standard = {name.split(".")[0] for name in imports(path)} & sys.stdlib_module_names
        assert standard <= PURE, f"{path} imports {standard - PURE}"
        calls = {
            node.func.id
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        }
        assert not calls & IMPURE_CALLS, f"{path} calls {calls & IMPURE_CALLS}"


@pytest.mark.parametrize("part", ["model", "strapdown", "estimation", "analysis"])
def test_a_part_of_the_core_can_be_the_first_that_is_imported(part: str) -> None:
    """The API at the top loads everything when it is first used: no import of a part may count as that."""
    import subprocess  # noqa: PLC0415

    assert subprocess.run([sys.executable, "-c", f"import companion.{part}"], check=False).returncode == 0


def test_every_part_of_the_house_is_known() -> None:
    assert {part_of(path) for path in MODULES} <= MAY_IMPORT.keys()


def test_the_core_starts_without_viser() -> None:
    """`companion info` has to answer at once, and a notebook that integrates needs no web server."""
    import subprocess  # noqa: PLC0415  (this test alone starts a process)

    slow = {"viser", "plotly", "scipy.signal", "pygeomag"}
    code = f"import companion.cli, sys; sys.exit(not {slow}.isdisjoint(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_modules_fit_in_a_head() -> None:
    long = {str(p.relative_to(PACKAGE)): n for p in MODULES if (n := len(p.read_text().splitlines())) > 350}
    assert not long
