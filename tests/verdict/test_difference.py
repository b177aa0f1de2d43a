"""Two assessments held against one another, where it is known what differs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.comparison import GENERIC
from companion.model import Flight
from companion.strapdown import motions
from companion.verdict import Assessment, Finding, assess, contrast
from tests.flights import flight_of, seconds

pytestmark = pytest.mark.slow


def flight(gyro_bias: float = 0.0, *, noise: float = 0.0, seed: int = 0, duration: float = 60.0) -> Flight:
    """A circle flown with a constant gyro bias about down, rad/s, and white gyro noise of so many rad/s a sample."""
    ideal = flight_of(motions.circle(seconds(duration, 100)))
    track = ideal.imu("RAW_IMU")
    noisy = track.gyro + noise * np.random.default_rng(seed).normal(size=track.gyro.shape)
    return replace(ideal, imus={"RAW_IMU": replace(track, gyro=noisy + np.array([0.0, 0.0, gyro_bias]))})


def judged(one: Flight, **options: object) -> Assessment:
    return assess(one, GENERIC, horizons=(2.0, 5.0), **options)  # type: ignore[arg-type]


def test_a_bias_twice_as_large_is_twice_the_drift() -> None:
    found = contrast(judged(flight(0.01)), judged(flight(0.02)), same_flight=True)
    for row in found.rows:
        change = row.changes["attitude"]
        assert change.paired
        assert change.ratio == pytest.approx(2.0, rel=0.05)
        assert change.low == pytest.approx(change.high, rel=0.1), "the same in every window"
        assert change.direction == "worse"
    assert {quantity for _, quantity, _ in found.worse_than(0.5)} >= {"attitude"}
    assert found.worse_than(1.5) == []


@pytest.mark.parametrize(("bias", "differs"), [(0.012, False), (0.05, True)])
def test_a_figure_differs_when_both_fits_do_not_explain_it(bias: float, differs: bool) -> None:
    found = contrast(judged(flight(0.01)), judged(flight(bias)), same_flight=True)
    (gyro_z,) = (figure for figure in found.figures if figure.name == "gyro_bias_z")
    assert gyro_z.b - gyro_z.a == pytest.approx(bias - 0.01, rel=0.05)
    assert gyro_z.differs == differs
    assert [figure.name for figure in found.figures if figure.differs] == ["gyro_bias_z"] * differs


def test_the_other_way_round_is_better() -> None:
    a, b = judged(flight(0.01)), judged(flight(0.02))
    there, back = (contrast(*pair, same_flight=True).rows[0].changes["attitude"] for pair in ((a, b), (b, a)))
    assert there.ratio == pytest.approx(1 / back.ratio)
    assert (there.low, there.high) == pytest.approx((1 / back.high, 1 / back.low))
    assert back.direction == "better"
    assert not back.worse_than(0.0)


def test_a_flight_with_itself_is_the_same() -> None:
    a = judged(flight(0.01, noise=0.01))
    found = contrast(a, a, same_flight=True)
    for row in found.rows:
        assert {quantity: (c.ratio, c.low, c.high) for quantity, c in row.changes.items()} == dict.fromkeys(
            ("attitude", "velocity", "position"), (1.0, 1.0, 1.0)
        )
    assert found.worse_than(0.0) == []
    assert not found.gone
    assert not found.new
    assert not any(figure.differs for figure in found.figures)


def test_chance_is_not_called_a_change() -> None:
    """The same sensor twice, other noise: of the intervals, made for 95 %, nearly all have "unchanged" in them."""
    flights = [judged(flight(noise=0.02, seed=seed)) for seed in range(8)]
    changes = [
        contrast(a, b, same_flight=False).rows[0].changes["attitude"]
        for i, a in enumerate(flights)
        for b in flights[i + 1 :]
    ]
    assert sum(change.direction != "same" for change in changes) <= 4
    assert not any(change.paired for change in changes)


def test_too_few_windows_bound_nothing() -> None:
    short = judged(flight(0.01, duration=12.0))
    change = contrast(short, judged(flight(0.05, duration=12.0)), same_flight=False).rows[1].changes["attitude"]
    assert change.ratio == pytest.approx(5.0, rel=0.05)
    assert (change.low, change.high) == (0.0, np.inf)
    assert change.direction == "same"


def test_findings_of_one_alone() -> None:
    a = judged(flight())
    biased = Finding("gyro_bias", "imu", "error", 20.0, 30.0, "gyro z bias 15 mrad/s", "Calibrate it.")
    b = replace(a, verdict=replace(a.verdict, findings=(*a.verdict.findings, biased)))
    assert "gyro_bias" in {finding.kind for finding in contrast(a, b, same_flight=False).new}
    assert {finding.kind for finding in contrast(b, a, same_flight=False).gone} >= {"gyro_bias"}


def test_windows_that_one_lacks_are_left_out_of_the_pairs() -> None:
    whole = flight(0.01)
    track = whole.imu("RAW_IMU")
    gapped = replace(track, t=np.delete(track.t, slice(1000, 1100)), gyro=np.delete(track.gyro, slice(1000, 1100), 0),
                    accel=np.delete(track.accel, slice(1000, 1100), 0))  # fmt: skip
    found = contrast(judged(whole), judged(replace(whole, imus={"RAW_IMU": gapped})), same_flight=True)
    row = found.rows[0]
    assert row.b.windows < row.a.windows
    assert row.changes["attitude"].ratio == pytest.approx(1.0, abs=1e-3)
