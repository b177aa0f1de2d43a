"""What the user has chosen, and what is computed of it: the dead reckoning at once, the analysis later."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np

from companion.analysis import HORIZONS_S, NO_CORRECTION, Correction, Integration, Verdict, gravity_for
from companion.model import Flight, ImuTrack
from companion.strapdown import ImuModel, Sensor, correct
from companion.view.state.trajectory import AnalysisResult, DisplayTrajectory, FlightChecks

CameraMode = Literal["Free", "Follow", "Chase", "From above", "Map"]
ExtraPath = Literal["gps", "best"]
EXTRA_PATHS: dict[ExtraPath, tuple[str, str, bool]] = {
    "gps": ("GPS fixes", "Positions of the GPS receiver, unfiltered", True),
    "best": ("Best estimate", "From IMU, GPS, compass, barometer and rest, without the autopilot's estimate", False),
}
"""Name, hint, and whether it is shown at first."""


class TrailSpan(NamedTuple):
    """How much of the paths is shown."""

    seconds: float | None  # up to the instant shown; None: since the start
    ahead: bool = False  # the rest of the path too
    anchored: bool = False  # since the anchor

    def around(self, t: float, anchor: float) -> tuple[float, float]:
        """From when to when, s, at the instant `t`; anchor: s, the last before it."""
        since = anchor if self.anchored else -np.inf if self.seconds is None else t - self.seconds
        return since, np.inf if self.ahead else t


NO_BIAS = (0.0, 0.0, 0.0)
Corrected = Literal["no", "flight", "file"]


@dataclass(frozen=True, slots=True)
class ReplayChoice:
    """Which IMU of a flight is dead-reckoned, and how."""

    imu: str | None = None  # message name; None: the flight's default
    others: tuple[str, ...] = ()  # IMUs whose trajectories are shown beside it, as they are
    how: Integration = field(default_factory=Integration)  # but for its gravity, which may depend on the flight
    gravity: str | float = "standard"  # "standard" (9.80665), "normal" (WGS-84 where it flew), or m/s²
    reanchor_s: float | None = 10.0  # start again from the autopilot's state every so many s; None: run free
    start_s: float | None = None  # s, boot clock, of the first anchor; None: as early as possible
    horizon_s: float = 5.0  # length of the windows of the drift "after so many seconds"
    correction: Corrected = "no"  # take out what calibration finds in this flight, or what is in a file
    gyro_bias: tuple[float, float, float] = NO_BIAS  # rad/s, FRD, taken off the readings
    accel_bias: tuple[float, float, float] = NO_BIAS  # m/s², FRD, taken off the readings

    def integration(self, flight: Flight) -> Integration:
        """How, for this flight. Raises DataError when gravity depends on where it flew and the log does not tell."""
        return replace(self.how, gravity=gravity_for(flight, self.gravity))

    @property
    def corrects(self) -> bool:
        """Whether the IMU's readings are changed before they are integrated."""
        return self.correction != "no" or self.gyro_bias != NO_BIAS or self.accel_bias != NO_BIAS


Recompute = Callable[[Flight, ReplayChoice], DisplayTrajectory]
"""Dead-reckons a flight as chosen. Raises CompanionError when that cannot be done. Runs in a worker thread."""
Examine = Callable[[Flight, ReplayChoice, DisplayTrajectory], AnalysisResult]
"""The analysis of what was dead-reckoned. Raises CompanionError likewise. Runs in another worker thread."""


@dataclass(frozen=True, slots=True)
class Offer:
    """What else can be chosen from, and said of what is shown. Its calls raise CompanionError as `Examine` does.

    judge: the verdict alone, which is known seconds before the rest; None: it comes with that. check: lanes and the
    checks before take-off, after the analysis in the same thread; report: one HTML file. None of either: nothing.
    """

    horizons_s: tuple[float, ...] = HORIZONS_S  # of the drift table
    correction_file: str | None = None  # the name of one that was given
    judge: Callable[[Flight, ReplayChoice, DisplayTrajectory], Verdict] | None = None
    check: Callable[[Flight, ReplayChoice, DisplayTrajectory], FlightChecks] | None = None
    report: Callable[[Flight, ReplayChoice, DisplayTrajectory], str] | None = None
    map_url: str | None = None  # template of a map's tiles; None: there is no map
    map_shown: bool = False  # from the start


_HORIZON_S = 5.0  # of the windows that the verdict is reached with


def first_horizon(horizons: Sequence[float]) -> float:
    """The one of a drift table that is shown first."""
    return _HORIZON_S if _HORIZON_S in horizons else horizons[len(horizons) // 2]


def chosen_track(flight: Flight, choice: ReplayChoice, correction: Correction = NO_CORRECTION) -> ImuTrack:
    """The readings of the chosen IMU with the correction and the chosen biases taken off."""
    track = flight.imu(choice.imu)
    if correction is not NO_CORRECTION:
        track = correction.apply(track)
    if choice.gyro_bias != NO_BIAS or choice.accel_bias != NO_BIAS:
        gyro, accel = Sensor(bias=np.array(choice.gyro_bias)), Sensor(bias=np.array(choice.accel_bias))
        track = correct(track, ImuModel(gyro, accel))
    return track
