"""What was off for a time, a sensor or the autopilot's estimate, in words and numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from companion.analysis.finding import Cause, Side, runs
from companion.analysis.reference import length
from companion.estimation import (
    KINDS,
    SLOPED,
    BestEstimate,
    Explained,
    Size,
    at_work,
    kind_of,
    main_axis,
    turn_of_the_field,
)
from companion.model import Array, words

CLOSE, FAR = 3.0, 7.0  # log-likelihood: one to twenty, one to a thousand
SIGMAS = 3.0  # from which on something stands out
SENSORS: Mapping[str, str] = {"gyro": "gyro", "accel": "accelerometer", "compass": "compass"}
"""Sensor, as kinds begin with it → its name in words."""

BIAS_UNITS: Mapping[str, tuple[str, float, int]] = {"gyro": ("mrad/s", 1e3, 1), "accel": ("m/s²", 1.0, 2)}
"""Sensor → the unit that a bias is told in, how many of it are one in SI, and decimals."""

_UNITS = {"tilt": "°", "heading": "°", "velocity": " m/s", "position": " m", "height": " m"}


@dataclass(frozen=True, slots=True, eq=False)
class Episode:
    """A time during which one sensor was off in one way."""

    kind: str  # of `estimation.KINDS`
    witness: str  # "imu", "gps", "compass", "barometer"
    start: float  # s, boot clock
    start_sigma: float
    end: float  # s; infinite where it lasts to the end
    size: Array  # (m,) at its greatest, in the kind's unit
    sigma: float  # 1σ of its length
    gain: float  # twice the log-likelihood ratio
    others: tuple[tuple[str, str, float], ...]  # the next best explanations and their gains
    seconded: bool = True  # of a gyro: whether anything but the compass speaks against it
    slow: bool = False  # whether it grows, and is not there at once

    @property
    def magnitude(self) -> float:
        """The length of its size."""
        return float(np.linalg.norm(self.size))


@dataclass(frozen=True, slots=True)
class Departure:
    """A time during which the autopilot's estimate is further from the best estimate than both may be off."""

    quantity: str  # "tilt", "heading", "velocity", "position", "height"
    start: float  # s, boot clock
    end: float
    size: float  # at its greatest: rad, m/s, m
    sigma: float  # of both together, at that time
    recovers: bool = False  # whether it was so when the autopilot was first judged, and ended
    as_the_imu: bool = False  # whether the IMU moved as the autopilot says, and not as the best estimate
    sudden: bool = False  # whether it began with a step of a good part of itself

    @property
    def cause(self) -> Cause:
        """Itself, in numbers, where nothing else explains it."""
        unit = _UNITS[self.quantity].strip().replace("°", "rad")
        kind = f"{self.quantity}_off"
        return Cause(kind, "autopilot", self.start, self.end, size=self.size, sigma=self.sigma, unit=unit)

    def __str__(self) -> str:
        scale = np.degrees(1.0) if self.quantity in ("tilt", "heading") else 1.0
        return f"{self.size * scale:.1f} ± {self.sigma * scale:.1f}{_UNITS[self.quantity]} in {self.quantity}"


def episodes(best: BestEstimate) -> tuple[Episode, ...]:
    """What was explained, kind by kind, as times with a beginning, an end and a size; in order of time."""
    episodes: list[Episode] = []
    for kind in KINDS:
        parts = sorted((e for e in best.explained if e.kind == kind.name), key=lambda e: e.onset)
        if parts:
            episodes += _episodes_of(parts, kind.side, kind.least, best)
    return tuple(sorted(episodes, key=lambda e: e.start))


def _episodes_of(parts: list[Explained], witness: str, least: float, best: BestEstimate) -> Iterator[Episode]:
    last = float(best.t[-1])
    grid = np.unique(np.concatenate([np.linspace(parts[0].onset, last, 400), [p.onset for p in parts]]))
    share = np.array([_at_work(part, grid) for part in parts])
    level = share.T @ np.array([part.size for part in parts])
    size, sigma = length(level), _sigma(parts, share, level, best)
    for first, final in runs(np.asarray(size >= 0.5 * least)):
        here = slice(first, final + 1)
        if float(size[here].max()) < least:
            continue
        peak = first + int(np.argmax(size[here] - SIGMAS * sigma[here]))  # where it surely is largest
        before = [p for p in parts if p.onset <= grid[first] + 1e-9]
        cause = before[-1] if before[-1].shape not in SLOPED else next(p for p in before if p.shape in SLOPED)
        yield Episode(
            cause.kind,
            witness,
            cause.onset,
            cause.onset_sigma,
            float(grid[final]) if final < len(grid) - 1 else np.inf,
            level[peak],
            float(sigma[peak]),
            cause.gain,
            cause.others,
            any(part.seconded for part in before),
            cause.shape in SLOPED,
        )


def _at_work(part: Explained, t: Array) -> Array:
    """(N,) how much of the size of what was explained is there at times t: of a ramp so many seconds of it."""
    if part.shape == "shock":
        return ((t >= part.onset) & (t <= part.onset + 1.0)).astype(np.float64)
    return np.asarray(at_work(part.shape, np.array([part.onset]), np.array([part.end]), t, t)[0])


def bias_at_the_end(best: BestEstimate, kind: str) -> tuple[Array, Array]:
    """(3,) and its 1σ: what a sensor of the IMU reads too much at the end, of itself and by what was explained.

    kind: "gyro_bias", rad/s, or "accel_bias", m/s².
    """
    bias = np.median(getattr(best.states, kind), axis=0)
    variance = np.median(getattr(best, f"{kind}_sigma"), axis=0) ** 2
    for part in (one for one in best.explained if one.kind == kind):
        share = float(_at_work(part, best.t[-1:])[0])
        bias, variance = bias + share * part.size, variance + (share * part.sigma) ** 2
    return bias, np.sqrt(variance)


def _sigma(parts: list[Explained], share: Array, level: Array, best: BestEstimate) -> Array:
    """(N,) 1σ of the length of a sum (N, m) of so much (P, N) of each part.

    Two that begin together are known together, while each by itself may be anything.
    """
    along = level / np.maximum(length(level), 1e-300)[:, None]
    joint = np.zeros((len(level), len(best.explained_covariance)))
    variance = np.zeros(len(level))
    for part, much in zip(parts, share, strict=True):
        weight = much[:, None] * along
        if part.place is None:
            variance += ((weight * part.sigma) ** 2).sum(axis=1)
        else:
            joint[:, part.place] += weight
    variance += ((joint @ best.explained_covariance) * joint).sum(axis=1)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def axis_of(episode: Episode) -> str:
    """The one axis of the body that is off; "" where several are, or where its size is none of the body's."""
    if episode.witness != "imu":
        return ""
    return main_axis(episode.size)


def _size(episode: Episode, best: BestEstimate) -> Size:
    return Size(episode.size, episode.sigma, best.states.constant("earth_field"))


def size_told(episode: Episode, best: BestEstimate) -> tuple[float, float, str]:
    """How large it is said to be, its σ and its unit: of a compass' field that turns the angle."""
    if episode.kind != "compass_field":
        return episode.magnitude, episode.sigma, kind_of(episode.kind).unit
    angle, sigma = turn_of_the_field(_size(episode, best))
    return abs(angle), sigma, "rad"


def is_sized(episode: Episode, best: BestEstimate) -> bool:
    """Whether its size is more than its σ."""
    size, sigma, _ = size_told(episode, best)
    return size >= sigma


def cause_of(episode: Episode, best: BestEstimate, side: Side, consequences: tuple[str, ...]) -> Cause:
    """The episode in numbers."""
    size, sigma, unit = size_told(episode, best)
    rival = _rival(episode)
    return Cause(
        kind=episode.kind,
        side=side,
        onset_s=episode.start,
        end_s=episode.end if np.isfinite(episode.end) else None,
        onset_sigma_s=episode.start_sigma,
        sensor=episode.kind.split("_")[0] if episode.witness == "imu" else episode.witness,
        axis=axis_of(episode),
        size=size,
        sigma=sigma,
        unit=unit,
        rival="" if rival is None else rival[0],
        rival_worse=None if rival is None else rival[1],
        consequences=consequences,
    )


def said(episode: Episode, best: BestEstimate) -> str:
    """The episode in words, with its time."""
    until = "to the end" if not np.isfinite(episode.end) else f"to {episode.end:.1f} s"
    what = f"{words(episode.kind)} of a size that cannot be told"
    if is_sized(episode, best):
        what = kind_of(episode.kind).phrase(_size(episode, best))
    return f"{what}, from {episode.start:.1f} ± {episode.start_sigma:.1f} s {until}"


def rival_of_another(episode: Episode, within: float) -> str | None:
    """The kind of explanation that blames another, its log-likelihood within so much; None where there is none."""
    side = kind_of(episode.kind).side
    rival = _rival(replace(episode, others=tuple(o for o in episode.others if kind_of(o[0]).side != side)))
    return rival[0] if rival is not None and rival[1] < within else None


def gain_of(episode: Episode, sensor: str) -> float:
    """The best gain of an explanation by another sensor, whose kinds begin with its name; 0 where there is none."""
    return max((gain for kind, _, gain in episode.others if kind.startswith(sensor)), default=0.0)


def _rival(episode: Episode) -> tuple[str, float] | None:
    """The next best kind of explanation, and by how much its log-likelihood is worse; None where nothing is near."""
    named: dict[str, float] = {}
    for kind, _, gain in episode.others:
        if kind != episode.kind:
            named[kind] = max(gain, named.get(kind, -np.inf))
    if not named:
        return None
    kind = max(named, key=lambda name: named[name])
    return kind, (episode.gain - max(named[kind], 0.0)) / 2.0


def rivals(episode: Episode) -> str:
    """The same in words; empty where nothing is near."""
    rival = _rival(episode)
    if rival is None:
        return ""
    kind, worse = rival
    less = "far less likely" if worse > FAR else f"{max(np.exp(worse), 1.0):.0f} times less likely"
    return f"next best: {words(kind)}, {less}"
