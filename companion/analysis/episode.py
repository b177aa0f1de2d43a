"""What was off for a time, a sensor or the autopilot's estimate, in words and numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from companion.analysis.finding import Cause, Side
from companion.analysis.navigation_error import length
from companion.estimation import BestEstimate, kind_of
from companion.model import Array

CLOSE, FAR = 3.0, 7.0  # log-likelihood: one to twenty, one to a thousand
SIGMAS = 3.0  # from which on something stands out
SENSORS: Mapping[str, str] = {"gyro": "gyro", "accel": "accelerometer", "compass": "compass"}
"""Sensor, as kinds begin with it → its name in words."""

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

    @property
    def cause(self) -> Cause:
        """Itself, in numbers, where nothing else explains it."""
        unit = _UNITS[self.quantity].strip().replace("°", "rad")
        kind = f"{self.quantity}_off"
        return Cause(kind, "autopilot", self.start, self.end, size=self.size, sigma=self.sigma, unit=unit)

    def __str__(self) -> str:
        scale = np.degrees(1.0) if self.quantity in ("tilt", "heading") else 1.0
        return f"{self.size * scale:.1f} ± {self.sigma * scale:.1f}{_UNITS[self.quantity]} in {self.quantity}"


def _vector(size: Array, factor: float, decimals: int) -> str:
    return ", ".join(f"{v * factor:.{decimals}f}" for v in size)


def _axes(sensor: str, unit: str, factor: float, decimals: int) -> Callable[[Episode, BestEstimate], str]:
    """'gyro z reads 14.9 ± 0.6 mrad/s too much', or all three where more than one is off."""

    def phrase(episode: Episode, _: BestEstimate) -> str:
        size = episode.size
        spread = f"± {episode.sigma * factor:.{decimals}f} {unit}"
        if axis := axis_of(episode):
            return f"{sensor} {axis} reads {size['xyz'.index(axis)] * factor:.{decimals}f} {spread} too much"
        return f"{sensor} reads ({_vector(size, factor, decimals)}) {spread} too much"

    return phrase


def _place(what: str, unit: str) -> Callable[[Episode, BestEstimate], str]:
    def phrase(episode: Episode, _: BestEstimate) -> str:
        parts = "" if len(episode.size) < 2 else f" (north {episode.size[0]:.1f}, east {episode.size[1]:.1f})"
        return f"{what} is off by up to {episode.magnitude:.1f} ± {episode.sigma:.1f} {unit}{parts}"

    return phrase


def axis_of(episode: Episode) -> str:
    """The one axis of the body that is off; "" where several are, or where its size is none of the body's."""
    if episode.witness != "imu":
        return ""
    worst = int(np.argmax(np.abs(episode.size)))
    return "xyz"[worst] if length(np.delete(episode.size, worst)) < 0.2 * abs(episode.size[worst]) else ""


def _turn(episode: Episode, best: BestEstimate) -> tuple[float, float]:
    """By how much the horizontal field turns, and so the heading: rad, 1σ."""
    field = best.states.constant("earth_field")[:2]
    changed = field + episode.size[:2]
    angle = np.arctan2(field[0] * changed[1] - field[1] * changed[0], field @ changed)
    return float(angle), episode.sigma / max(float(np.linalg.norm(field)), 1e-9)


def _turned(episode: Episode, best: BestEstimate) -> str:
    angle, spread = np.degrees(_turn(episode, best))
    return f"the compass' field turns by {angle:.0f} ± {spread:.0f}°"


def cause_of(episode: Episode, best: BestEstimate, side: Side, consequences: tuple[str, ...]) -> Cause:
    """The episode in numbers. A compass' field that turns is measured by its angle."""
    size, sigma, unit = episode.magnitude, episode.sigma, kind_of(episode.kind).unit
    if episode.kind == "compass_field":
        angle, sigma = _turn(episode, best)
        size, unit = abs(angle), "rad"
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


PHRASES: Mapping[str, tuple[Callable[[Episode, BestEstimate], str], str]] = {
    "gyro_bias": (_axes("gyro", "mrad/s", 1e3, 1), "Let the gyro warm up and calibrate it at rest. If it steps again, "
                  "fly on another IMU."),
    "accel_bias": (_axes("accelerometer", "m/s²", 1.0, 2), "Calibrate the accelerometer. If it steps again without a "
                   "shock or strong vibration, fly on another IMU."),
    "gyro_scale": (_axes("gyro", "% of what it turns", 100.0, 1), "A gyro of wrong scale: check its range setting and "
                   "its calibration."),
    "accel_scale": (_axes("accelerometer", "% of what it feels", 100.0, 1), "Calibrate the accelerometer in six "
                    "positions."),
    "gyro_shock": (lambda e, _: f"the gyro misses a turn of {np.degrees(e.magnitude):.0f} ± {np.degrees(e.sigma):.0f}°",
                   "A shock, strong vibration or lost samples: look at the mounting and the log's holes."),
    "accel_shock": (lambda e, _: f"the accelerometer misses a push of {e.magnitude:.1f} ± {e.sigma:.1f} m/s",
                    "A shock, strong vibration or lost samples: look at the mounting and the log's holes."),
    "gyro_unrest": (lambda e, _: f"the gyro scatters {e.magnitude:.1f} times more than in the rest of the flight",
                    "Vibration: look at propellers, motors and the mounting; log the IMU faster than it shakes."),
    "accel_unrest": (lambda e, _: f"the accelerometer scatters {e.magnitude:.1f} times more than in the rest of the "
                     "flight", "Vibration: look at propellers, motors and the mounting; log the IMU faster than it "
                     "shakes."),
    "gps_position": (_place("the GPS position", "m"), "Look at the antenna's view of the sky, its cable and at "
                     "interference; a receiver of a second band helps."),
    "gps_height": (_place("the GPS height", "m"), "Usual under trees and beside walls; fly on the barometer."),
    "gps_velocity": (_place("the GPS velocity", "m/s"), "Look at the antenna's view of the sky and at interference."),
    "gps_motion": (_place("the GPS reports a motion that no other sensor feels: it", "m/s"), "Position and velocity go "
                   "off together: look at the receiver, and at interference or spoofing."),
    "gps_latency": (lambda e, _: f"the GPS fixes come {e.size[0]:.3f} ± {e.sigma:.3f} s later than before", "Look at "
                    "the receiver's rate and load and at the line to it; set the estimator's GPS delay."),
    "compass_field": (_turned, "Look for iron and currents near the compass and under the take-off place; calibrate it "
                      "again, or use GPS for yaw."),
    "compass_turn": (lambda e, _: f"the compass turns by {np.degrees(e.magnitude):.0f} ± {np.degrees(e.sigma):.0f}° "
                     "in its mounting", "Look at the mounting of the compass, and at its orientation setting."),
    "compass_iron": (_place("the compass", "µT"), "Look for currents and iron near the compass: motors, cables."),
    "barometer": (_place("the barometer", "m"), "Shield it from wind and light."),
}  # fmt: skip
"""Kind → how an episode of it is said, and what to do."""


def said(episode: Episode, best: BestEstimate) -> str:
    """The episode in words, with its time."""
    until = "to the end" if not np.isfinite(episode.end) else f"to {episode.end:.1f} s"
    return f"{PHRASES[episode.kind][0](episode, best)}, from {episode.start:.1f} ± {episode.start_sigma:.1f} s {until}"


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
