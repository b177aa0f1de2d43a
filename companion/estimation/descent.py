"""A step of Gauss-Newton, taken as far as the misfit gets less.

Where the readings contradict each other the problem is far from linear, and a whole step may lead anywhere. So the
misfit where it ends is compared with that where it begins, and a step that leads uphill is shortened to where a
parabola through both and the slope at its beginning is least (J. Nocedal, S. J. Wright 2006, Numerical Optimization,
§3.5).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from companion.estimation.linearisation import Linear
from companion.estimation.model import CONSTANT_STATES, States
from companion.estimation.system import Prior, misfit, squares
from companion.model import Array

LITTLE = 1e-3  # of the misfit: no state moves by more than three hundredths of its σ
_SHORTEST, _LONGEST = 0.1, 0.5  # of a step that is shortened once
_SHORTENED = 2  # times, at most


@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """Where an iteration stands."""

    states: States
    sizes: Array  # (m,) of what is accepted


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """The way to the solution of a linear problem."""

    begin: Point
    x: Array  # (K, 15) error of the states
    c: Array  # (39 + m,) error of the constants, and the sizes of what is accepted
    weight: Array  # (K-1, 15, 15) of the motion
    information: tuple[Array, ...]  # of every witness, (M, d)
    misfit: float  # at its beginning
    gain: float  # by how much less it is at its end, were the problem linear

    @classmethod
    def of(cls, linear: Linear, sizes: Array) -> Step:
        """From the states of a linear problem, where what is accepted has these sizes (m,)."""
        solution, prior = linear.solution, linear.prior
        information = tuple(one.information for one in linear.measurements)
        begin = _misfit(linear, sizes, linear.motion.weight, information)
        end = misfit(linear.motion, linear.measurements, solution) + _of_prior(
            prior, prior.residual - solution.x[0], prior.constants_residual - solution.c
        )
        point = Point(linear.states, sizes)
        return cls(point, solution.x, solution.c, linear.motion.weight, information, begin, begin - end)

    def at(self, share: float) -> Point:
        """After a share of it."""
        sizes = self.begin.sizes
        states = self.begin.states.moved(share * self.x, share * self.c)
        return Point(states, sizes + share * (self.c[CONSTANT_STATES:] - sizes))

    def misfit_at(self, point: Point, linear: Linear) -> float:
        """The misfit at a point, about which a problem was made linear, with the weights of this one."""
        return _misfit(linear, point.sizes, self.weight, self.information)

    def taken(self, linearised: Callable[[Point], Linear]) -> tuple[Point, Linear]:
        """Where it leads, and the linear problem there.

        linearised: makes the problem about a point.
        """
        share, left = 1.0, _SHORTENED
        while True:
            point = self.at(share)
            linear = linearised(point)
            higher = self.misfit_at(point, linear) - self.misfit
            if not (higher > LITTLE and left):  # of absurd readings it may be no number
                return point, linear
            del linear  # before the next is made, as large
            least = np.nan_to_num(self.gain * share**2 / (higher + 2.0 * self.gain * share))
            share, left = float(np.clip(least, _SHORTEST * share, _LONGEST * share)), left - 1


def _misfit(linear: Linear, sizes: Array, weight: Array, information: Sequence[Array]) -> float:
    """That of the states about which a problem was made linear, and of sizes (m,), with the weights of a problem."""
    known = slice(CONSTANT_STATES, None)
    measured = (
        (one.residual - one.constants[..., known] @ sizes, own)
        for one, own in zip(linear.measurements, information, strict=True)
    )
    motion, prior = linear.motion, linear.prior
    constants = prior.constants_residual.copy()
    constants[known] -= sizes
    return squares(motion.residual + motion.constants[..., known] @ sizes, weight, measured) + _of_prior(
        prior, prior.residual, constants
    )


def _of_prior(prior: Prior, states: Array, constants: Array) -> float:
    return float(((states / prior.sigma) ** 2).sum() + ((constants / prior.constants_sigma) ** 2).sum())
