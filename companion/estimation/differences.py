"""What the other IMUs of a vehicle read more than the one that carries the estimate, and what that tells of faults.

All IMUs of a vehicle feel the same motion but for the distance between them, so the difference of two readings over
seconds is that of their errors: a constant, a random walk as both warm, white noise, and the fault of either. A fault
of the estimate's own IMU shows in every difference and in the estimate; that of another one in its own difference
alone. So two IMUs can contradict an accusation, and three decide which of them is wrong.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from companion.constants import harm, healthy, num
from companion.estimation.shapes import activation
from companion.model import Array, Flight, ImuTrack, interpolated

if TYPE_CHECKING:
    from companion.estimation.candidate import Candidate
    from companion.estimation.hypotheses import Hypothesis


@dataclass(frozen=True, slots=True, eq=False)
class Differences:
    """Another IMU less the estimate's own in B blocks; "gyro" in rad/s and "accel" in m/s², FRD."""

    instance: int
    source: str
    t: Array  # (B,) s, boot clock, middles
    used: npt.NDArray[np.int64]  # (B,) the IMU whose readings the estimate's own are
    width: float  # s
    value: Mapping[str, Array]  # (B, 3)
    slower: Mapping[str, Array]  # (B, 3) what the slower of the two reads
    scatter: Mapping[str, Array]  # (B, 3) 1σ of the readings' differences
    aliased: Mapping[str, Array]  # (3,) 1σ of what vibration that its samples fold down may read like all the time
    weight: Mapping[str, Array] = field(default_factory=dict)
    """(3, B, B) of each axis: inverse covariance, the constant and what is accepted free; empty until `weighed`."""

    def score(self, hypothesis: Hypothesis, shape: str, onset: Array, end: Array) -> tuple[Array, Array]:
        """Gradient b (T, 3) and information V (T, 3, 3) of errors of this IMU from onsets to ends (T,), s.

        Of D data sets, values (B, 3, D), b is (T, 3, D).
        Those of the estimate's own IMU have the same V, and -b: see `score_of_own`.
        """
        columns = self.columns(hypothesis, shape, onset, end)
        weighed = columns @ self.weight[hypothesis.sensor]
        b = np.einsum("atb,ba...->ta...", weighed, self.value[hypothesis.sensor])
        return b, (weighed * columns).sum(axis=2).T[:, :, None] * np.eye(3)

    def beside(self, one: Candidate) -> Differences:
        """The same where an error of either IMU is free."""
        sensor = one.hypothesis.sensor
        weight = self.weight[sensor].copy()
        for a in range(3) if one.axis < 0 else (one.axis,):
            column = self.column(one)[a]
            weighed = weight[a] @ column
            weight[a] -= np.outer(weighed, weighed) / (column @ weighed + one.hypothesis.prior**-2.0)
        return replace(self, weight={**self.weight, sensor: weight})

    def sizes(self, errors: Sequence[Candidate]) -> list[tuple[Array, Array]]:
        """The size (3,) of each of some errors of this IMU and its 1σ (3,), all of them free together."""
        out = [(np.zeros(3), np.zeros(3)) for _ in errors]
        for sensor in self.value:
            for a in range(3):
                mine = [i for i, one in enumerate(errors) if one.hypothesis.sensor == sensor and one.axis in (-1, a)]
                if not mine:
                    continue
                columns = np.array([self.column(errors[i])[a] for i in mine])
                weighed = columns @ self.weight[sensor][a]
                believed = np.diag([errors[i].hypothesis.prior ** -2.0 for i in mine])
                covariance = np.linalg.inv(weighed @ columns.T + believed)
                solved = covariance @ (weighed @ self.value[sensor][:, a])
                for place, i in enumerate(mine):
                    out[i][0][a], out[i][1][a] = solved[place], np.sqrt(covariance[place, place])
        return out

    def column(self, one: Candidate) -> Array:
        """(3, B) what an error of size one adds to each axis."""
        return self.columns(one.hypothesis, one.shape, np.array([one.onset]), np.array([one.end]))[:, 0]

    def columns(self, hypothesis: Hypothesis, shape: str, onset: Array, end: Array) -> Array:
        """(3, T, B) the same of one that may begin and end at several times (T,)."""
        share = activation(shape, onset, end, self.t - 0.5 * self.width, self.t + 0.5 * self.width)
        if hypothesis.error == "shock":
            share = share / self.width
        if hypothesis.error != "scale":
            return np.asarray(np.broadcast_to(share, (3, *share.shape)))
        slower = self.slower[hypothesis.sensor]
        slower = slower * (np.sqrt((slower**2).mean(axis=0)) > harm.LIVELY[hypothesis.sensor])
        return np.asarray(share * slower.T[:, None, :])


def in_blocks(
    flight: Flight,
    used: ImuTrack,
    span: tuple[float, float] = (-np.inf, np.inf),
    untrusted: Sequence[tuple[float, float]] = (),
) -> tuple[Differences, ...]:
    """One for every other IMU that was heard long enough, of the fastest track that it has.

    span: boot times (s) to which they are confined. untrusted: stretches (s) in which those of `used` are no readings.
    """
    others = (one for one in flight.each_imu(alone=True) if used.switches or one.instance != used.instance)
    made = (_difference(flight, used, track, span, untrusted) for track in others)
    return tuple(one for one in made if one is not None)


def weighed(blocks: Sequence[Differences]) -> tuple[Differences, ...]:
    """How well each difference is known, beside what it is."""
    return tuple(replace(one, weight={sensor: _weight(sensor, one) for sensor in one.value}) for one in blocks)


def score_of_own(
    others: Sequence[Differences], hypothesis: Hypothesis, shape: str, onset: Array, end: Array
) -> tuple[Array, Array]:
    """What differences (one at least) tell of errors of the estimate's own IMU: b (T, 3), V (T, 3, 3)."""
    scores = [one.score(hypothesis, shape, onset, end) for one in others]
    return np.asarray(-sum(b for b, _ in scores)), np.asarray(sum(v for _, v in scores))


def _difference(
    flight: Flight, used: ImuTrack, other: ImuTrack, span: tuple[float, float], untrusted: Sequence[tuple[float, float]]
) -> Differences | None:
    """Of blocks in which both were heard: armed, where the vehicle ever was, for motors shift an accelerometer."""
    slow, fast, sign = (used, other, -1.0) if used.rate_hz < other.rate_hz else (other, used, 1.0)
    inside = (slow.t >= max(fast.t[0], span[0])) & (slow.t <= min(fast.t[-1], span[1]))
    i = np.clip(np.searchsorted(fast.t, slow.t), 1, len(fast) - 1)
    inside &= fast.t[i] - fast.t[i - 1] < 3.0 / fast.rate_hz
    for first, last in untrusted:
        inside &= (slow.t < first) | (slow.t > last)
    inside &= used.instance_at(slow.t) != other.instance
    armed = flight.armed(slow.t, slow.t)
    if armed is not None and armed.any():
        inside &= armed
    t = slow.t[inside]
    if len(t) < num.DIFF_MIN_BLOCKS * num.DIFF_MIN_READINGS:
        return None
    width = max(num.DIFF_BLOCK_S, num.DIFF_MIN_READINGS / slow.rate_hz, float(t[-1] - t[0]) / num.DIFF_MAX_BLOCKS)
    names, begin, count = np.unique(np.floor(t / width), return_index=True, return_counts=True)
    whole = count >= num.DIFF_MIN_READINGS
    if whole.sum() < num.DIFF_MIN_BLOCKS:
        return None
    begin, count = begin[whole], count[whole]
    value, slower, scatter, aliased, middle = {}, {}, {}, {}, (names[whole] + 0.5) * width
    for sensor in ("gyro", "accel"):
        read = getattr(slow, sensor)[inside]
        off = sign * (read - interpolated(t, fast.t, getattr(fast, sensor)))
        value[sensor], slower[sensor], scatter[sensor] = np.empty((3, len(begin), 3))
        for many in np.unique(count):  # blocks of as many readings at once
            mine = np.flatnonzero(count == many)
            inner = begin[mine, None] + np.arange(many)
            value[sensor][mine] = _means(off[inner])
            slower[sensor][mine], scatter[sensor][mine] = read[inner].mean(axis=1), off[inner].std(axis=1)
        aliased[sensor] = healthy.ALIASED * np.median(scatter[sensor], axis=0)
    return Differences(
        other.instance, other.source, middle, used.instance_at(middle), width, value, slower, scatter, aliased
    )


def _means(values: Array) -> Array:
    """(B, 3) means of B blocks of readings (B, n, 3) without those far off.

    A median would tell of a step within a block the longer side.
    """
    apart = np.abs(values - np.median(values, axis=1, keepdims=True))
    usual = apart <= num.DIFF_OUTLIER * np.maximum(np.median(apart, axis=1, keepdims=True), 1e-12)
    usual |= usual.mean(axis=1, keepdims=True) < 1.0 - num.DIFF_OUTLIERS_SHARE  # so many are a side of a step
    return np.asarray((values * usual).sum(axis=1) / usual.sum(axis=1))


def _weight(sensor: str, one: Differences) -> Array:
    """(3, B, B) inverse covariances of a sensor's differences in B blocks: a random walk and white noise.

    Constants are free: one of each part of the flight, where either may have been calibrated anew while it was unheard,
    or the estimate's own readings are those of another IMU.
    Both noises by the median square of changes from one block to the next and over some, about their median: a step
    hardly moves it, nor does a steady drift, which is a fault's or a warming part's. A block in which readings scatter
    more, or which stands apart from those about it, is known by less.
    """
    t, off, scatter = one.t, one.value[sensor], one.scatter[sensor]
    lags = (1, max(2, min(num.DIFF_MAX_LAG, len(t) // 8)))
    changes = [off[lag:] - off[:-lag] for lag in lags]
    near, far = (np.median((c - np.median(c, axis=0)) ** 2, axis=0) / num.CHI_SQUARE_MEDIAN for c in changes)
    once, often = (float(np.median(t[lag:] - t[:-lag])) for lag in lags)
    walk = np.maximum((far - near) / max(often - once, 1e-9), healthy.DIFF_MIN_WALK[sensor] ** 2)
    white = np.maximum(0.5 * (near - walk * once), healthy.DIFF_MIN_NOISE[sensor] ** 2)
    usual = np.maximum(np.median(scatter, axis=0), healthy.DIFF_MIN_NOISE[sensor])
    rough = np.maximum(scatter / usual, 1.0) ** 2
    padded = np.concatenate([off[num.DIFF_REACH : 0 : -1], off, off[-2 : -num.DIFF_REACH - 2 : -1]])
    apart = off - np.median(sliding_window_view(padded, 2 * num.DIFF_REACH + 1, axis=0), axis=2)
    own = np.maximum(white * rough, apart**2)
    since = np.minimum(t[:, None], t) - t[0]
    weight = np.linalg.inv(walk[:, None, None] * since + own.T[:, :, None] * np.eye(len(t)))
    gap = max(num.DIFF_GAP_S, num.DIFF_GAP_BLOCKS * one.width)
    anew = (np.diff(t, prepend=t[0]) > gap) | (np.diff(one.used, prepend=one.used[0]) != 0)
    stretch = np.cumsum(anew)
    for part in np.unique(stretch):
        total = weight[:, :, stretch == part].sum(axis=2)
        weight = weight - total[:, :, None] * total[:, None, :] / total[:, stretch == part].sum(axis=1)[:, None, None]
    return np.asarray(weight)
