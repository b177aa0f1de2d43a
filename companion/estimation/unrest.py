"""When an IMU scatters more than in the rest of the flight, as where shaking is folded down by its samples.

A fault has a size, and a beginning; shaking has neither. Where the IMU fits the witnesses badly for a while, both are
possible: that it is off by so much, or that its noise is so much larger. The one is compared with the other by their
likelihoods, whatever the states were; else a witness would be accused of the motion that the IMU made up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from companion.estimation.choice import SHARPEST_S, Choice
from companion.estimation.linearisation import Linear
from companion.estimation.model import ATTITUDE, VELOCITY, Explained
from companion.estimation.setup import Setup
from companion.estimation.system import evidence, solve
from companion.model import Array
from companion.strapdown import MOVED

SENSORS = ("gyro", "accel")  # in the order of the columns of `Setup.restless`
_BLOCKS = (ATTITUDE, VELOCITY)
_CUTS = 96  # between which it may begin and end
_PRICE = 4.0 * float(np.log(_CUTS))  # of both
_TIMES = (1.0, 1.4, 2.0, 2.8)  # what is tried, of what the scatter alone says
_SHORTEST_S = 2.0  # what lasts for less is a shock
_UNDERTOLD = 30.0  # times more than at first order may be gained, 26 at most in ten logs with faults
_LOUDER = 2.0  # twice the logarithm of the likelihood ratio, for which its size is corrected


@dataclass(frozen=True, slots=True)
class Unrest:
    """A time in which a sensor of the IMU scatters more than in the rest of the flight."""

    sensor: str  # "gyro" or "accel"
    begin: float  # s
    end: float  # s
    times: float  # by which its density is larger
    gain: float = 0.0  # twice the logarithm of the likelihood ratio

    def explained(self, instead_of: Choice) -> Explained:
        """As what was explained: by what it was explained instead, is the next best."""
        other = (instead_of.kind.name, instead_of.shape, instead_of.gain)
        return Explained(f"{self.sensor}_unrest", "pulse", self.begin, SHARPEST_S, self.end, np.array([self.times]),
                         np.zeros(1), self.gain, (other, *instead_of.others))  # fmt: skip


def restless(linear: Linear, least: float) -> Unrest | None:
    """The time in which one sensor's noise was larger, if that explains more than `least`; None if it does not.

    least: twice the logarithm of a likelihood ratio, as explanations gain.
    """
    tried = [one for column in range(len(SENSORS)) for one in _tried(linear, column, least)]
    if not tried:
        return None
    usual = evidence(linear.solution, linear.measurements, linear.prior)
    weighed = (replace(one, gain=_evidence(linear, one) - usual - _PRICE) for one in tried)
    best = max(weighed, key=lambda one: one.gain, default=None)
    return best if best is not None and best.gain > least else None


def louder(linear: Linear, one: Unrest) -> float:
    """By how much larger its noise is yet, in a problem that has it: what else is noise was learned with it before."""
    usual = evidence(linear.solution, linear.measurements, linear.prior)
    more = {times: _evidence(linear, replace(one, times=times)) - usual for times in _TIMES[1:]}
    best = max(more, key=lambda times: more[times])
    return best if more[best] > _LOUDER else 1.0


def with_unrest(setup: Setup, one: Unrest) -> Setup:
    """The problem with a larger noise in that time."""
    times = setup.restless.copy()
    times[_within(setup.t, one), SENSORS.index(one.sensor)] *= one.times
    return replace(setup, restless=times)


def _tried(linear: Linear, column: int, least: float) -> list[Unrest]:
    """The time in which the disturbances of a sensor exceed most what is usual, with some densities for it.

    Of n independent disturbances whose squares are s times what they should be, n (s - 1 - ln s) is gained. Nothing is
    tried of which this promises far less than `least`.
    """
    t, block, cause = linear.problem.t, _BLOCKS[column], f"{SENSORS[column]}_noise"
    e, d = linear.solution.disturbances
    first = block.start - MOVED[cause].start
    v = linear.noise.density(cause) ** 2 * linear.sums[cause][:, first : first + 3, first : first + 3]
    above = np.einsum("ki,kij,kj->k", e[:, block], v, e[:, block])
    below = np.einsum("kij,kij->k", d[:, block, block], v)
    cuts = np.unique(np.linspace(0, len(above), _CUTS + 1).round().astype(np.intp))
    begin, end = (cuts[i] for i in np.triu_indices(len(cuts), 1))
    long = t[end] - t[begin] >= _SHORTEST_S
    begin, end = begin[long], end[long]
    above, n = (np.concatenate([[0.0], np.cumsum(x)])[end] - np.concatenate([[0.0], np.cumsum(x)])[begin]
                for x in (above, below))  # fmt: skip
    larger = np.maximum(above, 1e-9) / np.maximum(n, 1e-9)
    gain = np.where(larger > 1.0, n * (larger - 1.0 - np.log(larger)), 0.0)
    i = int(np.argmax(gain)) if len(gain) else 0
    if not (gain[i : i + 1] > least / _UNDERTOLD).any():
        return []
    return [
        Unrest(SENSORS[column], float(t[begin[i]]), float(t[end[i]]), times * float(np.sqrt(larger[i])))
        for times in _TIMES
    ]


def _evidence(linear: Linear, one: Unrest) -> float:
    """Twice the logarithm of the likelihood with the noise of a sensor larger in that time."""
    cause, within = f"{one.sensor}_noise", _within(linear.problem.t, one)
    own, motion = MOVED[cause], linear.motion
    turn = np.kron(np.eye((own.stop - own.start) // 3), linear.turn[within])
    added = (one.times**2 - 1.0) * linear.noise.density(cause) ** 2 * linear.sums[cause][within]
    covariance = np.linalg.inv(motion.weight[within])
    covariance[:, own, own] += turn @ added @ turn.swapaxes(-1, -2)
    weight = motion.weight.copy()
    weight[within] = np.linalg.inv(covariance)
    problem = linear.problem
    solution = solve(len(problem.t), replace(motion, weight=weight), problem.measurements, linear.prior)
    return evidence(solution, problem.measurements, linear.prior)


def _within(t: Array, one: Unrest) -> Array:
    """(K-1,) which intervals between keyframes at t (K,) lie in that time."""
    return np.asarray((t[:-1] >= one.begin - 1e-9) & (t[1:] <= one.end + 1e-9))
