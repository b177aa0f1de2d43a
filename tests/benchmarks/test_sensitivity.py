"""How much a verdict hangs on rates and noise: what is multiplied, where it has to act, and how changes are counted."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from benchmarks.accuracy.answer import Answer, Side
from benchmarks.accuracy.sensitivity import AS_IT_IS, VARIANTS, Row, changes, fault_rates, log_evidence, table
from companion.estimation import hypothesis_of, search
from companion.estimation.evidence import Trial
from companion.verdict import constant_faults

TENTH, TENFOLD, HALF = (name for name in VARIANTS if name != AS_IT_IS)


def step(signal: float) -> Trial:
    """A step of the gyro's x of so many σ, at a time that is known, as the search weighs it."""
    times = np.array([100.0]), np.array([np.inf]), np.array([1.0])
    information = 1e6 * np.eye(3)[None]
    gradient = signal * np.sqrt(information[:, 0])
    weigh: Callable[..., Trial] = vars(search)["trial"]
    return weigh(hypothesis_of("gyro_bias"), "step", times, (0.0, 200.0), gradient, information)


def odds(probability: float) -> float:
    return float(np.log(probability / (1.0 - probability)))


@pytest.mark.parametrize("times", [0.1, 10.0])
def test_rates_of_faults_shift_their_log_odds_and_leave_those_of_nuisances(times: float) -> None:
    fault, shock = step(20.0), hypothesis_of("gyro_shock")
    with fault_rates(times):
        assert fault.log_odds == pytest.approx(step(20.0).log_odds)
        scaled = fault.log_odds
        nuisance = shock.rate
    assert scaled - fault.log_odds == pytest.approx(np.log(times), abs=1e-6)
    assert nuisance == shock.rate


@pytest.mark.parametrize("times", [0.1, 10.0])
def test_the_share_of_imus_that_are_wrong_from_the_start_is_a_rate_too(times: float) -> None:
    error, own = np.array([0.05]), np.zeros(1)
    usual = constant_faults.fault_probabilities("gyro", error, 1e-3, own)[0]
    with fault_rates(times):
        scaled = constant_faults.fault_probabilities("gyro", error, 1e-3, own)[0]
    assert odds(scaled) - odds(usual) == pytest.approx(odds(0.01 * times) - odds(0.01), abs=0.05)
    assert constant_faults.fault_probabilities("gyro", error, 1e-3, own)[0] == usual


def test_half_the_evidence_is_half_the_logarithm_of_the_bayes_factor() -> None:
    whole = step(20.0)
    with log_evidence(0.5):
        half = step(20.0)
    np.testing.assert_allclose(half.log_bayes, 0.5 * whole.log_bayes)
    np.testing.assert_array_equal(half.size, whole.size)
    error, own = np.array([0.05]), np.zeros(1)
    before = constant_faults.fault_probabilities("gyro", error, 1e-3, own)[0]
    with log_evidence(0.5):
        after = constant_faults.fault_probabilities("gyro", error, 1e-3, own)[0]
    assert odds(after) - odds(0.01) == pytest.approx(0.5 * (odds(before) - odds(0.01)))


def row(log: str, variant: str, side: Side, cause: str = "", outcome: str | None = None) -> Row:
    return Row(log, "1/1", variant, Answer(side, cause), outcome)  # type: ignore[arg-type]


def test_changes_of_the_status_and_of_the_cause_alone_are_counted_apart() -> None:
    rows = [
        row("a", AS_IT_IS, "imu", "gyro_bias", "right"), row("a", TENTH, "cannot_tell", "", "missed"),
        row("a", TENFOLD, "imu", "gyro_scale", "right"), row("a", HALF, "imu", "gyro_bias", "right"),
        row("b", AS_IT_IS, "none", "", "right"), row("b", TENTH, "none", "", "right"),
        row("b", TENFOLD, "imu", "gyro_bias", "false alarm"),
        Row("b", "1/1", HALF, None, "unread", "ValueError: broken"),
        Row("c", "", TENTH, None, None, "no result within 1 s"),
    ]  # fmt: skip
    found = changes(rows)
    assert [(one.before.log, one.status) for one in found[TENTH]] == [("a", True)]
    assert [(one.before.log, one.status) for one in found[TENFOLD]] == [("a", False), ("b", True)]
    assert [str(one) for one in found[HALF]] == ["b 1/1: none → ValueError: broken [right → unread]"]
    shown = table(rows).splitlines()
    assert f"| {AS_IT_IS} | 2 |  |  | 2 of 2 |  |" in shown
    assert f"| {TENFOLD} | 2 | 1 | 1 | 1 of 2 | 1 |" in shown
    assert "  a 1/1: imu gyro_bias → cannot_tell [right → missed]" in shown
