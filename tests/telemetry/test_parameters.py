"""What the parameters say of an IMU."""

from __future__ import annotations

import ast
import itertools
from collections.abc import Iterator

import numpy as np
import pytest

from companion.model import ImuTrack, Vehicle
from companion.telemetry.parameters import id_parameters, possible, range_of, with_facts
from tests.recordings import ROOT

PX4 = Vehicle(1, 1, "PX4", "QUADROTOR")


@pytest.mark.parametrize("rate", [100.0, 200.0, 400.0])
def test_px4s_means_stand_at_the_middles_of_their_intervals(rate: float) -> None:
    """They are stamped at the end of them: of a rate that grows evenly each then is the rate of its time."""
    stamps = np.arange(1.0, 2.0, 0.02)
    growing = np.outer(stamps - 0.5 / rate, [1.0, -2.0, 0.5])  # the mean of the interval that has ended
    track = with_facts(ImuTrack(stamps, growing, growing, "SCALED_IMU"), PX4, {"IMU_INTEG_RATE": rate})
    np.testing.assert_allclose(track.gyro, np.outer(track.t, [1.0, -2.0, 0.5]), atol=1e-12)
    assert track.interval == pytest.approx(1.0 / rate)


@pytest.mark.parametrize(
    ("name", "value", "read"),
    [
        ("INS_GYRO_FILTER", 20.0, True),
        ("INS_GYRO_FILTER", 0.0, True),  # no filter
        ("INS_GYRO_FILTER", -20.0, False),
        ("INS_GYRO_FILTER", 1e-9, False),
        ("INS_GYRO_FILTER", 1e8, False),
        ("INS_ACCEL_FILTER", 1e30, False),
        ("IMU_GYRO_CUTOFF", np.inf, False),
        ("AHRS_TRIM_X", 0.05, True),
        ("AHRS_TRIM_Y", 1e30, False),
        ("INS4_GYR_ID", 2.0**32, True),
        ("INS_GYR2_ID", 1.2e19, False),
        ("CAL_GYRO1_ID", np.nan, False),
        ("CAL_ACC0_XSCALE", 0.0, False),
        ("SERVO12_FUNCTION", 33.0, True),
    ],
)
def test_what_a_parameter_cannot_be_is_unknown_and_noted(name: str, value: float, read: bool) -> None:
    notes: list[str] = []
    kept = possible([b"WPNAV_SPEED", name.encode()], np.array([1e30, value]), notes)
    assert kept[0] == 1e30  # which nothing rests on
    if read:
        assert kept[1] == value
        assert not notes
    else:
        assert np.isnan(kept[1])
        assert [note for note in notes if f"{name} = {value:g}" in note]


def _asked(tree: ast.AST) -> Iterator[list[str]]:
    """The names by which the source asks for parameters: of an f-string, with anything that may stand in it."""
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Attribute(value=ast.Name("parameters"), attr="get"), args=[name, *_]):
                pass
            case ast.Subscript(value=ast.Name("parameters"), slice=name):
                pass
            case _:
                continue
        if isinstance(name, ast.Constant):
            yield [str(name.value)]
        elif isinstance(name, ast.JoinedStr):
            parts = [[part.value] if isinstance(part, ast.Constant) else _FILLINGS for part in name.values]
            yield ["".join(map(str, one)) for one in itertools.product(*parts)]


_FILLINGS = ["1", "X", "GYRO", "EK3", "CAL_ACC0_"]


def test_every_parameter_that_is_read_has_a_range() -> None:
    asked = [
        names for path in (ROOT / "companion").rglob("*.py") for names in _asked(ast.parse(path.read_text("utf-8")))
    ]
    assert len(asked) > 15
    assert not [names for names in asked if not any(map(range_of, names))]
    for sensor in ("gyro", "accel"):
        assert all(range_of(name) for instance in range(4) for name in id_parameters(sensor, instance))
