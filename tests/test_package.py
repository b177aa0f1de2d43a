"""Wheel and sdist hold what the installed program needs, and the files of a release agree."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest
import yaml

import companion
from companion.installation import EXTRAS
from tests.recordings import ROOT
from tests.waiting import LIMIT_S

pytestmark = pytest.mark.slow


PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel that is made of the sdist, as an index's users who have no wheel make it."""
    folder = tmp_path_factory.mktemp("dist")

    def build(target: str, source: Path) -> None:
        command = [sys.executable, "-m", "hatchling", "build", "--target", target, "--directory", str(folder)]
        subprocess.run(command, cwd=source, check=True, capture_output=True, timeout=LIMIT_S)

    build("sdist", ROOT)
    (sdist,) = folder.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        archive.extractall(folder, filter="data")
    build("wheel", folder / sdist.name.removesuffix(".tar.gz"))
    (made,) = folder.glob("*.whl")
    return made


def test_settings_and_demo_flight_are_found_from_a_wheel(wheel: Path, tmp_path: Path) -> None:
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


def scripts_of(environment: Path) -> Path:
    return environment / ("Scripts" if sys.platform == "win32" else "bin")


def clean() -> dict[str, str]:
    """The variables of a process that knows nothing of this checkout."""
    return {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}


def test_pip_installs_it_with_every_extra_from_an_index(wheel: Path, tmp_path: Path) -> None:
    """Into an environment that has the libraries of this one, and takes companion from a folder that is an index."""
    simple = tmp_path / "simple" / "mavlink-companion"
    simple.mkdir(parents=True)
    shutil.copy(wheel, simple)
    (simple / "index.html").write_text(f'<a href="{wheel.name}">{wheel.name}</a>')
    venv.create(tmp_path / "env", with_pip=False)
    scripts = scripts_of(tmp_path / "env")
    python = scripts / Path(sys.executable).name
    site = subprocess.check_output([python, "-c", "import site; print(site.getsitepackages()[-1])"], text=True).strip()
    for folder in filter(Path.is_dir, map(Path, sys.path)):
        for lent in folder.iterdir() if folder.name == "site-packages" else ():
            # of an editable install companion/data is there, and pip would write the package through the link
            if not lent.name.startswith(("mavlink_companion", "companion", "_")) and lent.suffix != ".pth":
                with contextlib.suppress(FileExistsError):
                    Path(site, lent.name).symlink_to(lent)
    pip = [sys.executable, "-m", "pip", "--isolated", "--python", str(python), "install", "--no-compile"]
    index = ["--index-url", simple.parent.as_uri()]
    subprocess.run(
        [*pip, *index, "mavlink-companion[all]"],
        env=clean(), cwd=tmp_path, check=True, capture_output=True, timeout=LIMIT_S,
    )  # fmt: skip
    run = subprocess.run(
        [scripts / "companion", "doctor"], env=clean(), cwd=tmp_path, capture_output=True, text=True, timeout=LIMIT_S,
        check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout + run.stderr
    assert str(tmp_path / "env") in run.stdout.splitlines()[0]
    for extra in EXTRAS:
        assert re.search(rf"(ok|not here) +{extra}: ", run.stdout), run.stdout


def test_uvx_runs_it_in_a_clean_environment(wheel: Path, tmp_path: Path) -> None:
    """With the libraries of the real index, or of uv's cache."""
    if not (uv := shutil.which("uv", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")):
        pytest.skip("no uv here")
    words = ["tool", "run", "--isolated", "--from", str(wheel), "companion", "info", "demo"]
    run = subprocess.run([uv, *words], env=clean(), cwd=tmp_path, capture_output=True, text=True, check=False)
    if run.returncode and re.search(r"dns error|error sending request|Failed to fetch|network", run.stderr):
        pytest.skip("no package index can be reached from here")
    assert run.returncode == 0, run.stderr
    assert "copter-demo-100hz.tlog" in run.stdout


def test_every_extra_is_in_all_and_in_the_doctors_list() -> None:
    extras = PROJECT["optional-dependencies"].keys() - {"all", "bench", "dev"}
    (whole,) = PROJECT["optional-dependencies"]["all"]
    assert extras == EXTRAS.keys() == set(re.search(r"\[(.*)]", whole)[1].split(","))  # type: ignore[index]


def test_the_files_of_a_release_have_one_version() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    label = re.search(r'^LABEL version="(.*?)"', (ROOT / "Dockerfile").read_text(encoding="utf-8"), re.MULTILINE)
    assert label
    assert {PROJECT["version"], str(citation["version"]), label[1]} == {PROJECT["version"]}


@pytest.mark.parametrize("path", sorted((ROOT / ".github" / "workflows").glob("*.yml")), ids=lambda path: path.name)
def test_a_workflow_names_what_there_is(path: Path) -> None:
    """Every step uses an action of a stated version or runs something; every file and extra it names is there."""
    workflow = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert workflow["permissions"] == {"contents": "read"}, "no more than a job asks for"
    steps = [step for job in workflow["jobs"].values() for step in job["steps"]]
    for step in steps:
        assert ("uses" in step) != ("run" in step)
        assert re.fullmatch(r"\./|[\w-]+/[\w.-]+@[\w./]+", step.get("uses", "./"))
        for script in re.findall(r"bash (\S+)", step.get("run", "")):
            assert (ROOT / script).exists()
        for extra in re.findall(r'"\.\[(\w+)]"', step.get("run", "")):
            assert extra in PROJECT["optional-dependencies"]
    needs = {need for job in workflow["jobs"].values() for need in [job.get("needs")] if need}
    assert needs <= workflow["jobs"].keys()


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


def test_a_library_that_is_gone_is_a_sentence() -> None:
    code = "import sys; sys.modules['numpy'] = None; import companion.__main__ as m; sys.exit(m.main())"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 2
    assert "numpy" in run.stderr
    assert "Install it again: " in run.stderr
    assert "Traceback" not in run.stderr


@pytest.mark.parametrize("part", ["strapdown", "verdict", "report"])
def test_a_part_can_be_imported_by_itself(part: str) -> None:
    """`companion` loads its API by need, which must not happen half-way through a part that the API needs."""
    run = subprocess.run(
        [sys.executable, "-c", f"import companion.{part}"], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
