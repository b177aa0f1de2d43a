"""`companion mcp`, asked by the client of the mcp package."""

from __future__ import annotations

import asyncio
import json
import os
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from companion.cli import main
from companion.cli.main import COMMANDS, commands_of, parser
from tests.documents.test_keys import KEYS
from tests.recordings import ROOT
from tests.tlogs import resting

pytest.importorskip("mcp", reason="no mcp here: pip install 'mavlink-companion[mcp]'")

from mcp import Client, StdioServerParameters

from companion.cli.mcp import TOOLS, server


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a log, a link that leads out of it, and a log beside it."""
    top = tmp_path_factory.mktemp("mcp")
    inside = top / "logs" / "below"
    inside.mkdir(parents=True)
    resting(inside / "rest.tlog")
    resting(top / "outside.tlog")
    (top / "logs" / "link.tlog").symlink_to(top / "outside.tlog")
    return top / "logs"


def asked(folder: Path, question: Callable[[Client], Awaitable[Any]], **how: Any) -> Any:
    """What a client in this process is answered."""

    async def ask() -> Any:
        async with Client(server(folder, **how)) as client:
            return await question(client)

    return asyncio.run(ask())


def call(folder: Path, name: str, how: dict[str, Any] | None = None, **arguments: Any) -> Any:
    return asked(folder, lambda client: client.call_tool(name, arguments), **(how or {}))


def test_every_tool_is_a_command_with_a_documented_document(folder: Path) -> None:
    assert TOOLS.keys() <= COMMANDS.keys() & KEYS.keys()
    told = (ROOT / "docs" / "assistants.md").read_text(encoding="utf-8")
    assert all(f"`{name}`" in told for name in TOOLS)
    listed = {tool.name: tool for tool in asked(folder, lambda client: client.list_tools()).tools}
    assert listed.keys() == {"list_logs", *TOOLS}
    for name, tool in TOOLS.items():
        (command,) = commands_of(parser(name)).values()
        options = {option for action in command._actions for option in action.option_strings}
        assert {f"--{option}" for option in tool.options} | {"--json"} <= options
        assert listed[name].annotations is not None
        assert listed[name].annotations.read_only_hint
        assert listed[name].input_schema["required"][0] == "log"


def test_logs_are_listed_and_answers_are_the_commands_own_json(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    logs = call(folder, "list_logs").structured_content
    assert [one["log"] for one in logs["logs"]] == ["below/rest.tlog"], "what a link leads to outside is none"
    answer = call(folder, "analyze", log="below/rest.tlog")
    assert not answer.is_error
    assert main(["analyze", str(folder / "below" / "rest.tlog"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert answer.structured_content == document == json.loads(answer.content[0].text)


@pytest.mark.parametrize(
    ("name", "arguments", "why"),
    [
        ("info", {"log": "../outside.tlog"}, "there is no log"),
        ("info", {"log": "link.tlog"}, "there is no log"),
        ("info", {"log": "/etc/passwd"}, "there is no log"),
        ("info", {"log": "--config=/etc/passwd"}, "there is no log"),
        ("info", {"log": "below"}, "there is no log"),
        ("info", {}, "'log' is a required property"),
        ("analyze", {"log": "below/rest.tlog", "vehicle": "1 --config x"}, "does not match"),
        ("analyze", {"log": "below/rest.tlog", "correction": "/etc/passwd"}, "correction"),
        ("series", {"log": "below/rest.tlog", "table": "--config=x"}, "does not match"),
        ("view", {"log": "below/rest.tlog"}, "there is no tool view"),
    ],
)
def test_nothing_else_is_read_or_run(folder: Path, name: str, arguments: dict[str, Any], why: str) -> None:
    answer = call(folder, name, **arguments)
    assert answer.is_error
    assert why in answer.content[0].text


def test_a_mistake_is_answered_as_the_command_says_it(folder: Path) -> None:
    answer = call(folder, "series", log="below/rest.tlog", table="atitude")
    assert answer.is_error
    assert answer.content[0].text.endswith("Did you mean attitude?")


def test_an_answer_that_takes_too_long(folder: Path) -> None:
    answer = call(folder, "info", {"timeout_s": 0.01}, log="below/rest.tlog")
    assert answer.is_error
    assert "longer than 0.01 s" in answer.content[0].text


def test_a_client_starts_it_as_an_assistant_does(folder: Path) -> None:
    """On stdin and stdout of a process of its own."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = StdioServerParameters(
        command=sys.executable, args=["-m", "companion", "mcp", str(folder)], env=environment
    )

    async def ask() -> Any:
        async with Client(command) as client:
            assert "insufficient_data" in (client.instructions or "")
            return await client.call_tool("list_logs", {})

    assert len(asyncio.run(ask()).structured_content["logs"]) == 1


def test_a_folder_that_there_is_not(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["mcp", str(tmp_path / "none")]) == 2
    assert "there is no folder" in capsys.readouterr().err


def test_without_the_extra_there_is_a_line_to_type(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "mcp.server.stdio", None)
    assert main(["mcp", str(folder)]) == 2
    assert "[mcp]" in capsys.readouterr().err
