"""What was off for a time, a sensor or the autopilot's estimate, in words and numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from companion.analysis.finding import Cause, Side
from companion.estimation import BestEstimate, Size, kind_of, main_axis, turn_of_the_field
from companion.model import Array

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
    return f"next best: {kind.replace('_', ' ')}, {less}"
