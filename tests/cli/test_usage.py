"""What is mistyped is answered by a sentence with what was probably meant, not by a screen of options."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest
import yaml

from companion.cli import main
from companion.links import is_link, meant_link, parse_address
from companion.model import InputError
from tests.tlogs import resting

Captured = pytest.CaptureFixture[str]


def said(arguments: str, capsys: Captured) -> str:
    try:
        code = main(arguments.split())
    except SystemExit as stop:  # argparse's own errors
        code = int(stop.code or 0)
    output = capsys.readouterr()
    assert code == 2
    assert not output.out
    assert output.err.count("\n") == 1
    assert len(output.err) < 160
    return output.err


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        ("analyse demo", "Did you mean companion analyze?"),
        ("help veiw", "Did you mean companion view?"),
        ("tlogs", "companion analyze tlogs"),
        ("udpin:0.0.0.0:14550", "Did you mean companion view udpin:0.0.0.0:14550?"),
        ("upd:14550", "Did you mean companion view udp:14550?"),
        ("export demo -o flight.xyz", "or a name that ends in"),
        ("quark", "All commands: companion help"),
        ("view demo --methd rk4", "Did you mean --method?"),
        ("analyze demo --quark", "See companion help analyze"),
        ("info demo --tabel", "Did you mean --table?"),
        ("view demo twice", "does not take twice. See companion help view"),
        ("analyze", "the following arguments are required: LOG. See companion help analyze"),
        ("--quark", "required: COMMAND. See companion help"),
        ("--quark info demo", "companion info does not take --quark"),
    ],
)
def test_a_mistyped_command_or_option(arguments: str, hint: str, capsys: Captured) -> None:
    assert hint in said(arguments, capsys)


@pytest.mark.parametrize("command", ["info", "analyze", "view", "compare demo"])
def test_a_link_where_a_log_is_expected(command: str, capsys: Captured) -> None:
    assert "companion view udp:14550 or record udp:14550" in said(f"{command} upd:14550", capsys)


@pytest.mark.parametrize("words", [["info", "{}"], ["analyze", "{}"], ["noise", "demo", "-o", "{}"]])
def test_a_name_that_no_file_can_have_is_one_sentence(words: list[str], capsys: Captured) -> None:
    name = "n" * 300 + ".tlog"
    assert main([word.format(name) for word in words]) == 2
    assert "internal error" not in capsys.readouterr().err


@pytest.mark.skipif(sys.platform != "linux", reason="only there any bytes are a name")
def test_a_name_that_is_no_utf_8_is_written_into_no_file(tmp_path: Path, capsys: Captured) -> None:
    log = str(shutil.copy(resting(tmp_path / "rest.tlog"), tmp_path / "uni\udcff\rx: 1.tlog"))
    noise, baseline = tmp_path / "noise", tmp_path / "baseline.json"
    assert main(["noise", log, "-o", str(noise)]) == 0
    assert main(["check", log, "--write-baseline", str(baseline)]) in (0, 1)
    assert "internal error" not in capsys.readouterr().err
    assert "x" not in yaml.safe_load((noise / "imu.yaml").read_text(encoding="utf-8"))
    assert baseline.exists()


def test_a_link_for_a_command_that_takes_logs_alone(capsys: Captured) -> None:
    assert "companion view udpin:0.0.0.0:14550" in said("analyze udpin:0.0.0.0:14550", capsys)


def test_a_mistyped_link_of_a_command_that_takes_links(capsys: Captured) -> None:
    assert "did you mean tcp:10.0.0.2:5760?" in said("record tpc:10.0.0.2:5760", capsys)


@pytest.mark.parametrize("name", ["flight.tlog", "C:\\logs\\1.tlog", "logs/upd:14550", "upd:", "http://x/1.tlog", ""])
def test_what_does_not_look_like_a_link(name: str) -> None:
    assert not is_link(name)
    assert not meant_link(name)
    with pytest.raises(InputError, match="use udpin:HOST:PORT"):
        parse_address(name)
