"""The log evidence of a hypothesis: how much likelier it makes the readings, its size and its times integrated out.

At the solution without it, with b = Sᵀ W r and V = Sᵀ W S (W: the smoother's whitening, states marginalised), a size
u ~ N(0, σ² I) at known times multiplies the likelihood by exp ℓ,

    ℓ = ½ bᵀ (V + σ⁻² I)⁻¹ b - ½ log |I + σ² V|

(R. E. Kass, A. E. Raftery 1995; P. J. G. Teunissen 2018 for the statistic). Sizes are a mixture of two scales, small
and frequent (nuisances, which parts in order show too) and large and rare (faults), of all components or of one alone.
Times are integrated over a grid that is refined about its peak.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.constants import harm, num, priors
from companion.estimation.hypotheses import HYPOTHESES, Hypothesis, hypothesis_of
from companion.estimation.model import Rival
from companion.estimation.shapes import SLOPED
from companion.model import Array
from companion.noise import Aliased


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """One hypothesis in one shape, at every pair of times that was tried; of D data sets at once, (T, ..., D)."""

    hypothesis: Hypothesis
    shape: str
    onset: Array  # (T,) s
    end: Array  # (T,) s, of what ends; infinite for what stays
    weight: Array  # (T,) prior probability that it begins and ends within the cell about these times, if it occurs
    log_bayes: Array  # (T, 2) of a nuisance and of a fault at these times against nothing, rates not counted
    size: Array  # (T, m) of a fault
    sigma: Array  # (T,) 1σ of its length
    axis: npt.NDArray[np.intp]  # (T,) the one component that changes; -1 for all
    flight: tuple[float, float]  # s, its first and last keyframe
    imu: int | None = None  # the IMU whose it is; None for that of the estimate, and for what is no IMU's

    @property
    def best(self) -> int:
        """The times that are likeliest, whatever the width of their cell."""
        return int(np.argmax(self.log_bayes.max(axis=1)))

    @property
    def log_odds(self) -> float:
        """Posterior odds that it occurred, against that nothing did: rate, sizes and times integrated."""
        return float(self.log_odds_of_each)

    @property
    def log_odds_of_each(self) -> Array:
        """The same of every data set (D,)."""
        return np.asarray(_log_sum(self.cells, axis=(0, 1)))

    @property
    def worth_trying(self) -> bool:
        """Whether an estimate with it may show a fault, or take out what disturbs the others."""
        return bool(_log_sum(self.cells[:, 1]) > priors.CANDIDATE or self.log_odds > priors.LIKELY_NUISANCE)

    @property
    def fault(self) -> float:
        """Probability, if it occurred, that its size is harmful."""
        return float(self.fault_of_each)

    @property
    def fault_of_each(self) -> Array:
        """The same of every data set (D,)."""
        cells = self.cells
        at = np.exp(cells[:, 1] - _log_sum(cells, axis=(0, 1)))
        counts = at > num.NEGLIGIBLE
        beyond = np.zeros_like(at)
        beyond[counts] = _normal(self._above_harm()[counts])
        return np.asarray((at * beyond).sum(axis=0))

    @property
    def onset_sigma(self) -> float:
        """1σ of the onset about the likeliest, s."""
        cells = _log_sum(self.cells, axis=1)
        at = np.exp(cells - _log_sum(cells))
        return float(np.sqrt(at @ (self.onset - self.onset[self.best]) ** 2))

    @property
    def cells(self) -> Array:
        """(T, 2) posterior log odds of a nuisance and of a fault at these times against nothing."""
        with np.errstate(divide="ignore"):
            usual = self.hypothesis.rate if self.hypothesis.nuisance else priors.NUISANCES_PER_H
            hours = (self.flight[1] - self.flight[0]) / num.HOUR_S
            rates = np.array([usual / len(self.hypothesis.shapes), self.hypothesis.rate_of(self.shape)]) * hours
            prior = np.log(self.weight)[:, None] + np.log(rates)
            return np.asarray((prior if self.log_bayes.ndim == 2 else prior[..., None]) + self.log_bayes)

    def _above_harm(self) -> Array:
        """(T,) by how many σ the size of a fault is more than what is harmful."""
        reached = grows_for(self.shape, self.onset, self.end, self.flight[1])
        least = harmful(self.hypothesis, self.shape, self.imu) / reached
        length = np.sqrt((self.size**2).sum(axis=1))
        return np.asarray((length.T - least).T / np.maximum(self.sigma, 1e-300))


def harmful(hypothesis: Hypothesis, shape: str, imu: int | None) -> float:
    """The size from which on it is a fault; of another IMU than the estimate's, beside which alone it shows."""
    return hypothesis.harmful(shape) if imu is None else max(hypothesis.harmful(shape), hypothesis.min_between_imus)


def grows_for(shape: str, onset: Array, end: Array, last: float, least: float = 1.0) -> Array:
    """(T,) s that a size per second grows for, in a flight until `last`, `least` s or more; 1 for what is no ramp."""
    if shape not in SLOPED:
        return np.ones(len(onset))
    return np.maximum(np.minimum(end, last) - onset, least)


def trial(
    hypothesis: Hypothesis,
    shape: str,
    times: tuple[Array, Array, Array],
    flight: tuple[float, float],
    b: Array,
    v: Array,
    aliased: Aliased | None = None,
    imu: int | None = None,
) -> Trial:
    """The evidence at times (onset, end, weight of the cell), each (T,), from gradients b (T, m) and V (T, m, m).

    Of D data sets b is (T, m, D).
    flight: its first and last keyframe, s. aliased: what sampling makes of motion that is faster.
    """
    onset, end, weight = times
    reached = grows_for(shape, onset, end, flight[1])
    over = grows_for(shape, onset, end, flight[1], priors.RAMP_S)  # s in which a likely size is reached
    v, each = 0.5 * (v + v.swapaxes(-1, -2)), b if b.ndim > 2 else b[..., None]
    known = np.linalg.eigh(v)
    scored = _about_size(hypothesis, each, v, known) if hypothesis.about_size else None
    large, size, sigma, axis = scored or _of_scale(each, v, known, hypothesis.prior / over)
    never = np.full_like(large, num.LOG_ZERO)
    if hypothesis.about_size:
        small = never
    elif hypothesis.nuisance:
        small, large = large, never
    else:
        usual = np.full(len(onset), harm.NUISANCE * harmful(hypothesis, shape, imu))
        if aliased is not None:
            usual = np.maximum(usual, aliased.sigma(np.minimum(end, flight[1]) - onset))
        small, *_ = _of_scale(each, v, known, usual / over)
    possible = np.abs(size).max(axis=1) * reached[:, None] <= hypothesis.max_plausible
    log_bayes = np.stack([np.where(possible, one, num.LOG_ZERO) for one in (small, large)], axis=1)
    sets = slice(None) if b.ndim > 2 else 0
    scores = log_bayes[..., sets], size[..., sets], sigma[..., sets], axis[..., sets]
    return Trial(hypothesis, shape, onset, end, weight, *scores, flight, imu)


def fault_of_size(kind: str, size: Array, sigma: float, flight: tuple[float, float], imu: int | None) -> float:
    """Probability, if it occurred, that a size (m,) of a kind that is known to sigma is harmful, and no nuisance.

    Of what was found in several parts, each of which may be harmless.
    """
    return _of_size(kind, size, sigma, flight, imu).fault


def change_probability(kind: str, size: float, sigma: float, flight: tuple[float, float]) -> float:
    """Probability that what changed by a size, known to sigma, some time in a flight (s) is a fault of a kind."""
    one = _of_size(kind, np.array([size]), sigma, flight, None)
    return probabilities([Rival(kind, "step", one.log_odds, one.fault)])[one.hypothesis.device]


def _of_size(kind: str, size: Array, sigma: float, flight: tuple[float, float], imu: int | None) -> Trial:
    onset, end, weight = np.array([flight[0]]), np.array([np.inf]), np.ones(1)
    information = np.maximum(sigma, 1e-300) ** -2.0
    b, v = information * size[None], information * np.eye(len(size))[None]
    return trial(hypothesis_of(kind), "step", (onset, end, weight), flight, b, v, imu=imu)


def _of_scale(
    b: Array, v: Array, known: tuple[Array, Array], sigma: Array
) -> tuple[Array, Array, Array, npt.NDArray[np.intp]]:
    """Log evidence (T, D) of sizes with 1σ (T,), of b (T, m, D) and v (T, m, m); known: eigenvalues and vectors of v.

    And the size (T, m, D), 1σ of its length (T, D), and the one component or -1 (T, D).
    """
    m = v.shape[-1]
    prior = sigma**-2.0
    values, vectors = np.maximum(known[0], 0.0) + prior[:, None], known[1]  # below zero it is rounding
    covariance = (vectors / values[:, None, :]) @ vectors.swapaxes(-1, -2)
    size = covariance @ b
    length = np.sqrt((size * (covariance @ size)).sum(axis=1) / np.maximum((size**2).sum(axis=1), 1e-300))
    whole = 0.5 * ((b * size).sum(axis=1) - np.log(values / prior[:, None]).sum(axis=1)[:, None])
    if m == 1:
        return whole, size, length, np.full(whole.shape, -1, np.intp)
    own = (np.maximum(np.diagonal(v, axis1=1, axis2=2), 0.0) + prior[:, None])[..., None]
    alone = 0.5 * (b**2 / own - np.log(own / prior[:, None, None]))
    axis = alone.argmax(axis=1)
    single = alone.max(axis=1) - np.log(m) > whole
    this = axis[:, None] == np.arange(m)[:, None]
    mixed = _log_sum(np.concatenate([whole[:, None] - np.log(2.0), alone - np.log(2.0 * m)], axis=1), axis=1)
    size = np.where(single[:, None], np.where(this, b / own, 0.0), size)
    length = np.where(single, np.take_along_axis(own[..., 0], axis, axis=1) ** -0.5, length)
    return np.asarray(mixed), size, length, np.where(single, axis, -1)


def _about_size(
    hypothesis: Hypothesis, b: Array, v: Array, known: tuple[Array, Array]
) -> tuple[Array, Array, Array, npt.NDArray[np.intp]]:
    """The same of sizes nearer to the one that columns are made about than to the next: as likely as all of these.

    With u = s + d the gain b u - ½ V u² is that of s and (b - V s) d - ½ V d².
    """
    s, apart = hypothesis.about_size, num.LATENCIES_RATIO
    low, high = s / math.sqrt(apart), s * math.sqrt(apart)
    within = np.diff(_normal(np.array([low, high]) / hypothesis.prior)).item()
    rest = b - s * v[:, 0, :, None]
    near = np.full(len(v), (high - low) / math.sqrt(12.0))
    log_bayes, d, sigma, axis = _of_scale(rest, v, known, near)
    return log_bayes + s * b[:, 0] - 0.5 * s**2 * v[:, 0] + math.log(within), s + d, sigma, axis


def _log_sum(values: Array, axis: int | tuple[int, ...] | None = None) -> Any:
    """The logarithm of the sum of exponentials."""
    most = np.max(values, axis=axis, keepdims=True)
    most = np.where(np.isfinite(most), most, 0.0)
    with np.errstate(divide="ignore"):
        total = np.log(np.exp(values - most).sum(axis=axis, keepdims=True)) + most
    return total.squeeze(axis=axis)


def _normal(z: Array) -> Array:
    """The cumulative normal distribution, of any shape."""
    return np.array([0.5 * math.erfc(-value / math.sqrt(2.0)) for value in z.ravel().tolist()]).reshape(z.shape)


_BY_TIME = ("onset", "end", "weight", "log_bayes", "size", "sigma", "axis")


def joined(parts: Sequence[Trial]) -> Trial:
    """One hypothesis at the times of all parts, one or more."""
    together: dict[str, Any] = {name: np.concatenate([getattr(p, name) for p in parts]) for name in _BY_TIME}
    return replace(parts[0], **together)


def kept(one: Trial, which: npt.NDArray[np.bool_]) -> Trial:
    """The same at some of its times alone."""
    some: dict[str, Any] = {name: getattr(one, name)[which] for name in _BY_TIME}
    return replace(one, **some)


def least_found(
    information: Array, hypothesis: Hypothesis, shape: str, hours: float, cell: float, reached: float = 1.0
) -> Array:
    """(T,) the size that is accused in 95 % of flights, of components known with information (T,) each.

    With signal s √V the test statistic is N(s √V, 1)²: its 5 % quantile has to reach what odds of 19 to 1 ask for
    (the minimal detectable bias, W. Baarda 1968). And its size, known to 1 / √V, has to be surely harmful with 95 %,
    in 95 % of flights. cell: prior probability of the times about an onset. reached: of what grows, how much of a unit.
    """
    sigma = hypothesis.prior / reached
    threshold = 2.0 * (priors.ACCUSED_ODDS - np.log(hypothesis.rate_of(shape) * hours * cell) + np.log(6.0))
    threshold = np.maximum(threshold + np.log1p(information * sigma**2), 0.0)
    known = 1.0 / np.sqrt(np.maximum(information, 1e-300))
    harmful = hypothesis.harmful(shape) / reached + 2.0 * num.Z_95 * known
    return np.asarray(np.maximum((np.sqrt(threshold) + num.Z_95) * known, harmful))


def probabilities(rivals: Sequence[Rival]) -> dict[str, float]:
    """Device → probability that a harmful fault of it is the cause; "nobody" for none, or for what is no fault."""
    odds = np.array([one.log_odds for one in rivals])
    faults = np.array([one.fault for one in rivals])
    each = probabilities_of_each([hypothesis_of(one.kind) for one in rivals], odds, faults)
    return {device: float(share) for device, share in each.items()}


def probabilities_of_each(hypotheses: Sequence[Hypothesis], log_odds: Array, fault: Array) -> dict[str, Array]:
    """The same of D data sets, (D,) each, from the log odds (H, D) of hypotheses and how likely they are harmful.

    How often anything goes wrong is known far better than how often which device does. So that there is a fault has the
    probability that the rates of the table give, and whose it is one that is averaged over rates which are known to an
    order of magnitude: where two devices explain the readings alike, the rates alone accuse neither.
    """
    odds = np.concatenate([np.zeros((1, *log_odds.shape[1:])), log_odds])
    posterior = np.exp(odds - _log_sum(odds, axis=0))[1:] * fault
    shares = dict.fromkeys((one.device for one in HYPOTHESES), np.zeros(log_odds.shape[1:]))
    for hypothesis, part in zip(hypotheses, posterior, strict=True):
        shares[hypothesis.device] = shares[hypothesis.device] + part
    whose = _of_uncertain_rates(np.array(list(shares.values())))
    each = dict(zip(shares, np.minimum(whose, 1.0), strict=True))  # rounding
    return {"nobody": np.maximum(1.0 - whose.sum(axis=0), 0.0), **each}


def _of_uncertain_rates(shares: Array) -> Array:
    """Probabilities (device, ...) of faults, shared out anew over rates of the devices, as well as these are known."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(priors.RATE_NODES)
    grid = np.stack(np.meshgrid(*[priors.DEVICE_RATE_SIGMA * nodes] * len(shares), indexing="ij"), axis=-1)
    weight = np.stack(np.meshgrid(*[weights / weights.sum()] * len(shares), indexing="ij"), axis=-1).prod(axis=-1)
    factors = np.exp(grid.reshape(-1, len(shares)))  # (nodes, device)
    at = factors.reshape(*factors.shape, *[1] * (shares.ndim - 1)) * shares
    total = at.sum(axis=1, keepdims=True)
    part = np.divide(at, total, out=np.zeros_like(at), where=total > 0.0)
    return np.asarray(np.tensordot(weight.ravel(), part, axes=1) * shares.sum(axis=0))
