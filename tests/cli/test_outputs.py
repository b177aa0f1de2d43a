"""What every command writes takes the place of files alone: the commands and their options are those of the parser."""

from __future__ import annotations

import argparse
import os
import stat
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from companion.cli import main
from companion.cli.main import parser
from companion.fleet.journal import Journal
from companion.fleet.rows import COLUMNS
from companion.fleet.run import write_results
from companion.model import InputError
from tests.recordings import BUNDLED
from tests.simulated import free_port

DEMO = str(BUNDLED / "copter-mission-default-rates.tlog")
READS = {
    "baseline", "config", "config_b", "correction", "correction_b", "history", "imu_model", "imu_model_b",
    "signing_key_file",
}  # fmt: skip
"""Options that name a file which is read."""
RESULTS = {"junit", "write_baseline"}
"""Those that name what CI writes anew with each run."""

WRITES: dict[str, Callable[[], list[str]]] = {
    "report": lambda: [DEMO, "--no-playback", "--force"],
    "calibrate": lambda: [DEMO, "--force"],
    "smooth": lambda: [DEMO, "--force"],
    "noise": lambda: [DEMO, "--force"],
    "incident": lambda: [DEMO, "--at", "60", "--force"],
    "preflight": lambda: [f"udpin:127.0.0.1:{free_port()}", "--wait", "0.1"],
    "export": lambda: [DEMO, "--format", "json", "--force"],
    "fleet": lambda: [DEMO, "--workers", "1"],
    "view": lambda: [f"udpin:127.0.0.1:{free_port()}", "--wait", "0.1"],
    "record": lambda: [f"udpin:127.0.0.1:{free_port()}", "--wait", "0.1"],
    "watch": lambda: [f"udpin:127.0.0.1:{free_port()}", "--wait", "0.1"],
    "simulate": lambda: ["--duration", "1", "--force"],
}
"""Command → what else it is given to write something."""

ENDS = {"smooth": ".tum", "noise": ".yaml", "incident": ".md"}
"""What the name has to end in, where that matters."""


def commands() -> Iterator[tuple[str, argparse.ArgumentParser]]:
    (found,) = (a for a in parser()._actions if isinstance(a, argparse._SubParsersAction))
    yield from found.choices.items()


def test_every_option_that_names_a_place_is_known() -> None:
    """A new command or option that writes belongs into WRITES, one that reads into READS."""
    writing = set()
    for name, one in commands():
        for action in one._actions:
            metavar = str(action.metavar or "")
            place = any(word in metavar for word in ("FILE", "DIR", "PATH")) and action.option_strings
            if "-o" in action.option_strings or action.dest == "output":
                writing.add(name)
            elif place:
                assert action.dest in READS | RESULTS, f"{name} {action.option_strings}"
    assert writing == WRITES.keys()


KINDS: dict[str, Callable[[Path], None]] = {
    "pipe": os.mkfifo,
    "device": lambda path: path.symlink_to("/dev/null"),
    "link": lambda path: path.symlink_to(path.with_name("victim")),
    "dangling": lambda path: path.symlink_to("nowhere"),
}


def hypothesis_of(path: Path) -> int:
    return stat.S_IFMT(path.lstat().st_mode)


@pytest.mark.skipif(os.name != "posix", reason="pipes and links of POSIX")
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("command", WRITES)
def test_no_command_writes_to_what_is_no_file(
    command: str, kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "victim").write_text("precious")
    path = tmp_path / f"out{ENDS.get(command, '')}"
    KINDS[kind](path)
    before, there = hypothesis_of(path), sorted(tmp_path.iterdir())
    assert main([command, *WRITES[command](), "-o", str(path)]) == 2
    assert str(path) in capsys.readouterr().err
    assert hypothesis_of(path) == before
    assert (tmp_path / "victim").read_text() == "precious"
    assert sorted(tmp_path.iterdir()) == there


@pytest.mark.skipif(os.name != "posix", reason="pipes and links of POSIX")
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["fleet.jsonl", "fleet.html", *(f"{table}.parquet" for table in COLUMNS)])
def test_no_file_of_a_fleet_is_written_to_what_is_none(name: str, kind: str, tmp_path: Path) -> None:
    folder = tmp_path / "results"
    folder.mkdir()
    (folder / "victim").write_text("precious")
    KINDS[kind](folder / name)
    before = hypothesis_of(folder / name)

    def run() -> None:
        Journal(folder, "version")
        write_results(folder, [], {})

    with pytest.raises(InputError, match="none of these is replaced"):
        run()
    assert hypothesis_of(folder / name) == before
    assert (folder / "victim").read_text() == "precious"
