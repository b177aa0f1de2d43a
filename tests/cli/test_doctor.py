"""`companion doctor` says what is missing, and what to type."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.cli import main
from companion.cli.doctor import of_libraries
from companion.installation import EXTRAS, Library


def test_here_nothing_is_broken_and_every_extra_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor"]) == 0
    out = capsys.readouterr().out
    assert "broken" not in out
    assert all(f" {extra}: " in out for extra in EXTRAS)


@pytest.mark.parametrize(
    ("bounds", "installed", "fits"),
    [
        (">=1.1,<1.2", "1.1.3", True),
        (">=1.1,<1.2", "1.2.0", False),
        (">=1.1,<1.2", "1.0.30", False),
        (">=2025.1", "2026.8.0", True),
        (">=1.26", "1.26.0rc1", True),
        (">=1.9", "1.10", True),
        ("", "7", True),
        ("", None, False),
    ],
)
def test_a_version_is_within_its_bounds(bounds: str, installed: str | None, fits: bool) -> None:
    assert Library("x", bounds, "", installed).fits == fits


def test_what_is_missing_of_an_extra_is_optional_and_of_the_core_broken() -> None:
    lacking = (Library("numpy", ">=1.26", "", "1.20"), Library("mcap", "", "export", None))
    states = {check.what.partition(":")[0].partition(".")[0]: check for check in of_libraries(lacking)}
    core, export = states["what every command needs"], states["export"]
    assert (core.state, export.state) == ("broken", "optional")
    assert "numpy>=1.26 (here: 1.20)" in core.what
    assert "[export]" in export.remedy
    assert all(states[extra].state == "ok" for extra in EXTRAS if extra != "export")


def test_a_settings_file_that_cannot_be_used_is_broken(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "mine.toml"
    config.write_text("[view]\nno_such_key = 1\n")
    assert main(["doctor", "--config", str(config)]) == 2
    assert "no_such_key" in capsys.readouterr().out


def test_a_dialect_that_there_is_not_is_broken(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "mine.toml"
    config.write_text('[log]\ndialect = "klingon"\n')
    for given in (["--dialect", "klingon"], ["--config", str(config)]):
        assert main(["doctor", *given]) == 2
        assert "klingon" in capsys.readouterr().out
