"""The wheel holds what the installed program needs."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import companion
from tests.recordings import ROOT

pytestmark = pytest.mark.slow


def test_settings_and_demo_flight_are_found_from_a_wheel(tmp_path: Path) -> None:
    build = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(tmp_path)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    installed = tmp_path / "installed"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(installed)
    code = (
        "import companion, companion.cli, companion.app.settings as s, companion.installation as i;"
        "assert companion.__file__.startswith(r'" + str(installed) + "'), companion.__file__;"
        "assert s.load_settings(i.data_folder('config') / 'default.toml') == s.Settings();"
        "raise SystemExit(companion.cli.main(['info', 'demo']))"
    )
    environment = os.environ | {"PYTHONPATH": str(installed)}
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    assert str(installed) in run.stdout


def test_every_public_name_is_there() -> None:
    for name in dir(companion):
        assert getattr(companion, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = companion.nothing


@pytest.mark.parametrize("module", ["companion", "companion.__main__"])
def test_the_package_loads_nothing_before_it_is_used(module: str) -> None:
    code = f"import {module}, sys; sys.exit(any(m in sys.modules for m in ('numpy', 'pymavlink', 'companion.cli')))"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0


def test_ctrl_c_while_it_is_loading_is_no_traceback() -> None:
    """Held up in the middle of its imports, so that the signal meets it there on every machine."""
    code = (
        "import os, signal, sys, companion.__main__ as m\n"
        "class Slow:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name == 'numpy': os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Slow())\n"
        "sys.argv = ['companion', 'info', 'demo']\n"
        "sys.exit(m.main())\n"
    )
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr) == (130, "")


@pytest.mark.parametrize("part", ["strapdown", "analysis", "report"])
def test_a_part_can_be_imported_by_itself(part: str) -> None:
    """`companion` loads its API by need, which must not happen half-way through a part that the API needs."""
    run = subprocess.run(
        [sys.executable, "-c", f"import companion.{part}"], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
