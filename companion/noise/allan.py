"""Allan deviation of an IMU at rest, and the noise figures that it shows (IEEE Std 952-1997, annex C).

    σ²(τ) = N²/τ + (2 ln 2/π) B² + K² τ/3

N white noise (u/√Hz), B bias instability (u), K rate random walk (u/√s), with u rad/s or m/s². The deviation itself is
the overlapping one; how far it can be trusted at each τ follows from its degrees of freedom: few where τ is a large
part of the rest. A figure that a rest is too short to show gets an upper bound and no value.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from companion.constants import num
from companion.model import Array
from companion.noise.chi_square import chi_square


@dataclass(frozen=True, slots=True)
class Coefficient:
    """A noise figure with its 95 % interval; without a value, `high` is an upper bound."""

    value: float | None
    low: float
    high: float

    @property
    def most(self) -> float:
        """The value, or the bound where there is none."""
        return self.high if self.value is None else self.value


@dataclass(frozen=True, slots=True)
class NoiseFigures:
    """What the Allan deviation of one axis shows."""

    white: Coefficient  # N, u/√Hz
    instability: Coefficient  # B, u
    walk: Coefficient  # K, u/√s


@dataclass(frozen=True, slots=True, eq=False)
class AllanDeviation:
    """The overlapping Allan deviation of the three axes of one sensor."""

    tau: Array  # (M,) s, increasing
    deviation: Array  # (M, 3) u
    freedom: Array  # (M,) degrees of freedom of the variance: the fewer of white noise's and of a random walk's

    @property
    def interval(self) -> tuple[Array, Array]:
        """Low and high end (M, 3) of the 95 % interval of the deviation: chi-square with `freedom`."""
        low, high = _chi_square_factors(self.freedom)
        return self.deviation * low[:, None], self.deviation * high[:, None]


def allan_deviation(readings: Array, rate_hz: float) -> AllanDeviation | None:
    """Of readings (N, 3) at an even rate, at τ spread evenly over the decades; None for fewer than 32 samples.

    Source: Riley, Handbook of Frequency Stability Analysis, NIST SP 1065 (2008): (11) for the overlapping variance,
    table 5 for its degrees of freedom.
    """
    count = len(readings)
    if count < num.ALLAN_MIN_SAMPLES:
        return None
    longest = count * num.ALLAN_MAX_TAU
    sizes = np.unique(np.geomspace(1, longest, int(num.ALLAN_PER_DECADE * np.log10(longest)) + 1).astype(np.int64))
    angle = np.concatenate([np.zeros((1, 3)), np.cumsum(readings - readings.mean(axis=0), axis=0)])
    rows = []
    for size in sizes:
        change = angle[2 * size :] - 2.0 * angle[size:-size] + angle[: -2 * size]
        rows.append(np.sqrt(np.mean(np.square(change), axis=0) / 2.0) / size)
    # from n sums of the readings, over m samples each
    n, m = count + 1.0, sizes
    of_white = (3.0 * (n - 1) / (2.0 * m) - 2.0 * (n - 2) / n) * 4.0 * m**2 / (4.0 * m**2 + 5.0)
    of_walk = (n - 2) / (m * (n - 3) ** 2) * ((n - 1) ** 2 - 3.0 * m * (n - 1) + 4.0 * m**2)
    freedom = np.maximum(np.minimum(of_white, of_walk), 1.0)
    return AllanDeviation(sizes / rate_hz, np.array(rows), freedom)


def noise_figures(allan: AllanDeviation, axis: int, shortest_s: float = 0.0, grid: float = 0.0) -> NoiseFigures | None:
    """N, B and K of an axis by weighted non-negative least squares; None where it never changes.

    shortest_s: τ below it are left out (a low-pass makes neighbouring samples alike); grid: what the steps of the
    readings add to N², u²/Hz.
    """
    used = (allan.tau >= shortest_s) & (allan.deviation[:, axis] > 0)
    if used.sum() < 3:
        return None
    tau, freedom = allan.tau[used], allan.freedom[used]
    variance = np.square(allan.deviation[used, axis])
    shapes = np.column_stack([1.0 / tau, np.full(len(tau), num.FLICKER_VARIANCE), tau / 3.0])
    alike = num.ALLAN_OCTAVES * max(len(tau) / max(float(np.log2(tau[-1] / tau[0])), 1.0), 1.0)
    seen = [0, 1, 2]
    while True:  # a term that is not seen is left out of the fit, the least sure first: it only blurs the others
        power, sigma = _fit(shapes[:, seen], variance, freedom, alike)
        sure = power / np.maximum(sigma, 1e-300)
        if sure.min() > num.ALLAN_SIGMAS or len(seen) == 1:
            break
        seen.pop(int(np.argmin(sure)))
    fitted = {which: (float(power[i]), float(sigma[i])) for i, which in enumerate(seen)}
    if 0 in fitted:
        fitted[0] = max(fitted[0][0] - grid, 0.0), fitted[0][1]
    _, high = _chi_square_factors(freedom)
    bounds = np.min(np.sqrt(variance)[:, None] * high[:, None] / np.sqrt(shapes), axis=0)
    return NoiseFigures(*(_coefficient(*fitted.get(which, (0.0, 0.0)), float(bounds[which])) for which in range(3)))


def _fit(shapes: Array, variance: Array, freedom: Array, alike: float) -> tuple[Array, Array]:
    """Powers (P,) of terms of given shapes (M, P) and their standard errors, from variances (M,).

    The relative error of a variance is √(2 / freedom), and `alike` of neighbouring ones are as good as one.
    """
    weight = np.sqrt(freedom / (2.0 * alike))
    model = variance
    for _ in range(num.ALLAN_PASSES):
        scaled = shapes * (weight / model)[:, None]
        size = np.linalg.norm(scaled, axis=0)
        power = nonnegative_least_squares(scaled / size, variance * weight / model) / size
        model = np.maximum(shapes @ power, 1e-300)
    scaled = shapes * (weight / model)[:, None] / size
    return power, np.sqrt(np.diag(np.linalg.pinv(scaled.T @ scaled))) / size


def nonnegative_least_squares(columns: Array, values: Array) -> Array:
    """The x (P,), none of it negative, for which columns (M, P) x is nearest to values (M,).

    It is the least-squares solution of the columns that it uses; of a few columns all choices are tried.
    """
    best, least = np.zeros(columns.shape[1]), float(values @ values)
    for count in range(1, len(best) + 1):
        for used in map(list, combinations(range(len(best)), count)):
            x = np.linalg.lstsq(columns[:, used], values, rcond=None)[0]
            left = values - columns[:, used] @ x
            if (x >= 0.0).all() and left @ left < least:
                best, least = np.zeros(len(best)), float(left @ left)
                best[used] = x
    return best


def _coefficient(power: float, sigma: float, bound: float) -> Coefficient:
    """The square root of a term with its interval; where the term is not seen, what the whole curve leaves for it."""
    if power <= num.ALLAN_SIGMAS * sigma or power <= 0.0:
        return Coefficient(None, 0.0, bound)
    root, spread = float(np.sqrt(power)), sigma / power  # two standard errors of the root
    return Coefficient(root, root * float(np.exp(-spread)), root * float(np.exp(spread)))


def _chi_square_factors(freedom: Array) -> tuple[Array, Array]:
    """What a deviation is multiplied by for the ends of its 95 % interval."""
    low, high = (np.array([chi_square(k, z) for k in freedom.tolist()]) for z in (num.Z_975, -num.Z_975))
    return np.sqrt(freedom / low), np.sqrt(freedom / high)
