"""The log evidence of a hypothesis against direct integration, and the probabilities that it leads to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from companion.constants.priors import ACCUSED
from companion.estimation import HYPOTHESES, Rival, hypothesis_of, probabilities, smooth
from companion.estimation.evidence import Trial, joined, kept, least_found, trial
from companion.estimation.hypotheses import SECANTS
from companion.model import Array
from tests.estimation import sensed as sensed_flights

HOUR = (0.0, 3600.0)


def tried(b: Array, v: Array, onset: Array | None = None, kind: str = "gyro_bias", shape: str = "step") -> Trial:
    """At some onsets, each standing for an even part of an hour's flight."""
    count = len(b)
    when = np.linspace(600.0, 3000.0, count) if onset is None else onset
    weight = np.full(count, 1.0 / count)
    return trial(hypothesis_of(kind), shape, (when, np.full(count, np.inf), weight), HOUR, b, v)


def test_the_evidence_of_one_component_is_its_integral() -> None:
    """∫ exp(b u - ½ V u²) N(u; 0, σ²) du, by quadrature."""
    kind = hypothesis_of("gps_latency")
    b, v = np.array([[40.0]]), np.array([[[900.0]]])
    u = np.linspace(-4.0, 4.0, 200_001)
    for column, sigma in ((0, kind.harmful("step") / 5.0), (1, kind.prior)):
        integral = np.trapezoid(np.exp(b[0, 0] * u - 0.5 * v[0, 0, 0] * u**2) * norm.pdf(u, scale=sigma), u)
        assert tried(b, v, kind="gps_latency").log_bayes[0, column] == pytest.approx(np.log(integral), rel=1e-6)


@pytest.mark.parametrize("size", [0.3, 0.7, 1.0, 1.2])
def test_the_evidence_about_several_sizes_is_the_integral_over_all(size: float) -> None:
    """Where the columns are the same about every size: but for what flat parts differ from a normal prior."""
    row, information = hypothesis_of("gps_latency"), 400.0
    b, v = np.array([[information * size]]), np.array([[[information]]])
    u = np.linspace(-4.0, 4.0, 200_001)
    integral = np.trapezoid(np.exp(b[0, 0] * u - 0.5 * information * u**2) * norm.pdf(u, scale=row.prior), u)
    times = np.array([600.0]), np.array([np.inf]), np.ones(1)
    parts = [trial(one, "step", times, HOUR, b, v) for one in SECANTS]
    each = np.array([one.log_bayes[0] for one in parts])
    assert np.logaddexp.reduce(each[:, 1]) == pytest.approx(np.log(integral), abs=1.5)
    assert (each[:, 0] < -1e5).all(), "what is about a size is none of what parts in order show"
    best = max(parts, key=lambda one: float(one.log_bayes.max()))
    assert best.size[0, 0] == pytest.approx(size, rel=0.1)
    assert parts[-1].log_bayes[0, 1] < best.log_bayes[0, 1] - 2.0, "what is made about 2 s speaks for what is near it"


def test_the_evidence_of_several_is_that_of_all_or_of_one_alone() -> None:
    rng = np.random.default_rng(2)
    root = rng.normal(size=(3, 3)) * 300.0
    v, b = (root @ root.T)[None], rng.normal(size=(1, 3)) * 900.0
    sigma = hypothesis_of("gyro_bias").prior
    with_all = multivariate_normal(np.zeros(3), v[0] + sigma**2 * v[0] @ v[0]).logpdf(b[0])
    ratios = [with_all - multivariate_normal(np.zeros(3), v[0]).logpdf(b[0]) - np.log(2.0)]
    for i in range(3):
        own = v[0, i, i]
        one = norm.logpdf(b[0, i], scale=np.sqrt(own + sigma**2 * own**2)) - norm.logpdf(b[0, i], scale=np.sqrt(own))
        ratios.append(one - np.log(6.0))
    assert tried(b, v).log_bayes[0, 1] == pytest.approx(np.logaddexp.reduce(ratios), rel=1e-6)


def test_times_are_integrated_and_not_chosen() -> None:
    """Splitting the cells of a grid changes nothing; an hour of nothing beside a peak costs as many cells."""
    b, v = np.array([[0.0, 0.0, 30.0]]), np.eye(3)[None] * 100.0**2
    one = tried(b, v)
    many = tried(np.repeat(b, 7, axis=0), np.repeat(v, 7, axis=0))
    assert many.log_odds == pytest.approx(one.log_odds)
    everywhere = joined([one, tried(np.zeros((7, 3)), np.repeat(v, 7, axis=0))])
    assert kept(everywhere, np.arange(8) == 0).log_odds == pytest.approx(one.log_odds)


@pytest.mark.parametrize(("size", "harmful"), [(0.0, False), (2e-3, False), (12e-3, True)])
def test_small_sizes_are_nuisances_and_large_ones_faults(size: float, harmful: bool) -> None:
    v = np.eye(3)[None] / 3e-4**2
    one = tried(v @ [0.0, size, 0.0], v)
    assert (one.fault > ACCUSED) == harmful
    assert one.fault > ACCUSED or one.fault < 0.05


def test_what_is_never_a_fault_accuses_nobody() -> None:
    shock = tried(np.array([[900.0, 0.0, 0.0]]), np.eye(3)[None] * 1e4, kind="gyro_shock", shape="shock")
    assert shock.log_odds > 10.0
    assert shock.fault == 0.0
    assert probabilities([Rival("gyro_shock", "shock", shock.log_odds, shock.fault)])["nobody"] == pytest.approx(1.0)


def test_probabilities_are_those_of_exclusive_hypotheses() -> None:
    rivals = [Rival("gyro_bias", "step", np.log(70.0), 1.0), Rival("gyro_scale", "step", np.log(29.0), 1.0)]
    found = probabilities(rivals)
    assert sum(found.values()) == pytest.approx(1.0)
    assert found["imu"] == pytest.approx(0.99)
    assert found["nobody"] == pytest.approx(0.01)
    assert set(found) == {"nobody", *(kind.device for kind in HYPOTHESES)}


@pytest.mark.parametrize("odds", [(10.0, 10.0, 0.0), (14.0, 9.0, 2.0), (20.0, 13.5, 12.0), (2.0, -1.0, 0.0)])
def test_whose_fault_it_is_is_averaged_over_rates_known_to_an_order_of_magnitude(
    odds: tuple[float, float, float],
) -> None:
    """Where two explain the readings alike their rates alone accuse neither; that there is a fault stays as likely."""
    kinds = ("gyro_bias", "compass_field", "gps_position")
    found = probabilities([Rival(kind, "step", one, 1.0) for kind, one in zip(kinds, odds, strict=True)])
    drawn = np.array(odds) + np.log(10.0) * np.random.default_rng(2).standard_normal((400_000, 3))
    shares = (np.exp(drawn) / np.exp(drawn).sum(axis=1, keepdims=True)).mean(axis=0)
    assert found["nobody"] == pytest.approx(1.0 / (1.0 + np.exp(odds).sum()))
    expected = (1.0 - found["nobody"]) * shares
    assert [found[device] for device in ("imu", "compass", "gps")] == pytest.approx(expected, abs=0.01)


def test_a_fault_of_the_detectable_size_is_accused_in_95_of_100_draws() -> None:
    """Score statistics drawn with a fault of that size: b ~ N(V u, V)."""
    rng, kind, cell = np.random.default_rng(5), hypothesis_of("gyro_bias"), 1e-3
    v = np.eye(3) / 3e-3**2
    size = float(least_found(np.diag(v), kind, "step", 1.0, cell)[0])
    drawn = v @ [0.0, 0.0, size] + rng.multivariate_normal(np.zeros(3), v, size=400)
    found = []
    for b in drawn:
        one = trial(kind, "step", (np.array([1800.0]), np.array([np.inf]), np.array([cell])), HOUR, b[None], v[None])
        found.append(probabilities([Rival(kind.name, "step", one.log_odds, one.fault)])["imu"] > ACCUSED)
    assert 0.92 < np.mean(found) < 0.985


def test_no_shock_is_found_where_rounding_is_all_that_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """At rest a gyro without noise is known so well that what else tells of a shock is lost in rounding."""
    monkeypatch.setattr(sensed_flights, "NOISE", (1e-7, 1e-5))
    flight = replace(sensed_flights.sensed(120.0, "rest", rate=50.0)[0], gps=())
    imu = flight.imu()
    during = (imu.t > 70.0) & (imu.t < 90.0)
    off = sensed_flights.with_imu(flight, replace(imu, gyro=imu.gyro + np.outer(during, [0.0, 0.0, 0.02])))
    best = smooth(off)
    assert best.explained
    assert not any(one.kind.endswith("_shock") for one in best.explained)
