"""config/default.toml: complete, documented, and the same as what the code assumes."""

from __future__ import annotations

import inspect
import tomllib
from itertools import pairwise

import msgspec
import pytest

from companion.app.examination import integration_of
from companion.app.recording import open_log
from companion.app.settings import Settings, load_settings
from companion.comparison import HORIZONS_S, Integration, replay
from companion.installation import data_folder

DEFAULT = data_folder("config") / "default.toml"


def test_the_file_holds_every_setting_with_its_default() -> None:
    assert tomllib.loads(DEFAULT.read_text()) == msgspec.json.decode(msgspec.json.encode(Settings()))
    assert load_settings(DEFAULT) == load_settings(None) == Settings()


def test_every_setting_is_described() -> None:
    lines = DEFAULT.read_text().splitlines()
    for before, line in pairwise(lines):
        if " = " in line and not line.startswith("#"):
            assert before.startswith("#"), f"{line} has no description above it"


def test_the_defaults_of_the_functions_are_the_same() -> None:
    settings = Settings()
    assert settings.drift.horizons_s == HORIZONS_S
    assert integration_of(settings, open_log(data_folder("tlogs") / "copter-demo-100hz.tlog")[0]) == Integration()
    assert inspect.signature(replay).parameters["reanchor_s"].default == pytest.approx(settings.view.reanchor_s)
