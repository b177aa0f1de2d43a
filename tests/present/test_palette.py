"""Sources can be told apart, by colour-blind eyes too."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from companion.model import Array
from companion.present import palette

# Machado, Oliveira and Fernandes 2009, table 1, severity 1: what a dichromat sees, in linear RGB.
EYES = {
    "normal": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}
SOURCES = {"autopilot": palette.AUTOPILOT} | {f"IMU {i}": colour for i, colour in enumerate(palette.IMUS)}


def lab(colour: palette.Rgb, eye: Array) -> Array:
    """CIELAB (D65) of a colour seen by an eye."""
    c = np.array(colour) / 255
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    xyz = to_xyz @ np.clip(eye @ linear, 0, 1) / np.array([0.9505, 1.0, 1.089])
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("eye", EYES)
def test_two_sources_never_look_alike(eye: str) -> None:
    seen = {name: lab(colour, EYES[eye]) for name, colour in SOURCES.items()}
    apart = {(a, b): float(np.linalg.norm(seen[a] - seen[b])) for a, b in combinations(seen, 2)}
    assert min(apart.values()) > 12, min(apart, key=lambda pair: apart[pair])  # 2.3 is just noticeable


def test_a_source_keeps_its_colour_whichever_is_reckoned() -> None:
    assert palette.of_imus(["RAW_IMU", "SCALED_IMU2"])["SCALED_IMU2"] == palette.IMUS[1]
    assert len(palette.of_imus(f"IMU{i}" for i in range(8))) == 8
