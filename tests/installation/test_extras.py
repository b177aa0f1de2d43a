"""The command for a missing extra is that of the tool that installed companion, as it left its traces on the disk."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

from companion.installation import missing

HEAD = "Metadata-Version: 2.4\nName: mavlink-companion\nVersion: 0.1.0\n"
REQUIRES = (
    "Requires-Dist: numpy>=1.26\n"
    "Requires-Dist: plotly>=6; extra == 'report'\n"
    "Requires-Dist: zstandard>=0.22; (python_version < '3.14') and extra == 'zstd'\n"
)


@pytest.fixture
def environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """One without a pip of its own, which the working folder is not in."""
    prefix = tmp_path / "environment"
    scripts = prefix / ("Scripts" if sys.platform == "win32" else "bin")
    scripts.mkdir(parents=True)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    monkeypatch.setattr(sys, "prefix", str(prefix))
    monkeypatch.setattr(sys, "executable", str(scripts / "python"))
    monkeypatch.setattr("sysconfig.get_path", lambda _: str(scripts))
    monkeypatch.syspath_prepend(str(prefix))
    return prefix


def install(environment: Path, origin: Mapping[str, object] | None = None, installer: str = "pip") -> None:
    info = environment / "mavlink_companion-0.1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(HEAD + REQUIRES)
    (info / "INSTALLER").write_text(f"{installer}\n")
    if origin:
        (info / "direct_url.json").write_text(json.dumps(origin))


def command(extra: str = "report") -> str:
    said, _, line = str(missing(extra, "a chart needs a library")).partition(". Install it: ")
    assert said == "a chart needs a library"
    return line


def pip_of(environment: Path) -> Path:
    pip = Path(sys.executable).with_name("pip.exe" if sys.platform == "win32" else "pip")
    pip.touch()
    assert environment in pip.parents
    return pip


pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="quotes and separators are those of POSIX")


def test_pip_from_the_index(environment: Path) -> None:
    install(environment)
    assert command() == f"{environment}/bin/python -m pip install 'mavlink-companion[report]'"
    pip = pip_of(environment)
    assert command() == f"{pip} install 'mavlink-companion[report]'"


def test_a_checkout_that_make_has_set_up(environment: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    checkout = environment.parent
    install(environment, {"url": checkout.as_uri(), "dir_info": {"editable": True}})
    pip = pip_of(environment)
    assert command() == f"{pip} install -e '{checkout}[report]'"
    monkeypatch.chdir(checkout)
    assert command() == "environment/bin/pip install -e '.[report]'"


def test_a_folder_that_was_built_and_is_gone(environment: Path) -> None:
    install(environment, {"url": (environment.parent / "gone").as_uri(), "dir_info": {}})
    assert command().endswith(" install 'mavlink-companion[report]'")


@pytest.mark.parametrize(
    ("origin", "expected"),
    [
        (
            {"url": "https://example.org/c.git", "vcs_info": {"vcs": "git", "requested_revision": "v2"}},
            "git+https://example.org/c.git@v2",
        ),
        ({"url": "https://example.org/c.git", "vcs_info": {"vcs": "git"}}, "git+https://example.org/c.git"),
        ({"url": "https://example.org/c.whl", "archive_info": {}}, "https://example.org/c.whl"),
    ],
)
def test_what_came_from_an_address_comes_from_there_again(
    environment: Path, origin: dict[str, object], expected: str
) -> None:
    install(environment, origin)
    assert command().endswith(f" install 'mavlink-companion[report] @ {expected}'")


def test_pipx_adds_the_libraries_to_its_environment(environment: Path) -> None:
    install(environment)
    (environment / "pipx_metadata.json").write_text("{}")
    assert command() == "pipx inject environment 'plotly>=6'"
    assert command("zstd") == "pipx inject environment 'zstandard>=0.22'"


def test_a_uv_tool_keeps_the_extras_that_it_has(environment: Path) -> None:
    install(environment, installer="uv")
    (environment / "uv-receipt.toml").write_text(
        '[tool]\nrequirements = [{ name = "mavlink-companion", extras = ["zstd"] }, { name = "ipython" }]\n'
    )
    assert command() == "uv tool install 'mavlink-companion[report,zstd]'"


def test_uv_pip_into_an_environment(environment: Path) -> None:
    install(environment, installer="uv")
    assert command() == f"uv pip install --python {environment} 'mavlink-companion[report]'"
