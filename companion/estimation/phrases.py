"""How the size of what went wrong is said in words: the phrases that the rows of `explanations.KINDS` are made of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from companion.model import Array


@dataclass(frozen=True, slots=True, eq=False)
class Size:
    """How large something was at its greatest, in its kind's unit."""

    value: Array  # (m,)
    sigma: float  # 1σ of its length
    earth_field: Array  # (3,) NED, µT

    @property
    def magnitude(self) -> float:
        """Its length."""
        return float(np.linalg.norm(self.value))


Phrase = Callable[[Size], str]


def main_axis(value: Array) -> str:
    """The one axis of the body, of three, that is off; "" where several are."""
    worst = int(np.argmax(np.abs(value)))
    return "xyz"[worst] if np.linalg.norm(np.delete(value, worst)) < 0.2 * abs(value[worst]) else ""


def by_axes(sensor: str, unit: str, factor: float, decimals: int) -> Phrase:
    """'gyro z bias 14.9 ± 0.6 mrad/s', or all three where more than one is off."""

    def phrase(size: Size) -> str:
        parts = [f"{v * factor:z.{decimals}f}" for v in size.value]
        spread = f"± {size.sigma * factor:.{decimals}f} {unit}"
        if axis := main_axis(size.value):
            return f"{sensor} {axis} bias {parts['xyz'.index(axis)]} {spread}"
        return f"{sensor} bias ({', '.join(parts)}) {spread}"

    return phrase


def by_length(what: str, unit: str) -> Phrase:
    """'the GPS position is off by up to 9.1 ± 1.2 m (north 8.0, east 4.3)'."""

    def phrase(size: Size) -> str:
        parts = "" if len(size.value) < 2 else f" (north {size.value[0]:.1f}, east {size.value[1]:.1f})"
        return f"{what} is off by up to {size.magnitude:.1f} ± {size.sigma:.1f} {unit}{parts}"

    return phrase


def by_number(words: str, factor: float = 1.0) -> Phrase:
    """Words with a place for the number, of several its magnitude, and one for its σ, both times the factor."""

    def phrase(size: Size) -> str:
        number = size.magnitude if len(size.value) > 1 else float(size.value[0])
        return words.format(number * factor, size.sigma * factor)

    return phrase


def turn_of_the_field(size: Size) -> tuple[float, float]:
    """By how much the horizontal field turns, and so the heading: rad, 1σ."""
    field = size.earth_field[:2]
    changed = field + size.value[:2]
    angle = np.arctan2(field[0] * changed[1] - field[1] * changed[0], field @ changed)
    return float(angle), size.sigma / max(float(np.linalg.norm(field)), 1e-9)


def by_turn_of_the_field(size: Size) -> str:
    """'the compass's field turns by 45 ± 2°'."""
    angle, spread = np.degrees(turn_of_the_field(size))
    return f"the compass's field turns by {angle:.0f} ± {spread:.0f}°"
