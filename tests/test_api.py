"""The public API as docs/api.md and the docstrings show it: every example is run, every name is described."""

from __future__ import annotations

import doctest
import importlib
import pkgutil
import re
import runpy
from pathlib import Path

import pytest

import companion
import companion as c
from tests.recordings import BUNDLED, ROOT

pytestmark = pytest.mark.slow

PAGE = ROOT / "docs" / "api.md"
OPTIONS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


def with_examples() -> list[str]:
    """Modules that have an example in a docstring, told without importing them all."""
    names = [companion.__name__]
    for module in pkgutil.walk_packages(companion.__path__, "companion."):
        path = Path(*companion.__path__) / Path(*module.name.split(".")[1:])
        source = path / "__init__.py" if module.ispkg else path.with_suffix(".py")
        if ">>> " in source.read_text(encoding="utf-8"):
            names.append(module.name)
    return names


MODULES = with_examples()


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_of_the_docstrings(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    found = doctest.testmod(importlib.import_module(name), optionflags=OPTIONS)
    assert found.attempted
    assert not found.failed


def test_the_ways_in_have_an_example() -> None:
    for name in ("open_log", "drift", "replay", "dead_reckon", "examine", "ape"):
        assert ">>> " in (getattr(companion, name).__doc__ or ""), name
    assert len(MODULES) >= 6


def test_the_page_is_true(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Every line of it that begins with >>> gives what stands below it."""
    (tmp_path / "tlogs").symlink_to(ROOT / "tlogs")
    monkeypatch.chdir(tmp_path)
    examples = "\n".join(re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL))
    test = doctest.DocTestParser().get_doctest(examples, {}, "docs/api.md", str(PAGE), 0)
    assert len(test.examples) > 15
    said: list[str] = []
    found = doctest.DocTestRunner(optionflags=OPTIONS).run(test, out=said.append)
    assert not found.failed, "".join(said)


def test_every_public_name_is_on_the_page() -> None:
    text = PAGE.read_text(encoding="utf-8")
    missing = [name for name in companion.__all__ if not re.search(rf"`(c\.)?{name}\b", text)]
    assert not missing
    described = set(re.findall(r"`c\.(\w+)", text))
    assert described <= set(companion.__all__), "the page names what there is not"


def test_every_public_name_has_a_docstring() -> None:
    assert all(getattr(companion, name).__doc__ for name in companion.__all__)


def test_the_tutorial_prints_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "tlogs").symlink_to(ROOT / "tlogs")
    monkeypatch.chdir(tmp_path)
    script = ROOT / "docs" / "tutorial.py"
    runpy.run_path(str(script), run_name="__main__")
    promised = re.findall(r"^# > (.*)$", script.read_text(encoding="utf-8"), re.MULTILINE)
    assert capsys.readouterr().out.splitlines() == promised
    assert len(list(tmp_path.glob("*.parquet"))) == 2


def test_every_object_shows_itself_in_five_lines() -> None:
    """A notebook shows what a cell ends in: not a hundred thousand characters of numbers."""
    flight = c.open_log(BUNDLED / "copter-demo-100hz.tlog")[0]
    examined = c.examine(flight)
    drift = examined.assessment.drift
    objects: list[object] = [flight, *flight.imus.values(), flight.attitude, flight.position, *flight.series.values()]
    objects += [examined, examined.assessment, examined.assessment.calibration, examined.assessment.best, drift]
    objects += [*drift.rows, drift.rows[0].errors, c.replay(flight), examined.assessment.comparison]
    for shown in map(repr, objects):
        lines = shown.splitlines()
        assert len(lines) <= 5, shown
        assert max(map(len, lines)) <= 160, shown
    assert "5 s: 0.16" in repr(drift)
    assert "RAW_IMU" in repr(flight)
