"""companion: does this IMU agree with this autopilot, and if not, which of them is wrong?

>>> import companion as c
>>> flight = c.open_log("tlogs/copter-demo-100hz.tlog")[0]
>>> c.examine(flight).assessment.verdict.status
'consistent'
>>> for row in c.drift(flight, horizons=(1, 10)).rows:
...     print(f"{row.horizon_s:g} s: {row.attitude_deg.median:.2f}°, {row.position_m.median:.2f} m")
1 s: 0.04°, 0.02 m
10 s: 0.40°, 0.99 m

Conventions: SI units, seconds of the vehicle's boot clock, body FRD, world NED, Hamilton quaternions wxyz,
body to world.
"""

from companion import export
from companion.analysis import (
    Assessment,
    Calibration,
    Contrast,
    Drift,
    DriftRow,
    Finding,
    Integration,
    Limits,
    PoseError,
    Replay,
    Statistic,
    Verdict,
    ape,
    contrast,
    drift,
    replay,
    rpe,
)
from companion.errors import CompanionError, DataError, InputError, SettingsError
from companion.examination import Examination, examine
from companion.recording import open_log
from companion.series import Event, Series
from companion.settings import Settings, load_settings
from companion.strapdown import reckon
from companion.tracks import (
    AttitudeTrack,
    Epoch,
    Flight,
    ImuTrack,
    MessageStats,
    NavState,
    Origin,
    PositionTrack,
    StatusText,
    Trajectory,
    Vehicle,
)

__all__ = [
    "Assessment",
    "AttitudeTrack",
    "Calibration",
    "CompanionError",
    "Contrast",
    "DataError",
    "Drift",
    "DriftRow",
    "Epoch",
    "Event",
    "Examination",
    "Finding",
    "Flight",
    "ImuTrack",
    "InputError",
    "Integration",
    "Limits",
    "MessageStats",
    "NavState",
    "Origin",
    "PoseError",
    "PositionTrack",
    "Replay",
    "Series",
    "Settings",
    "SettingsError",
    "Statistic",
    "StatusText",
    "Trajectory",
    "Vehicle",
    "Verdict",
    "ape",
    "contrast",
    "drift",
    "examine",
    "export",
    "load_settings",
    "open_log",
    "reckon",
    "replay",
    "rpe",
]
