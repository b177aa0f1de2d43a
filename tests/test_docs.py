"""What the README and docs/ tell people to type works."""

from __future__ import annotations

import os
import re
import runpy
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from companion.cli.main import COMMANDS as COMMANDS_THERE_ARE
from companion.cli.main import main, parser
from companion.links import is_link
from companion.links.transports import parse_address
from tests.processes import ended, next_line, started
from tests.recordings import ROOT
from tests.waiting import LIMIT_S

pytestmark = pytest.mark.slow

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def commands() -> list[tuple[str, str]]:
    """(page, command) of every line in a ```sh block; what only shows the demo is no other on another page."""
    found: list[tuple[str, str]] = []
    for page in PAGES:
        for block in re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
            lines = (line.split("  #")[0].strip() for line in block.splitlines())
            known = {command for _, command in found if re.fullmatch(r"companion (view|analyze|info) demo.*", command)}
            found += [(page.name, line) for line in lines if line and line not in known]
    return found


COMMANDS = commands()


def environment(home: Path | None = None) -> dict[str, str]:
    """The PATH of someone who has activated the environment that the tests run in; home: where evo keeps settings."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return os.environ | {"PATH": path, "COLUMNS": "120"} | ({"HOME": str(home)} if home else {})


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """A folder for each page: what one of its commands writes, the next can read, and nothing else sees it.

    Where many logs are examined, one is enough to see that the command works.
    """
    folders: dict[str, Path] = {}

    def of(page: str) -> Path:
        if page not in folders:
            folders[page] = tmp_path_factory.mktemp(page)
            few = ["tlogs/copter-mission-default-rates.tlog"]
            for name in (*(few if page == "fleet.md" else ["tlogs"]), "config", "docs"):
                link = folders[page] / name
                link.parent.mkdir(exist_ok=True)
                link.symlink_to(ROOT / name)
        return folders[page]

    return of


@pytest.mark.parametrize(("page", "command"), COMMANDS, ids=[command for _, command in COMMANDS])
def test_a_documented_command_works(
    page: str,
    command: str,
    desk: Callable[[str], Path],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Those of the program in this process, which asks the same of the same flight only once."""
    words = [word.replace("/tmp/", f"{desk(page)}/") for word in shlex.split(command)]  # which others may have too
    if words[0] == "make":
        subprocess.run(["make", "--dry-run", *words[1:]], cwd=ROOT, check=True, capture_output=True)
        return
    assert words[0] in {"companion", "python", "pip", "evo_ape", "evo_rpe"}, (
        f"{page}: {command} is not run by this test"
    )
    if words[0] == "pip":
        return  # installing is what .ci/run begins with
    if words[:2] == ["companion", "view"]:
        served = [word for word in words if word != "--open"]
        with started(*served, "--port", "0", cwd=desk(page), env=environment()) as process:
            assert "http://" in next_line(process, process.stdout)
            ended(process, signal.SIGINT)
        assert process.returncode == 0
        return
    if words[0] == "companion":
        monkeypatch.chdir(desk(page))
        monkeypatch.setenv("COLUMNS", "120")
        assert main(words[1:]) == 0
        said = capsys.readouterr()
        assert said.out or said.err
        return
    run = subprocess.run(
        words, cwd=desk(page), env=environment(desk(page)), capture_output=True, text=True, timeout=LIMIT_S, check=False
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout or run.stderr


def commands_for_elsewhere() -> list[str]:
    """Every call of the program in a ```text block: with hardware, links or folders that are not here."""
    text = "".join(t for p in PAGES for t in re.findall(r"```text\n(.*?)```", p.read_text(encoding="utf-8"), re.DOTALL))
    calls = re.findall(rf"\bcompanion ((?:{'|'.join(COMMANDS_THERE_ARE)})\b.*)", re.sub(r"\$\([^)]*\)", "log", text))
    return [re.split(r" [|] |  +#", call)[0] for call in calls]


@pytest.mark.parametrize("command", commands_for_elsewhere())
def test_a_documented_command_for_elsewhere_is_taken(command: str) -> None:
    words = shlex.split(command)
    arguments, unknown = parser(words[0]).parse_known_args(words)
    assert unknown == []
    assert callable(arguments.run)
    for link in filter(is_link, words):
        parse_address(link)


def test_the_notebook_example_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    assert blocks
    script = tmp_path / "example.py"
    script.write_text("".join(blocks), encoding="utf-8")
    monkeypatch.chdir(ROOT)
    runpy.run_path(str(script))
    assert "Statistic(" in capsys.readouterr().out


def anchors(page: Path) -> set[str]:
    """What GitHub calls the headings of a page."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_pages_link_to_files_and_headings_that_exist() -> None:
    for page in PAGES:
        for target in re.findall(r"\]\(([^)]+)\)", page.read_text(encoding="utf-8")):
            if target.startswith("http"):
                continue
            name, _, heading = target.partition("#")
            linked = page.parent / name if name else page
            assert linked.exists(), f"{page.name} links to {target}"
            assert not heading or heading in anchors(linked), f"{page.name} links to {target}"


def test_every_page_is_reached_from_the_readme() -> None:
    linked = re.findall(r"\]\((docs/\w[\w-]*\.md)", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert {f"docs/{page.name}" for page in PAGES[1:]} <= set(linked)


def samples() -> list[tuple[str, str]]:
    """(command, output) of every "`companion ...` prints:" with a ```text block under it."""
    pattern = r"`companion ([^`]+)` prints:\n\n```text\n(.*?)```"
    return [found for page in PAGES for found in re.findall(pattern, page.read_text(encoding="utf-8"), re.DOTALL)]


@pytest.mark.parametrize(("command", "sample"), samples(), ids=[command for command, _ in samples()])
def test_a_page_shows_what_a_command_prints_now(
    command: str, sample: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Letter by letter, but for spaces at the end of a line."""
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("COLUMNS", "120")
    assert main(shlex.split(command)) == 0
    said = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
    assert sample.count("\n") > 8
    assert sample.rstrip() in "\n".join(said)


def test_the_readme_shows_a_verdict() -> None:
    assert "analyze demo" in [command for command, _ in samples()]


def test_the_table_of_settings_is_that_of_the_code() -> None:
    run = subprocess.run(
        [sys.executable, "docs/settings.py"], cwd=ROOT, env=environment(), capture_output=True, check=True
    )
    page = (ROOT / "docs" / "settings.md").read_bytes()
    assert run.stdout == page, "make it anew: python docs/settings.py > docs/settings.md"
    keys = re.findall(r"^(\w+) =", (ROOT / "config" / "default.toml").read_text(encoding="utf-8"), re.MULTILINE)
    assert len(re.findall(r"^\| `\w+` \| `.+` \| .+ \| \S.+ \|$", page.decode(), re.MULTILINE)) == len(keys)
