"""The keys of the JSON, their order and their types are frozen: keys.json has them. Keys are added, never renamed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from companion.cli import main
from tests.recordings import BUNDLED, beginning
from tests.tlogs import Writer

KEYS = json.loads(Path(__file__).with_name("keys.json").read_text(encoding="utf-8"))
"""Document → its shape: an object by its keys, one with any keys as {"*": ...}, a list by its item; ? may be null."""
TYPES: dict[str, Any] = {"text": str, "number": (int, float), "bool": bool}
DEMO = str(BUNDLED / "copter-demo-100hz.tlog")


def differences(value: Any, shape: Any, where: str) -> list[str]:
    """Where a document is of another shape."""
    match shape:
        case str():
            return differences(value, KEYS[shape], where) if shape in KEYS else _of_leaf(value, shape, where)
        case [item]:
            return [d for i, one in enumerate(value) for d in differences(one, item, f"{where}[{i}]")]
        case {"*": item}:
            return [d for key, one in value.items() for d in differences(one, item, f"{where}.{key}")]
        case {"?": item}:
            return [] if value is None else differences(value, item, where)
    wanted = [key.removesuffix("?") for key in shape]
    if list(value) != wanted:
        return [f"{where} has {list(value)}, not {wanted}"]
    return [
        d
        for key, of in shape.items()
        if not (key.endswith("?") and value[key.removesuffix("?")] is None)
        for d in differences(value[key.removesuffix("?")], of, f"{where}.{key}")
    ]


def _of_leaf(value: Any, shape: str, where: str) -> list[str]:
    if value is None and shape.endswith("?"):
        return []
    return [] if isinstance(value, TYPES[shape.removesuffix("?")]) else [f"{where} is {value!r}, no {shape}"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("info", ["info", DEMO]),
        ("analyze", ["analyze", DEMO, "--anchor", "rest"]),
        ("analyze", ["analyze", "its beginning", "--confusion"]),
        ("compare", ["compare", DEMO, "--method-b", "euler"]),
        ("noise", ["noise", DEMO]),
        ("smooth", ["smooth", DEMO]),
        ("series", ["series", DEMO]),
        ("series", ["series", DEMO, "position", "--points", "5"]),
    ],
)
def test_a_document_has_its_keys(
    name: str, arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    its_beginning = str(beginning(Path(DEMO), tmp_path))
    assert main([*(its_beginning if word == "its beginning" else word for word in arguments), "--json"]) == 0
    assert differences(json.loads(capsys.readouterr().out), KEYS[name], name) == []


def test_a_flight_that_cannot_be_examined_has_the_same_keys(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    writer = Writer(tmp_path / "no-attitude.tlog")
    for i in range(300):
        writer.heartbeat(0.1 * i)
        writer.raw_imu(0.1 * i, 20 + 0.1 * i)
    assert main(["analyze", str(writer.close()), "--json"]) == 2
    assert differences(json.loads(capsys.readouterr().out), KEYS["analyze"], "analyze") == []
