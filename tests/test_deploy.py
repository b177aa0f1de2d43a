"""What runs companion aboard: the systemd unit and the image say what they mean, and name what there is."""

from __future__ import annotations

import configparser
import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from companion.cli.main import parser
from tests.recordings import ROOT

UNIT = ROOT / "deploy" / "companion.service"
DOCKERFILE = (ROOT / "Dockerfile").read_text(encoding="utf-8")


def service() -> dict[str, list[str]]:
    """The unit's [Service], each key with all of its values."""
    values: dict[str, list[str]] = {}
    section = UNIT.read_text(encoding="utf-8").split("[Service]")[1].split("[Install]")[0]
    for line in section.splitlines():
        if line and not line.startswith("#"):
            key, _, value = line.partition("=")
            values.setdefault(key, []).append(value)
    return values


def instructions() -> list[tuple[str, str]]:
    """(instruction, argument) of the Dockerfile."""
    text = re.sub(r"\\\n\s*", "", re.sub(r"^#.*\n", "", DOCKERFILE, flags=re.MULTILINE))
    return [(name, rest) for name, _, rest in (line.partition(" ") for line in text.splitlines() if line)]


def test_the_service_runs_a_command_that_there_is_and_stops_it_kindly() -> None:
    values = service()
    (start,) = values["ExecStart"]
    command = start.replace("${LINK}", "udpin:0.0.0.0:14550").replace("$OPTIONS", "--announce").split()[1:]
    arguments = parser().parse_args(command)
    assert (arguments.wait, arguments.announce) == (float("inf"), True)
    assert values["User"] == ["companion"]
    assert values["KillSignal"] == ["SIGTERM"], "which gives the vehicle its intervals back"
    assert int(values["TimeoutStopSec"][0]) > 2
    assert "XDG_STATE_HOME=/var/lib/companion" in values["Environment"]
    strict = configparser.ConfigParser(strict=False, interpolation=None)
    strict.read_string(UNIT.read_text(encoding="utf-8"))
    assert strict.sections() == ["Unit", "Service", "Install"]


def test_systemd_understands_the_service(tmp_path: Path) -> None:
    if not (tool := shutil.which("systemd-analyze")):
        pytest.skip("no systemd-analyze here")
    unit = tmp_path / "companion.service"
    text = UNIT.read_text(encoding="utf-8").replace("/opt/companion/venv/bin/companion", shutil.which("true") or "")
    unit.write_text(text.replace("User=companion", "User=root"), encoding="utf-8")
    run = subprocess.run([tool, "verify", str(unit)], capture_output=True, text=True, check=False)
    assert "companion.service" not in run.stderr, run.stderr


def test_the_image_holds_what_the_package_needs_and_runs_as_nobody_special() -> None:
    found = instructions()
    for name, rest in found:
        if name == "COPY" and not rest.startswith("--from"):
            for source in rest.split()[:-1]:
                assert (ROOT / source).exists(), source
                assert source not in (ROOT / ".dockerignore").read_text(encoding="utf-8").split()
    assert [rest for name, rest in found if name == "USER"] == ["companion"]
    assert all(re.search(r":\d", rest) for name, rest in found if name == "FROM"), "of a stated version"
    assert {name for name, _ in found} <= {
        "FROM", "ARG", "WORKDIR", "COPY", "RUN", "USER", "VOLUME", "ENV", "STOPSIGNAL", "LABEL", "ENTRYPOINT", "CMD",
    }  # fmt: skip
    commands = {name: json.loads(rest) for name, rest in found if name in ("ENTRYPOINT", "CMD")}
    assert commands["ENTRYPOINT"] == ["companion"]
    parser().parse_args(commands["CMD"])


def test_the_labels_are_those_of_a_blueos_extension() -> None:
    (rest,) = (rest for name, rest in instructions() if name == "LABEL")
    labels = dict(word.split("=", 1) for word in shlex.split(rest))
    read = {name: json.loads(labels[name]) for name in ("tags", "links", "permissions", "authors", "company")}
    assert labels["type"] in {"device-integration", "example", "theme", "education", "tool", "other"}
    assert read["permissions"]["NetworkMode"] == "host"
    assert all(author["name"] for author in read["authors"])
    assert read["company"]["name"]
    (repository,) = (rest for name, rest in instructions() if name == "ARG")
    assert repository.startswith("REPOSITORY=")
    for address in (labels["readme"], *read["links"].values()):
        assert "${REPOSITORY}" in address
    page = labels["readme"].partition("/v{tag}/")[2]
    assert (ROOT / page).exists()
    assert f'version = "{labels["version"]}"' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")


def test_the_entry_of_the_blueos_store_is_whole() -> None:
    entry = json.loads((ROOT / "deploy" / "blueos" / "metadata.json").read_text(encoding="utf-8"))
    assert entry.keys() == {"name", "website", "docker", "description"}
    assert all(entry.values())
