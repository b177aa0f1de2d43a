"""How an IMU is integrated, in which gravity, and what ends a window: what every part of the analysis shares."""

from __future__ import annotations

from dataclasses import dataclass, field

from companion.analysis.reference import Limits
from companion.model import STANDARD_GRAVITY, DataError, Flight, SettingsError, check_number
from companion.strapdown import normal_gravity


@dataclass(frozen=True, slots=True)
class Integration:
    """One way to integrate.

    Raises SettingsError for gravity that is no number; the analysis, for a method or middle sample that is none.
    """

    method: str = "rk4"  # of `strapdown.METHODS`
    middle: str = "cubic"  # the signal between two samples: linear or cubic
    segments: int = 1  # steps between two samples
    gravity: float = STANDARD_GRAVITY  # m/s², along NED's down
    limits: Limits = field(default_factory=Limits)  # what is a gap, what is a jump

    def __post_init__(self) -> None:
        check_number("gravity", self.gravity)


DEFAULT = Integration()


def gravity_for(flight: Flight, model: str | float) -> float:
    """Gravity along NED's down, m/s²: "standard" (9.80665), "normal" (WGS-84 at the flight's origin) or a number.

    Raises DataError for "normal" when the log does not say where on Earth the flight was, SettingsError for another
    word.
    """
    if isinstance(model, int | float):
        return float(model)
    if model == "standard":
        return STANDARD_GRAVITY
    if model != "normal":
        raise SettingsError(f'gravity must be "standard", "normal" or a number in m/s², got {model!r}')
    if flight.origin is None:
        raise DataError(
            f"vehicle {flight.vehicle}, boot {flight.boot}: no latitude in the log (GLOBAL_POSITION_INT, GPS_RAW_INT, "
            'GPS_GLOBAL_ORIGIN), which gravity = "normal" needs. Use "standard", or give a number in m/s².'
        )
    return float(normal_gravity(flight.origin.latitude, flight.origin.height))
