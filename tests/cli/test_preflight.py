"""`companion preflight`: of a log and of a link, its exit code, and the keys of its JSON."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from companion.cli import main
from tests.documents.test_keys import KEYS, differences
from tests.recordings import BUNDLED
from tests.simulated import flying, free_port

pytestmark = pytest.mark.slow

DEMO = BUNDLED / "copter-demo-100hz.tlog"
Captured = pytest.CaptureFixture[str]


def test_the_demo_is_fit_to_fly(capsys: Captured) -> None:
    assert main(["preflight", str(DEMO), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert differences(document, KEYS["preflight"], "preflight") == []
    (flight,) = document["flights"]
    assert flight["outcome"] == "go"
    assert flight["missing"] == ["barometer: none in the log"]


def test_a_link_is_listened_to_and_checked(tmp_path: Path, capsys: Captured) -> None:
    port, kept = free_port(), tmp_path / "kept.tlog"
    with flying(port, motion="rest"):
        code = main(["preflight", f"udpin:127.0.0.1:{port}", "--duration", "8", "-o", str(kept)])
    printed = capsys.readouterr()
    assert code == 0, printed.err
    assert printed.out.startswith("GO: ")
    assert kept.exists()


def test_options_of_a_link_are_refused_for_a_log(capsys: Captured) -> None:
    assert main(["preflight", str(DEMO), "--duration", "5"]) == 2
    assert "--duration is for a link" in capsys.readouterr().err


def test_a_history_needs_three_flights(tmp_path: Path, capsys: Captured) -> None:
    def another(i: int) -> None:
        (tmp_path / f"{i}.tlog").write_bytes(DEMO.read_bytes() + bytes(1 + i))

    another(0)
    another(1)
    assert main(["preflight", str(DEMO), "--history", str(tmp_path)]) == 2
    assert "2 flights of this vehicle" in capsys.readouterr().err
    another(2)
    assert main(["preflight", str(DEMO), "--history", str(tmp_path), "--json"]) == 0
    checks = json.loads(capsys.readouterr().out)["flights"][0]["checks"]
    assert all(one["history"]["times"] == 3 and not one["history"]["changed"] for one in checks)
