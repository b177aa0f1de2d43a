"""How an IMU is integrated and what ends a window: the choices that every part of the analysis shares."""

from __future__ import annotations

from dataclasses import dataclass, field

from companion.analysis.reference import Limits
from companion.model import STANDARD_GRAVITY


@dataclass(frozen=True, slots=True)
class Integration:
    """One way to integrate. The analysis raises ValueError for a method or middle sample that it does not know."""

    method: str = "rk4"  # of `strapdown.METHODS`
    middle: str = "cubic"  # the signal between two samples: linear or cubic
    segments: int = 1  # steps between two samples
    gravity: float = STANDARD_GRAVITY  # m/s², along NED's down
    limits: Limits = field(default_factory=Limits)  # what is a hole, what is a jump


DEFAULT = Integration()
