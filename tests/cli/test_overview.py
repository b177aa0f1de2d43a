"""What somebody sees who types `companion` for the first time, and what a shell completes."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from companion.cli import main
from companion.cli.main import COMMANDS, overview

Captured = pytest.CaptureFixture[str]


def test_the_bare_command_lists_every_command_on_one_screen(capsys: Captured) -> None:
    assert main([]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 23, "and the prompt: a terminal of 24 lines"
    assert max(map(len, lines)) <= 80
    *listed, helpers = [line.split(maxsplit=1) for line in lines if line.startswith("  ")]
    assert [name for name, _ in listed] == [name for name, command in COMMANDS.items() if not command.is_helper]
    assert helpers[1].split(", ") == [name for name, command in COMMANDS.items() if command.is_helper]


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_of_a_command_has_its_example(name: str, capsys: Captured) -> None:
    with pytest.raises(SystemExit, match="0"):
        main([name, "--help"])
    whole = "".join(capsys.readouterr().out.split())  # however it is folded
    assert "".join(f"example: {COMMANDS[name].example}".split()) in whole


def test_help_is_a_command_too(capsys: Captured) -> None:
    assert main(["help"]) == 0
    assert capsys.readouterr().out == overview() + "\n"
    with pytest.raises(SystemExit, match="0"):
        main(["help", "analyze"])
    assert "usage: companion analyze" in capsys.readouterr().out


def test_the_shell_completes_commands_options_and_files(tmp_path: Path, capsys: Captured) -> None:
    assert main(["completion", "bash"]) == 0
    script = tmp_path / "companion.bash"
    script.write_text(text := capsys.readouterr().out, encoding="utf-8")
    for option in ("smooth__o", "export__o", "preflight___history"):
        assert f"_shtab_companion_{option}_COMPGEN=_shtab_compgen_files" in text.splitlines()
    ask = "COMP_WORDS=({words}); COMP_CWORD={last}; _shtab_companion; echo ${{COMPREPLY[@]}}"
    for words, expected in (("companion an", "analyze"), ("companion export --for", "--format")):
        asked = ask.format(words=words, last=len(words.split()) - 1)
        done = subprocess.run(["bash", "-c", f". {script}; {asked}"], capture_output=True, text=True, check=True)
        assert expected in done.stdout.split(), done.stderr
