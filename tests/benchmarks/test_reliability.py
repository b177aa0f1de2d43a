"""The reliability table: what was stated against what was right."""

from __future__ import annotations

import numpy as np

from benchmarks.accuracy.reliability import EDGES, Claim, reliability


def test_each_claim_is_counted_once_and_those_without_a_probability_apart() -> None:
    claims = [
        Claim("a", 0.97, True),
        Claim("a", 0.96, False, accuses=False),
        Claim("b", 1.0, True),
        Claim("b", 0.3, False),
        Claim("c", None, True),
    ]
    shown = reliability(claims).splitlines()
    assert "| 0.95-0.99 | 2 | 0.965 | 0.500 |" in shown
    assert "| 0.99-1.00 | 1 | 1.000 | 1.000 |" in shown
    assert "| 0.30-0.40 | 1 | 0.300 | 0.000 |" in shown
    assert "| none | 1 | | 1.000 |" in shown
    assert "| a | 2 | 0.500 |" in shown
    assert "| b | 1 | 1.000 |" in shown
    assert shown[-1].endswith("; accusations 2 of 2, nobody 0 of 1")


def test_verdicts_that_are_right_as_often_as_stated_lie_on_the_diagonal() -> None:
    rng = np.random.default_rng(0)
    stated = rng.uniform(0.0, 1.0, 100_000)
    right = rng.uniform(0.0, 1.0, 100_000) < stated
    shown = reliability(
        Claim(f"v{i % 7}", float(p), bool(good)) for i, (p, good) in enumerate(zip(stated, right, strict=True))
    )
    rows = [line.strip("| ").split(" | ") for line in shown.splitlines() if line.startswith("| 0.")]
    assert len(rows) == len(EDGES) - 1
    for (label, count, mean, share), low, high in zip(rows, EDGES[:-1], EDGES[1:], strict=True):
        own = (stated >= low) & (stated < high)
        assert int(count) == own.sum(), label
        assert low <= float(mean) < high
        assert abs(float(share) - float(mean)) < 4.0 * np.sqrt(0.25 / own.sum()) + 1e-3, label


def test_vehicles_of_which_too_few_sure_verdicts_were_right_are_named() -> None:
    claims: list[Claim] = []
    claims += [Claim("good", 0.99, True)] * 19 + [Claim("good", 0.99, False)]
    claims += [Claim("edge", 0.95, True)] * 9 + [Claim("edge", 0.95, False)]
    claims += [Claim("bad", 0.97, True)] * 8 + [Claim("bad", 0.97, False)] * 2 + [Claim("unsure", 0.6, False)] * 5
    summary = reliability(claims).splitlines()[-1]
    assert (
        summary
        == "Verdicts stated >= 0.95: 40, right in 90.0%; right in less than 90%: bad (8 of 10); accusations 36 of 40"
    )
    good = reliability(claims[:20]).splitlines()[-1]
    assert good == "Verdicts stated >= 0.95: 20, right in 95.0%; right in less than 90%: none; accusations 19 of 20"


def test_without_a_sure_verdict_there_is_no_share() -> None:
    assert (
        reliability([Claim("a", 0.5, True), Claim("a", None, True)]).splitlines()[-1] == "Verdicts stated >= 0.95: none"
    )
    assert reliability([]).splitlines()[-1] == "Verdicts stated >= 0.95: none"
