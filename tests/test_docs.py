"""What the README and docs/ tell people to type works."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.recordings import ROOT

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def commands() -> list[tuple[str, str]]:
    """(page, command) of every line in a ```sh block."""
    found = []
    for page in PAGES:
        for block in re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
            lines = (line.split("  #")[0].strip() for line in block.splitlines())
            found += [(page.name, line) for line in lines if line]
    return found


COMMANDS = commands()


def environment() -> dict[str, str]:
    """The PATH of someone who has activated the environment that the tests run in."""
    return os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}", "COLUMNS": "120"}


@pytest.mark.parametrize(("page", "command"), COMMANDS, ids=[command for _, command in COMMANDS])
def test_a_documented_command_works(page: str, command: str, tmp_path: Path) -> None:
    words = shlex.split(command)
    if words[0] == "make":
        subprocess.run(["make", "--dry-run", *words[1:]], cwd=ROOT, check=True, capture_output=True)
        return
    assert words[0] in {"companion", "python", "pip"}, f"{page}: {command} is not run by this test"
    if words[0] == "pip":
        return  # installing is what .ci/run begins with
    if words[:2] == ["companion", "view"]:
        served = start([*(w for w in words if w != "--open"), "--port", "18080"])
        assert "http://" in served
        return
    run = subprocess.run(words, cwd=ROOT, env=environment(), capture_output=True, text=True, timeout=120, check=False)
    assert run.returncode == 0, run.stderr
    assert run.stdout
    assert not list(tmp_path.iterdir())


def start(words: list[str]) -> str:
    """The first line of a server that is stopped with Ctrl-C once it has said it."""
    with subprocess.Popen(words, cwd=ROOT, env=environment(), stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        line = process.stdout.readline()
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=20) in {0, 130}
    return line


def test_the_notebook_example_runs(tmp_path: Path) -> None:
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    assert blocks
    script = tmp_path / "example.py"
    script.write_text("".join(blocks), encoding="utf-8")
    run = subprocess.run([sys.executable, script], cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)
    assert run.returncode == 0, run.stderr
    assert "Statistic(" in run.stdout


def test_pages_link_to_files_that_exist() -> None:
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
            assert target.startswith("http") or (page.parent / target).exists(), f"{page.name} links to {target}"


def test_the_readme_shows_what_analyze_prints_now() -> None:
    """The README quotes the program's own output, letter by letter."""
    run = subprocess.run(
        ["companion", "analyze", "demo"], cwd=ROOT, env=environment(), capture_output=True, text=True, check=True
    )
    assert run.stdout.count("\n") > 8
    assert run.stdout.rstrip() in (ROOT / "README.md").read_text(encoding="utf-8")
