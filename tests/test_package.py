"""The wheel holds what the installed program needs."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

from tests.recordings import ROOT


def test_settings_and_demo_flight_are_found_from_a_wheel(tmp_path: Path) -> None:
    build = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(tmp_path)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    installed = tmp_path / "installed"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(installed)
    code = (
        "import companion, companion.cli, companion.settings as s;"
        "assert companion.__file__.startswith(r'" + str(installed) + "'), companion.__file__;"
        "assert s.load_settings(s.data_folder('config') / 'default.toml') == s.Settings();"
        "raise SystemExit(companion.cli.main(['info', 'demo']))"
    )
    environment = os.environ | {"PYTHONPATH": str(installed)}
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    assert str(installed) in run.stdout
