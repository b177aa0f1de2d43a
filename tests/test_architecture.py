"""The house, whose arrows never turn back.

mavlink → logs → telemetry → model ← strapdown, noise ← estimation ← comparison ← verdict ← app ← pages ← cli
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import companion

PACKAGE = Path(companion.__file__).parent
MODULES = sorted(p for p in PACKAGE.rglob("*.py") if "data" not in p.relative_to(PACKAGE).parts)

GROUND = {"model"}
CORE = ("strapdown", "noise", "estimation", "comparison", "verdict")
CONSTANTS = {f"constants.{table}" for table in ("healthy", "harm", "priors", "num", "check")}
MAY_IMPORT = {
    "model": set[str](),
    "installation": GROUND,
    "mavlink": GROUND,
    "logs": GROUND | {"installation", "mavlink"},
    "links": GROUND | {"mavlink", "logs"},
    "telemetry": GROUND | {"mavlink", "logs"},
    "strapdown": GROUND,
    "constants": set[str](),
    **dict.fromkeys(CONSTANTS, GROUND),
    "noise": GROUND | CONSTANTS,
    "estimation": GROUND | CONSTANTS | {"strapdown", "noise"},
    "comparison": GROUND | CONSTANTS | {"strapdown", "noise", "estimation"},
    "verdict": GROUND | CONSTANTS | {"strapdown", "noise", "estimation", "comparison"},
    "analysis": {"model", "estimation", "comparison", "verdict"},
    "simulate": GROUND | {"mavlink", "links", "strapdown"},
    "app": set[str](),
    "app.files": GROUND,
    "app.settings": GROUND | {"strapdown", "comparison", "verdict", "app.files"},
    "app.correction": GROUND | {"app.files", "comparison", "verdict"},
    "app.sensors": GROUND | {"installation", "telemetry", "app.files", "comparison", "verdict"},
    "app.recording": GROUND | {"installation", "mavlink", "logs", "telemetry"},
    "app.examination": GROUND
    | {"constants.num", "app.settings", "app.sensors", "app.correction", "estimation", "comparison", "verdict"},
    "app.live": GROUND | {"constants.check", "mavlink", "links", "telemetry", "comparison", "verdict"},
    "app.running_verdict": GROUND
    | {"constants.num", "mavlink", "estimation", "comparison", "verdict"}
    | {"app.settings", "app.examination", "app.live"},
    "present": GROUND | {"strapdown", "noise", "estimation", "comparison", "verdict"},
    "documents": GROUND | {"noise", "estimation", "comparison", "verdict", "app.recording", "app.examination"},
    "export": GROUND | {"installation", "strapdown", "estimation", "comparison", "verdict", "present"},
    "view": GROUND | {"strapdown", "noise", "estimation", "comparison", "verdict", "present"},
    "report": GROUND
    | {
        "installation",
        "strapdown",
        "noise",
        "estimation",
        "comparison",
        "verdict",
        "app.settings",
        "app.recording",
        "app.examination",
    }
    | {"app.sensors"}
    | {"documents", "present", "view"},
    "pages": set[str](),
    "pages.replay": GROUND
    | {
        "comparison",
        "verdict",
        "app.settings",
        "app.correction",
        "app.recording",
        "app.examination",
        "report",
        "view",
    }
    | {"app.sensors"},
    "pages.live": GROUND
    | {"links", "comparison", "verdict", "app.settings", "app.sensors", "app.live", "app.running_verdict", "view"},
    "pages.notebook": GROUND
    | {"app.settings", "app.sensors", "app.recording", "app.examination", "pages.replay", "view"},
    "mavproxy": GROUND | {"mavlink", "comparison", "verdict", "app.settings", "app.running_verdict"},
    "fleet": GROUND
    | {
        "installation",
        "mavlink",
        "logs",
        "telemetry",
        "comparison",
        "verdict",
        "app.files",
        "app.settings",
        "app.sensors",
    }
    | {"app.recording", "app.examination", "documents", "present", "export", "report"},
    "cli": GROUND
    | {
        "installation",
        "mavlink",
        "logs",
        "links",
        "telemetry",
        "strapdown",
        "noise",
        "estimation",
        "comparison",
        "verdict",
        "simulate",
    }
    | {"app.files", "app.settings", "app.sensors", "app.correction", "app.recording", "app.examination"}
    | {"app.live", "app.running_verdict", "pages.replay", "pages.live"}
    | {"documents", "present", "view", "report", "export", "fleet"},
    "__main__": {"cli"},
    "__init__": {"api", "mavproxy"},
    "api": GROUND
    | {"strapdown", "estimation", "comparison", "verdict", "app.settings"}
    | {"app.recording", "app.examination", "pages.notebook"}
    | {"export", "report"},
}
"""Part of the house → the other parts that it may import.

A part is a package, or one module of a package whose modules are doors of their own (`ROOMS_OF_ROOMS`).
"""

ROOMS_OF_ROOMS = {"app", "constants", "pages"}

VIEW_MAY_IMPORT = {
    "state": set[str](),
    "server": set[str](),
    "panels": {"state"},
    "scene": {"state"},
    "export": {"state", "scene", "server"},
    "ground_map": {"state", "scene"},
    "controller": {"state", "panels", "scene"},
    "replay_controller": {"state", "scene", "panels", "controller", "export", "ground_map"},
    "live_controller": {"state", "scene", "panels", "controller"},
    "page": {"state", "scene", "server", "panels", "controller", "replay_controller", "live_controller"},
    "__init__": {"state", "panels", "page", "export", "ground_map"},
}
"""Room of the view, or a module that joins rooms → the others that it may import."""

LIBRARIES = {
    "model": {"numpy"},
    "strapdown": {"numpy"},
    "estimation": {"numpy", "pygeomag"},
    "noise": {"numpy"},
    "comparison": {"numpy"},
    "verdict": {"numpy"},
    "mavlink": {"numpy", "pymavlink"},
    "logs": {"numpy"},
    "links": {"numpy", "serial"},
    "simulate": {"numpy"},
    "telemetry": {"numpy"},
    "app.settings": {"msgspec"},
    "app.recording": {"numpy"},
    "app.sensors": {"msgspec"},
    "app.correction": {"msgspec", "numpy"},
    "app.examination": {"msgspec", "numpy", "threadpoolctl"},
    "app.running_verdict": {"msgspec"},
    "pages.live": {"msgspec"},
    "documents": {"msgspec", "numpy"},
    "export": {"numpy", "msgspec", "pyarrow", "mcap"},
    "view": {"numpy", "viser", "rich", "msgspec", "websockets", "PIL"},
    "report": {"numpy", "msgspec", "plotly"},
    "fleet": {"numpy", "msgspec", "dask", "distributed", "pyarrow"},
    "mavproxy": {"MAVProxy"},
    "cli": {"numpy", "msgspec", "rich", "shtab", "mcp", "mcp_types", "anyio", "jsonschema", "watchfiles"},
}
"""Part of the house → what it may import from outside, beside the standard library."""

PURE = {
    "__future__", "collections", "contextlib", "dataclasses", "difflib", "enum", "functools", "itertools", "math", "re",
    "statistics", "types", "typing",
}  # fmt: skip
"""What the core may take from the standard library: nothing that reads, waits, prints or runs."""

IMPURE_CALLS = {"open", "print", "input", "exec", "eval", "__import__"}


def part_of(names: tuple[str, ...]) -> str:
    """The part of `companion.<names>`."""
    depth = 2 if names[0] in ROOMS_OF_ROOMS else 1
    return ".".join(names[:depth])


def part_at(path: Path) -> str:
    *folders, file = path.relative_to(PACKAGE).with_suffix("").parts
    return part_of((*folders, file) if file != "__init__" or not folders else tuple(folders))


@cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    """All that a module says, parsed once for all tests."""
    return tuple(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


@cache
def imports(path: Path) -> tuple[str, ...]:
    """Every module that a file imports, wherever in it."""
    names: list[str] = []
    for node in nodes(path):
        if isinstance(node, ast.Import):
            names += (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            names += (f"{node.module}.{alias.name}" for alias in node.names)
    return tuple(names)


@cache
def exported(door: Path) -> set[str]:
    """The names of a package: what its `__init__` imports or binds."""
    imported = (alias for node in nodes(door) if isinstance(node, ast.ImportFrom) for alias in node.names)
    bound = (node.target for node in nodes(door) if isinstance(node, ast.AnnAssign))
    return {one.asname or one.name for one in imported} | {one.id for one in bound if isinstance(one, ast.Name)}


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_module_imports_only_what_its_part_may(path: Path) -> None:
    part = part_at(path)
    for name in imports(path):
        top, *rest = name.split(".")
        if top == "companion":
            other = part_of(tuple(rest))
            if part in ("__init__", other):
                continue
            assert other in MAY_IMPORT[part], f"{part} imports {name}, against the arrow"
            inside = rest[len(other.split(".")) :]
            door = PACKAGE / other.replace(".", "/") / "__init__.py"
            if door.is_file() and inside:
                assert inside in [[public] for public in exported(door)], (
                    f"{part} reaches into {name}: use the front door"
                )
        elif top not in sys.stdlib_module_names:
            assert top in LIBRARIES.get(part, set()), f"{part} imports {name}"


@pytest.mark.parametrize("path", sorted((PACKAGE / "view").rglob("*.py")), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_module_of_the_view_imports_only_what_its_room_may(path: Path) -> None:
    room = path.relative_to(PACKAGE / "view").with_suffix("").parts[0]
    for name in imports(path):
        if name.startswith("companion.view."):
            other = name.split(".")[2]
            assert other in {room} | VIEW_MAY_IMPORT[room], f"{room} imports {name}, against the arrow"
        assert not (room == "state" and name.split(".")[0] == "viser"), "what is shown knows no browser"


@pytest.mark.parametrize("part", ["model", *sorted(CONSTANTS), *CORE])
def test_the_core_is_pure(part: str) -> None:
    for path in (p for p in MODULES if part_at(p) == part):
        standard = {name.split(".")[0] for name in imports(path)} & sys.stdlib_module_names
        assert standard <= PURE, f"{path} imports {standard - PURE}"
        calls = {node.func.id for node in nodes(path) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
        assert not calls & IMPURE_CALLS, f"{path} calls {calls & IMPURE_CALLS}"


@pytest.mark.parametrize("part", ["model", *CORE])
def test_a_part_of_the_core_can_be_the_first_that_is_imported(part: str) -> None:
    """The API at the top loads everything when it is first used: no import of a part may count as that."""
    import subprocess  # noqa: PLC0415

    assert subprocess.run([sys.executable, "-c", f"import companion.{part}"], check=False).returncode == 0


def test_every_part_of_the_house_is_known() -> None:
    assert {part_at(path) for path in MODULES} == MAY_IMPORT.keys()


def test_the_top_of_the_package_has_rooms_alone() -> None:
    assert {p.name for p in PACKAGE.iterdir() if p.is_file()} == {"__init__.py", "__main__.py", "api.py", "py.typed"}


@pytest.mark.parametrize("arrows", [MAY_IMPORT, VIEW_MAY_IMPORT], ids=["house", "view"])
def test_the_arrows_make_no_circle(arrows: dict[str, set[str]]) -> None:
    standing = dict(arrows)
    while ground := {part for part, below in standing.items() if below.isdisjoint(standing.keys() - {part})}:
        standing = {part: below for part, below in standing.items() if part not in ground}
    assert not standing


def test_sockets_and_serial_lines_are_of_the_links_alone() -> None:
    """But for the page's server, which looks for a free port; a fleet asks for the name of its computer."""
    users = {part_at(p) for p in MODULES if not {"socket", "serial"}.isdisjoint(n.split(".")[0] for n in imports(p))}
    assert users <= {"links", "view", "fleet"}


def test_the_core_starts_without_viser() -> None:
    """`companion info` has to answer at once, and a notebook that integrates or draws needs no web server."""
    import subprocess  # noqa: PLC0415  (this test alone starts a process)

    slow = {"viser", "plotly", "pygeomag"}
    code = f"import companion.cli, companion.report, sys; sys.exit(not {slow}.isdisjoint(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_module_holds_one_thought() -> None:
    """What it offers and what it needs fit in a head; packages that only gather names are none."""
    found = {}
    for path in MODULES:
        tree = ast.parse(path.read_text())
        offered = [
            node.name
            for node in tree.body
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_")
        ]
        needed = {node.module for node in nodes(path) if isinstance(node, ast.ImportFrom)}
        own = {name for name in needed if (name or "").startswith("companion")}
        if path.name != "__init__.py" and (len(offered) > 20 or len(own) > 25):
            found[str(path.relative_to(PACKAGE))] = len(offered), len(own)
    assert not found


def test_no_function_is_long() -> None:
    long = {
        f"{path.relative_to(PACKAGE)}: {node.name}": lines
        for path in MODULES
        for node in nodes(path)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and (lines := (node.end_lineno or 0) - node.lineno + 1) > 60
    }
    assert not long


def bound_names(path: Path) -> Iterator[tuple[int, str]]:
    """Line and name of what a module binds: variables, parameters, attributes, functions, classes, imports."""
    for node in nodes(path):
        match node:
            case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                yield node.lineno, name
            case ast.arg(arg=name) | ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                yield node.lineno, name
            case ast.ClassDef(name=name) | ast.MatchAs(name=str(name)) | ast.MatchStar(name=str(name)):
                yield node.lineno, name
            case ast.alias(asname=str(name)):
                yield node.lineno, name


def test_nothing_is_called_found() -> None:
    """Everything has been found somewhere: a name says what it is."""
    assert not [
        f"{path.relative_to(PACKAGE)}:{line}"
        for path in MODULES
        for line, name in bound_names(path)
        if name.lower().strip("_") == "found"
    ]
