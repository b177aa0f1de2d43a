"""Deviations of the autopilot's estimate, as a test says them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from companion.verdict.fault_interval import EstimatorDeviation, error_log_bayes


def off_by(
    quantity: str, start: float, end: float, size: float, sigma: float, *, places: float = 1.0
) -> EstimatorDeviation:
    """As large all the time from start to end, s, in a flight in which it might have been in so many places."""
    (log_bayes,) = error_log_bayes(quantity, np.array([size]), np.array([sigma]))
    one = EstimatorDeviation(quantity, start, end, size, sigma, float(log_bayes), end - start, end - start)
    return replace(one, judged=places * one.lasts)
