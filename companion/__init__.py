"""companion: does this IMU agree with this autopilot, and if not, which of them is wrong?

    import companion as c

    flight = c.open_log("flight.tlog")[0]
    for row in c.drift(flight, horizons=(1, 5, 10)).rows:
        print(row.horizon_s, row.attitude_deg, row.position_m)

Conventions: SI units, seconds of the vehicle's boot clock, body FRD, world NED, Hamilton quaternions wxyz,
body to world.
"""

from companion import export
from companion.analysis import Drift, DriftRow, Integration, Limits, Replay, Statistic, drift, replay
from companion.errors import CompanionError, DataError, InputError, SettingsError
from companion.recording import open_log
from companion.series import Event, Series
from companion.strapdown import reckon
from companion.tracks import (
    AttitudeTrack,
    Flight,
    ImuTrack,
    MessageStats,
    NavState,
    PositionTrack,
    StatusText,
    Trajectory,
    Vehicle,
)

__all__ = [
    "AttitudeTrack",
    "CompanionError",
    "DataError",
    "Drift",
    "DriftRow",
    "Event",
    "Flight",
    "ImuTrack",
    "InputError",
    "Integration",
    "Limits",
    "MessageStats",
    "NavState",
    "PositionTrack",
    "Replay",
    "Series",
    "SettingsError",
    "Statistic",
    "StatusText",
    "Trajectory",
    "Vehicle",
    "drift",
    "export",
    "open_log",
    "reckon",
    "replay",
]
