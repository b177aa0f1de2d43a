"""SciPy is the oracle of the quantiles of chi-square."""

from __future__ import annotations

import pytest
from scipy.stats import chi2, norm

from companion.noise import chi_square


@pytest.mark.parametrize("freedom", [1.0, 1.7, 2.0, 3.0, 9.0, 50.0, 99.9, 100.0, 1e5])
@pytest.mark.parametrize("z", [-1.959964, -1.645, 0.0, 1.645, 3.0902])
def test_a_quantile_is_that_of_scipy(freedom: float, z: float) -> None:
    within = 1e-6 if freedom < 100.0 else 4e-4
    assert chi_square(freedom, z) == pytest.approx(float(chi2.ppf(norm.cdf(z), freedom)), rel=within)
