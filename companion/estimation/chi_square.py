"""The ends of the interval in which a chi-square variable is with 95 %, to all digits and without SciPy.

With a half the degrees of freedom and t the logarithm of the variable over its mean, the density of t is proportional
to exp(a (t - (eᵗ - 1))): of any a it is one hump about zero. Its tails are integrated by the double exponential rule
(H. Takahasi, M. Mori 1974), and the quantile is found by Newton's method on the logarithm of the tail, which is concave
there. SciPy's gammaincinv gives the same, for 27 MB and 0.2 s of import.
"""

from __future__ import annotations

import numpy as np

from companion.model import Array

_TAIL, _POINT = 0.025, 1.96  # of a 95 % interval, and where the standard normal has it
_STEPS = 4  # from the approximation, which is 1 % off: each squares the error
_LEAST = 0.1  # cube root of the variable over its mean, from which on the approximation holds
_EVERY = 0.04
_AT = np.arange(-3.92, 1.72, _EVERY)  # the first is closer than rounding, the last beyond all that counts
_REACH = np.exp(0.5 * np.pi * np.sinh(_AT))
_WEIGHT = 0.5 * np.pi * np.cosh(_AT) * _REACH * _EVERY


def log_end(freedom: Array, side: float) -> Array:
    """Logarithm of the low (side -1) or high (+1) end over the mean, of degrees of freedom (M,) of 1 or more."""
    narrow = 2.0 / (9.0 * freedom)
    begin = 1.0 - narrow + side * _POINT * np.sqrt(narrow)  # E. B. Wilson, M. M. Hilferty 1931
    t = 3.0 * np.log(np.maximum(begin, _LEAST))
    zero = np.zeros_like(t)
    whole = _beyond(freedom, zero, -1.0) + _beyond(freedom, zero, 1.0)
    for _ in range(_STEPS):
        left = _beyond(freedom, t, side)
        t = t + side * np.log(left / whole / _TAIL) * left / _density(freedom, t)
    return np.asarray(t)


def _beyond(freedom: Array, t: Array, side: float) -> Array:
    """The integral of `_density` from t (M,) on to one side."""
    wide = np.sqrt(2.0 / freedom)  # of the hump
    return np.asarray(wide * (_density(freedom[:, None], t[:, None] + side * np.outer(wide, _REACH)) @ _WEIGHT))


def _density(freedom: Array, t: Array) -> Array:
    """But for a factor, 1 at its greatest."""
    return np.asarray(np.exp(0.5 * freedom * (t - np.expm1(t))))
