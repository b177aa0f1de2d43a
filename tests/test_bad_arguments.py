"""What the public functions refuse, they refuse as CompanionError: arrays that are none, options out of range.

What they do take of another type than float64 gives the numbers that float64 gives.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import companion as c

N = 40
T = 0.1 * np.arange(N)
ZERO = np.zeros((N, 3))
DOWN = np.tile([0.0, 0.0, -10.0], (N, 1))
LEVEL = np.tile([1.0, 0.0, 0.0, 0.0], (N, 1))
START = {
    "t": 0.0, "q_ned_frd": np.array([1.0, 0.0, 0.0, 0.0]), "velocity": np.zeros(3), "position": np.zeros(3)
}  # fmt: skip

TRACKS: tuple[tuple[Callable[..., Any], dict[str, np.ndarray[Any, Any]]], ...] = (
    (c.ImuTrack, {"t": T, "gyro": ZERO, "accel": DOWN, "interval": np.full(N, 0.1)}),
    (c.AttitudeTrack, {"t": T, "q_ned_frd": LEVEL, "rates": ZERO}),
    (c.PositionTrack, {"t": T, "position": ZERO, "velocity": ZERO}),
    (lambda **arrays: c.Series(columns=("a", "b", "c"), **arrays), {"t": T, "values": ZERO}),
)

NO_ARRAYS: tuple[Callable[[np.ndarray[Any, Any]], object], ...] = (
    np.ndarray.tolist, lambda _: 1, lambda _: (), lambda _: "abc", lambda a: a.astype(object),
    lambda a: np.full(a.shape, None), lambda a: a.astype(str), lambda a: a.astype(complex), lambda a: a > 0,
    lambda a: np.zeros(a.shape, "datetime64[s]"), lambda a: a[1:], lambda a: a[..., None], lambda a: a[0],
    lambda a: a[None], lambda _: np.array(0.0), lambda a: a[:0],
)  # fmt: skip
"""An array → what is no such array: of another type, or of a shape that does not fit the others."""

TRACK_ARRAYS = [(make, arrays, name) for make, arrays in TRACKS for name in arrays]


@pytest.mark.parametrize("wrong", NO_ARRAYS)
@pytest.mark.parametrize(("make", "arrays", "name"), TRACK_ARRAYS)
def test_a_track_of_what_is_no_array(
    make: Callable[..., Any], arrays: dict[str, Any], name: str, wrong: Callable[[Any], object]
) -> None:
    make(**arrays)
    with pytest.raises(c.DataError, match=name):
        make(**arrays | {name: wrong(arrays[name])})


@pytest.mark.parametrize(
    ("make", "arrays", "name"), [row for row in TRACK_ARRAYS if row[2] not in ("interval", "values")]
)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_track_of_what_is_not_finite(
    make: Callable[..., Any], arrays: dict[str, Any], name: str, value: float
) -> None:
    spoiled = arrays[name].copy()
    spoiled[3] = value
    with pytest.raises(c.DataError, match=name):
        make(**arrays | {name: spoiled})


@pytest.mark.parametrize(("make", "arrays"), TRACKS)
@pytest.mark.parametrize("t", [T[::-1], np.zeros(N), np.where(T[5] == T, T[4], T)])
def test_times_that_do_not_increase(make: Callable[..., Any], arrays: dict[str, Any], t: object) -> None:
    with pytest.raises(c.DataError, match="increase strictly"):
        make(**arrays | {"t": t})


@pytest.mark.parametrize("name", START)
@pytest.mark.parametrize(
    "wrong", [None, "0", [0.0], np.full(3, np.nan), np.zeros(5), np.zeros(4, object), float("nan")]
)
def test_a_start_that_is_none(name: str, wrong: object) -> None:
    with pytest.raises(c.DataError, match=f"start.{name}"):
        c.dead_reckon(c.ImuTrack(T, ZERO, DOWN), c.NavState(**START | {name: wrong}))  # type: ignore[arg-type]


@pytest.mark.parametrize("dtype", [np.int16, np.uint8, np.int64, np.float32, np.float16, ">f8"])
def test_numbers_of_another_type_are_those_numbers(dtype: Any) -> None:
    """Integers and short floats: small whole numbers, which every type holds."""
    random = np.random.default_rng(1)
    t, gyro, accel = np.arange(N), random.integers(0, 2, (N, 3)), random.integers(0, 9, (N, 3))

    def of(kind: Any) -> c.Trajectory:
        start = {name: np.asarray(value).astype(kind) for name, value in START.items() if name != "t"}
        imu = c.ImuTrack(t.astype(kind), gyro.astype(kind), accel.astype(kind))
        return c.dead_reckon(imu, c.NavState(0.0, **start))

    given, exact = of(dtype), of(np.float64)
    np.testing.assert_allclose(given.q_ned_frd, exact.q_ned_frd, atol=1e-12)
    np.testing.assert_allclose(given.position, exact.position, rtol=1e-12)


@pytest.mark.parametrize("angle", ["abc", None, [None], np.array([1.0, None]), np.array(["a"]), 1j, np.zeros(3)])
@pytest.mark.parametrize("place", range(3))
def test_angles_that_are_none(angle: Any, place: int) -> None:
    angles: list[Any] = [np.zeros(2)] * 3
    angles[place] = angle
    with pytest.raises(c.DataError, match="roll|pitch|yaw"):
        c.from_euler(*angles)


@pytest.mark.parametrize(
    "q", [*(wrong(LEVEL) for wrong in NO_ARRAYS[:10]), np.zeros(3), np.zeros((4, 3)), np.array(1.0)]
)
def test_quaternions_that_are_none(q: Any) -> None:
    with pytest.raises(c.DataError, match="q_ned_frd"):
        c.to_euler(q)


@pytest.fixture(scope="module")
def flight() -> c.Flight:
    return c.open_log("demo")[0]


@pytest.mark.parametrize(
    "horizons",
    [(), 5, "1,5", None, (0,), (-1,), (np.nan,), (np.inf,), ("5",), [[1, 5]], [None], np.array([1.0, np.nan])],
)
def test_horizons_that_are_none(flight: c.Flight, horizons: Any) -> None:
    with pytest.raises(c.SettingsError, match="positive seconds"):
        c.drift(flight, horizons=horizons)


@pytest.mark.parametrize("period", [0, -1, np.nan, np.inf, "10", [10], np.array([10.0])])
def test_periods_that_are_none(flight: c.Flight, period: Any) -> None:
    with pytest.raises(c.SettingsError, match="positive seconds"):
        c.replay(flight, reanchor_s=period)


@pytest.mark.parametrize("step", [0, -1, 1.5, np.nan, "1", None, np.array([1])])
def test_steps_that_are_none(flight: c.Flight, step: Any) -> None:
    with pytest.raises(c.SettingsError, match="one sample or more"):
        c.rpe(c.replay(flight), step)


@pytest.mark.parametrize(
    "make",
    [
        lambda: c.Integration(gravity=np.nan),
        lambda: c.Integration(gravity="normal"),  # type: ignore[arg-type]
        lambda: c.Limits(gap_s=np.nan),
        lambda: c.Limits(gap_periods="3"),  # type: ignore[arg-type]
        lambda: c.Limits(position_jump_m=-1.0),
    ],
)
def test_ways_to_integrate_that_are_none(make: Callable[[], object]) -> None:
    with pytest.raises(c.SettingsError, match="must be finite"):
        make()


@pytest.mark.parametrize("options", [{"method": "rk5"}, {"middle": None}, {"segments": 0}, {"segments": 1.5}])
def test_methods_that_are_none(flight: c.Flight, options: dict[str, Any]) -> None:
    with pytest.raises(c.SettingsError):
        c.drift(flight, how=c.Integration(**options))


def test_an_anchor_that_is_none(flight: c.Flight) -> None:
    with pytest.raises(c.SettingsError, match="anchor"):
        c.examine(flight, anchor="moon")
