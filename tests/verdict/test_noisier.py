"""An axis that becomes noisier for a while."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.model import Array, ImuTrack
from companion.verdict.findings.vibration import noisier_findings

T = np.arange(0.0, 120.0, 0.01)


def shaken(factor: Array, seed: int, *, instance: int = 0) -> ImuTrack:
    """White noise of 5 mrad/s and 0.1 m/s² that (N, 3) factors make more, on a vehicle that turns to and fro."""
    rng = np.random.default_rng(seed)
    turns = 0.5 * np.sin(T)[:, None] * [1.0, 2.0, 0.5]
    gyro = turns + 5e-3 * factor * rng.standard_normal((len(T), 3))
    accel = 0.1 * rng.standard_normal((len(T), 3)) - [0.0, 0.0, 9.8]
    return ImuTrack(T, np.round(gyro, 3), accel, "RAW_IMU", gyro_step=1e-3, instance=instance)


def during(begin: float, end: float, axes: tuple[int, ...], factor: float) -> Array:
    out = np.ones((len(T), 3))
    for axis in axes:
        out[(begin <= T) & (end > T), axis] = factor
    return out


def test_an_imu_in_order_is_not_noisier_by_chance() -> None:
    """Its noise may come and go with the motors, on all axes."""
    motors = 1.0 + 2.0 * (T > 20.0)[:, None] + 0.5 * np.sin(0.3 * T)[:, None] * np.ones(3)
    for seed in range(200):
        assert not list(noisier_findings(shaken(motors, seed), ()))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_axis_that_is_noisier_for_a_while_is_named(axis: int) -> None:
    (said,) = noisier_findings(shaken(during(50.0, 60.0, (axis,), 20.0), 1), ())
    assert said.evidence.startswith(f"gyro {'xyz'[axis]} is ")
    assert (said.start_s, said.end_s) == pytest.approx((50.0, 60.0), abs=2.1)


@pytest.mark.parametrize("axes", [(0, 1), (0, 1, 2)])
def test_axes_that_are_shaken_together_accuse_nobody(axes: tuple[int, ...]) -> None:
    assert not list(noisier_findings(shaken(during(50.0, 60.0, axes, 20.0), 2), ()))


def test_what_was_so_from_the_start_became_nothing() -> None:
    assert not list(noisier_findings(shaken(during(0.0, 10.0, (1,), 20.0), 3), ()))


@pytest.mark.parametrize("shakes", [True, False])
def test_only_an_imu_that_does_not_feel_it_makes_it_a_fault(*, shakes: bool) -> None:
    """A resonance about one axis is felt by both."""
    spoilt = during(50.0, 60.0, (1,), 20.0)
    other = replace(shaken(spoilt if shakes else np.ones((len(T), 3)), 5, instance=1), source="SCALED_IMU2")
    (alone,) = noisier_findings(shaken(spoilt, 4), ())
    (said,) = noisier_findings(shaken(spoilt, 4), (other,))
    assert (alone.severity, alone.undecided) == ("warning", True)
    assert (said.severity, said.undecided) == (("warning", True) if shakes else ("error", False))


def test_an_axis_beside_which_the_noisiest_becomes_quiet_is_in_order() -> None:
    """A rover shakes about the axis that it steers about, until it stops."""
    steering = during(0.0, 80.0, (2,), 20.0) * during(80.0, 120.0, (1,), 1.3)
    for seed in range(20):
        assert not list(noisier_findings(shaken(steering, seed), ()))
