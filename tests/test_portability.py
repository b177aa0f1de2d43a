"""What Windows does not have is used behind a guard, and this list has every use of it."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import mypy
import pytest

from companion.cli import watch
from tests.test_architecture import MODULES, PACKAGE, nodes

STUBS = Path(mypy.__file__).parent / "typeshed" / "stdlib"
"""They say of every name of the standard library on which system it is there."""

GUARDED = {
    ("fleet/task.py", "resource"): "imported in a try: without it there is no limit",
    ("fleet/task.py", "resource.*"): "the same",
    ("logs/logfile.py", "mmap.MADV_DONTNEED"): "after hasattr(madvise)",
}
"""Module and name that Windows lacks → how it is guarded."""


def _stub(module: str) -> Path | None:
    places = (STUBS / f"{module.replace('.', '/')}{end}" for end in (".pyi", "/__init__.pyi"))
    return next((place for place in places if place.exists()), None)


def _names(body: list[ast.stmt], platform: str) -> Iterator[str]:
    """What a stub binds at its top level, on a system."""
    for node in body:
        match node:
            case ast.If(test=test, body=then, orelse=otherwise):
                holds = _holds(test, platform)
                yield from _names(then if holds else otherwise, platform)
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                yield name
            case ast.AnnAssign(target=ast.Name(id=name)):
                yield name
            case ast.Assign(targets=[ast.Name(id=name)]):
                yield name
            case ast.ImportFrom(names=names):
                yield from (alias.asname or alias.name for alias in names)


def _holds(test: ast.expr, platform: str) -> bool:
    """A stub's condition: of the system or of Python's version."""
    known = {"sys": SimpleNamespace(platform=platform, version_info=sys.version_info), "TYPE_CHECKING": True}
    return bool(eval(compile(ast.Expression(test), "stub", "eval"), known))


@cache
def lacking_on_windows(module: str) -> frozenset[str]:
    """Names of a module of the standard library that Linux has and Windows has not; "*" where that is all of them."""
    if (stub := _stub(module)) is None:
        return frozenset()
    text = stub.read_text(encoding="utf-8")
    if "sys.platform" not in text:
        return frozenset()
    body = ast.parse(text).body
    linux, windows = (set(_names(body, platform)) for platform in ("linux", "win32"))
    only = frozenset(linux - windows)
    heads = (node for node in body if isinstance(node, ast.Import | ast.ImportFrom))
    imported = {alias.asname or alias.name for node in heads for alias in node.names}
    return only | ({"*"} if only and windows <= imported else frozenset())


def uses(path: Path) -> Iterator[str]:
    """module or module.name, of all in a file that Windows lacks."""
    aliases: dict[str, str] = {}
    for node in nodes(path):
        if isinstance(node, ast.Import):
            aliases |= {alias.asname or alias.name: alias.name for alias in node.names}
            yield from (alias.name for alias in node.names if "*" in lacking_on_windows(alias.name))
        elif isinstance(node, ast.ImportFrom) and node.module and not node.module.startswith("companion"):
            lacking = lacking_on_windows(node.module)
            yield from (f"{node.module}.{alias.name}" for alias in node.names if alias.name in lacking)
    for node in nodes(path):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            module = aliases.get(node.value.id, "")
            if module and node.attr in (lacking := lacking_on_windows(module)):
                yield f"{module}.*" if "*" in lacking else f"{module}.{node.attr}"


def test_the_stubs_are_understood() -> None:
    assert {"fork", "getuid", "sched_getaffinity"} <= lacking_on_windows("os")
    assert not {"umask", "replace", "kill", "access"} & lacking_on_windows("os")
    assert {"SIGHUP", "pthread_kill"} <= lacking_on_windows("signal")
    assert "*" in lacking_on_windows("fcntl")
    assert "*" not in lacking_on_windows("os") | lacking_on_windows("socket")


def test_what_windows_lacks_is_used_behind_a_guard() -> None:
    used = {(str(path.relative_to(PACKAGE).as_posix()), use) for path in MODULES for use in uses(path)}
    assert used == GUARDED.keys(), "guard it (getattr, sys.platform, try), and write down how"


def test_a_command_of_on_change_has_its_backslashes_on_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows' own rules for a command line, not those of a POSIX shell, which would eat them."""
    text = r'"C:\Program Files\tool.exe" --log C:\logs'
    assert watch.command_of("--run", text) == [r"C:\Program Files\tool.exe", "--log", "C:logs"]
    monkeypatch.setattr(sys, "platform", "win32")
    assert watch.command_of("--run", text) == text
