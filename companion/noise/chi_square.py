"""The quantiles of chi-square: the only special function of the project, which is not worth 125 MB of SciPy."""

from __future__ import annotations

import math
from functools import cache
from statistics import NormalDist

from companion.constants import num


@cache
def chi_square(freedom: float, z: float) -> float:
    """The point of chi-square that is passed with the probability with which a standard normal variable passes z.

    freedom: degrees of freedom, not only whole ones. z = 1.645 gives the 95 % point. By bisection of the series of the
    incomplete gamma function (M. Abramowitz, I. A. Stegun 1964, 6.5.29), of many degrees of freedom by E. B. Wilson and
    M. M. Hilferty (1931).
    """
    if freedom >= num.CHI_SQUARE_MANY:
        narrow = 2.0 / (9.0 * freedom)
        return float(freedom * (1.0 - narrow + z * math.sqrt(narrow)) ** 3)
    share, low, high = NormalDist().cdf(z), 0.0, 10.0 * freedom + 100.0
    for _ in range(num.CHI_SQUARE_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _below(0.5 * freedom, 0.5 * middle) < share else (low, middle)
    return high


def _below(a: float, x: float) -> float:
    """The regularised lower incomplete gamma function P(a, x)."""
    term, total, n = 1.0, 1.0, a
    while term > 1e-16 * total:
        n += 1.0
        term *= x / n
        total += term
    return math.exp(a * math.log(x) - x - math.lgamma(a + 1.0) + math.log(total))
