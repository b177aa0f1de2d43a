"""Ends of chi-square intervals: SciPy is the oracle."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import gammaincinv

from companion.estimation.chi_square import log_end


@pytest.mark.parametrize(("side", "below"), [(-1.0, 0.025), (1.0, 0.975)])
def test_the_ends_are_scipys_to_all_digits(side: float, below: float) -> None:
    freedom = np.concatenate([np.linspace(1.0, 10.0, 91), np.geomspace(10.0, 1e8, 200)])
    theirs = gammaincinv(0.5 * freedom, below) / (0.5 * freedom)
    np.testing.assert_allclose(np.exp(log_end(freedom, side)), theirs, rtol=1e-13)
