"""Hand-set numbers of the estimate and the verdict stand in the tables of `companion/constants`, and nowhere else."""

from __future__ import annotations

import ast
import importlib
from collections.abc import Iterator
from pathlib import Path

import pytest

import companion
from tests.test_architecture import nodes

PACKAGE = Path(companion.__file__).parent
TABLES = sorted(p for p in (PACKAGE / "constants").glob("*.py") if p.stem != "__init__")
USERS = sorted(p for part in ("noise", "estimation", "comparison", "verdict") for p in (PACKAGE / part).rglob("*.py"))

OWN_TABLES = {
    "estimation/hypotheses.py: HYPOTHESES",  # what may be wrong: priors of size and rate, harmful sizes, words
    "estimation/aiding_sensors.py: _ROWS",  # all that is known of each aiding sensor
    "estimation/model.py: _PRIORS",  # constants of a flight, their components and priors
    "comparison/imu_spec.py: GENERIC",  # an IMU part, as the files of config/imu
    "verdict/fault_interval.py: BIAS_UNITS",  # how a bias is printed
    "verdict/findings/axes.py: _THOUSAND",  # factors between units, and their words
    "verdict/findings/detect.py: _MOTORS",  # numbers of SERVOn_FUNCTION
}
"""Tables of rows that have more than a number, where their reader looks for them."""

PLACES = {"slice", "range", "np.eye"}
"""Calls whose numbers are places in a vector, or its length."""


def hand_set(node: ast.AST) -> Iterator[ast.Constant]:
    """The numbers in an expression, but for 0, ±1 and 2 and the places in vectors."""
    if isinstance(node, ast.Constant) and type(node.value) in (int, float) and node.value not in (0, 1, 2):
        yield node
    elif isinstance(node, ast.Call) and ast.unparse(node.func) in PLACES:
        return
    for child in ast.iter_child_nodes(node):
        if not isinstance(node, ast.Subscript) or child is node.value:
            yield from hand_set(child)


def is_number(node: ast.expr) -> bool:
    """Whether an expression is a number itself, or a row of such: 0, 1 and 2 count then."""
    match node:
        case ast.Tuple(elts=values) | ast.List(elts=values) | ast.Dict(values=values):
            pass
        case _:
            values = [node]
    bare = (one.operand if isinstance(one, ast.UnaryOp) else one for one in values)
    return any(isinstance(one, ast.Constant) and type(one.value) in (int, float) for one in bare)


def assigned(source: str) -> Iterator[tuple[str, ast.expr]]:
    """Names and values of the assignments of a module."""
    for node in ast.parse(source).body:
        if isinstance(node, ast.AnnAssign) and node.value is not None:
            yield ast.unparse(node.target), node.value
        elif isinstance(node, ast.Assign):
            yield ", ".join(map(ast.unparse, node.targets)), node.value


def hand_set_names(source: str) -> list[str]:
    return [name for name, value in assigned(source) if is_number(value) or any(hand_set(value))]


def test_numbers_stand_in_the_tables() -> None:
    astray = {
        f"{path.relative_to(PACKAGE).as_posix()}: {name}"
        for path in USERS
        for name in hand_set_names(path.read_text(encoding="utf-8"))
    }
    assert astray - OWN_TABLES == set(), "to companion/constants"
    assert OWN_TABLES - astray == set(), "tables that are no more"


@pytest.mark.parametrize(
    "source",
    ["A = 0.3", "A = 1.0", "A: int = -5", "A = 1, 7", 'A = {"x": 2.0}', "A = np.radians(2.0) * 3", "A = 2.0**-22"],
)
def test_a_number_is_recognised(source: str) -> None:
    assert hand_set_names(source) == ["A"]


@pytest.mark.parametrize(
    "source",
    ["A = slice(3, 6)", "A = B[5]", "A = 2.0 * B**2", 'A = {"x": slice(0, 3)}', "A = b.c(0)", 'A = "x", "y"'],
)
def test_what_is_derived_is_no_number(source: str) -> None:
    assert hand_set_names(source) == []


@pytest.mark.parametrize("path", TABLES, ids=lambda p: p.stem)
def test_every_row_is_used(path: Path) -> None:
    rows = {name for name, _ in assigned(path.read_text(encoding="utf-8"))}
    table = f"companion.constants.{path.stem}"
    assert all(hasattr(importlib.import_module(table), row) for row in rows)
    used = set[str]()
    for user in (*USERS, path):
        for node in nodes(user):
            match node:
                case ast.Attribute(value=ast.Name(id=path.stem), attr=name):
                    used.add(name)
                case ast.Name(id=name, ctx=ast.Load()) if user == path:
                    used.add(name)
                case ast.ImportFrom(module=module, names=names) if module == table:
                    used |= {alias.name for alias in names}
    assert rows - used == set()


def test_a_name_stands_for_one_number() -> None:
    """In one table: what is healthy and what is harmful of one quantity may have one name."""
    for path in TABLES:
        names = [name for name, _ in assigned(path.read_text(encoding="utf-8"))]
        assert len(names) == len(set(names))
