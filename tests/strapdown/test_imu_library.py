"""The figures in config/imu: complete, plausible for their class, and each with its source or its reason."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).parents[2] / "config" / "imu"
PARTS = {
    "adis16470", "bmi088", "bmi270", "generic-mems", "icm-20602", "icm-20689", "icm-20948", "icm-42688-p", "icm-45686",
    "mpu-6000", "mpu-9250",
}  # fmt: skip
ALL = sorted(path.stem for path in FOLDER.glob("*.toml"))
FIGURES = {"noise_density", "bias_walk", "residual_bias", "offset", "scale", "full_scale"}
BOUNDS = {  # unit: (smallest, largest) value that a part of this class can have
    "mdps/√Hz": (1, 20),
    "dps/√Hz": (0.001, 0.02),
    "µg/√Hz": (50, 500),
    "rad/s/√s": (1e-6, 1e-3),
    "m/s²/√s": (1e-5, 1e-2),
    "dps": (0.005, 5000),
    "mg": (1, 100),
    "g": (8, 40),
    "%": (0.05, 5),
}


def part(name: str) -> dict[str, Any]:
    return tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))


def test_the_library_holds_the_parts_of_common_autopilots() -> None:
    assert set(ALL) >= PARTS


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_no_two_parts_have_one_device_type(autopilot: str) -> None:
    numbers = [n for name in ALL for n in part(name).get("device_types", {}).get(autopilot, [])]
    assert len(numbers) > 9
    assert len(numbers) == len(set(numbers))


@pytest.mark.parametrize("name", ALL)
def test_every_figure_is_plausible_and_has_a_source(name: str) -> None:
    described = part(name)
    named = set() if name == "generic-mems" else {"device_types"}
    assert set(described) == {"name", "datasheet", "gyro", "accel"} | named
    for sensor in ("gyro", "accel"):
        figures = described[sensor]
        assert set(figures) == FIGURES
        for figure in figures.values():
            assert set(figure) == {"value", "unit", "kind", "source"}
            assert figure["kind"] in {"datasheet", "secondary", "typical"}
            assert len(figure["source"]) > 10
            low, high = BOUNDS[figure["unit"]]
            assert low <= figure["value"] <= high
        assert figures["residual_bias"]["unit"] == figures["offset"]["unit"]
        assert figures["residual_bias"]["value"] < figures["offset"]["value"]
