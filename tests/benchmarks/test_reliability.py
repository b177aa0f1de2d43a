"""The reliability table: what was stated against what was right."""

from __future__ import annotations

from benchmarks.accuracy.reliability import reliability


def test_each_claim_is_counted_once_and_those_without_a_probability_apart() -> None:
    claims = [("a", 0.97, True), ("a", 0.96, False), ("b", 1.0, True), ("b", 0.3, False), ("c", None, True)]
    shown = reliability(claims).splitlines()
    assert "| 0.95-0.99 | 2 | 0.965 | 0.500 |" in shown
    assert "| 0.99-1.00 | 1 | 1.000 | 1.000 |" in shown
    assert "| 0.30-0.40 | 1 | 0.300 | 0.000 |" in shown
    assert "| none | 1 | | 1.000 |" in shown
    assert shown[-2:] == ["| a | 2 | 0.500 |", "| b | 1 | 1.000 |"]
