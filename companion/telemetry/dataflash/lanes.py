"""Every core of an ArduPilot log's EKF as a lane of its own, and DCM, which runs along as the fallback.

Sources: ArduPilot `AP_NavEKF3/LogStructure.h`, `AP_AHRS/AP_AHRS.cpp` (_get_secondary_EKF_type): AHR2 is DCM while an
EKF flies.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from companion.logs import Records
from companion.model import Array, EstimatorLane, SensorInUse, from_euler
from companion.telemetry.aiding import has_position
from companion.telemetry.convert import trim
from companion.telemetry.dataflash.cores import (
    NUMBERS,
    Flew,
    imu_of_core,
    of_cores,
    primary_cores,
    sensors_of_core,
)
from companion.telemetry.dataflash.pose import by_dcm, turned_by
from companion.telemetry.samples import attitudes, in_use

_EULER = ("Roll", "Pitch", "Yaw")
_NAMES = {"XK": "EKF3", "NK": "EKF2", "EK": "EKF1"}
_LONGEST_WAIT_S = 0.05  # XKQ and XKF1 of a core are written one after the other


def lane_in_use(records: Mapping[str, Records], mine: Flew) -> SensorInUse | None:
    """The core that flew, from each change on (XKF4.PI)."""
    status = primary_cores(records, mine.prefix)
    if status is None:
        return None
    core = status["PI"].astype(np.int64)
    return in_use(f"{status.name}.PI", status.t, core, core >= 0)


def lanes(
    records: Mapping[str, Records], parameters: Mapping[str, float], mine: Flew, *, in_imu_frame: bool
) -> tuple[EstimatorLane, ...]:
    """The cores of the EKF that flew in order of their numbers, then DCM; in the frame of the attitude track.

    in_imu_frame: that is the IMU's, in which XKQ is; else AHRS_TRIM turns it, as in XKF1's own angles.
    """
    made = [*_cores(records, parameters, mine, in_imu_frame=in_imu_frame)]
    if (one := records.get("AHR2")) is not None and not by_dcm(parameters) and one.layout.has_numbers(*_EULER):
        q = _angles(one)
        if in_imu_frame and (level := trim(parameters)) is not None:
            q = turned_by(q, from_euler(*level, 0.0))
        _, t, q = attitudes(one.t, q)
        unknown = np.full((len(t), 3), np.nan)
        made.append(EstimatorLane(t, q, unknown, unknown, "DCM", None, "AHR2"))
    return tuple(lane for lane in made if len(lane) > 1)


def _cores(
    records: Mapping[str, Records], parameters: Mapping[str, float], mine: Flew, *, in_imu_frame: bool
) -> Iterator[EstimatorLane]:
    quaternions = of_cores(records, f"{mine.prefix}Q") if in_imu_frame else {}
    states, status = (of_cores(records, mine.prefix + name) for name in ("F1", "F4"))
    for core in sorted(quaternions.keys() | states.keys()):
        state = states.get(core)
        if (one := quaternions.get(core)) is not None:
            t, q = one.t, one.columns("Q1", "Q2", "Q3", "Q4")
        elif not in_imu_frame and state is not None and state.layout.has_numbers(*_EULER):
            one, t, q = state, state.t, _angles(state)
        else:
            continue
        _, t, q = attitudes(t, q)
        velocity, position = _moved(t, state, status.get(core))
        yield EstimatorLane(
            t, q, velocity, position, f"{_NAMES[mine.prefix]} core {core}", core, f"{one.name}[{core}]",
            imu_of_core(core, mine.prefix, parameters), sensors_of_core(records, mine.prefix, core),
        )  # fmt: skip


def _angles(one: Records) -> Array:
    return from_euler(*np.radians(one.columns(*_EULER)).T)


def _moved(t: Array, state: Records | None, status: Records | None) -> tuple[Array, Array]:
    """Velocity and position (N, 3) at times t (N,), where the core calls its horizontal position known; else NaN."""
    velocity, position = np.full((len(t), 3), np.nan), np.full((len(t), 3), np.nan)
    if state is None or len(state) < 2 or not len(t) or not state.layout.has_numbers(*NUMBERS["XKF1"][:6]):
        return velocity, position
    row = np.clip(np.searchsorted(state.t, t - _LONGEST_WAIT_S), 0, len(state) - 1)
    good = np.abs(state.t[row] - t) <= _LONGEST_WAIT_S
    if status is not None and len(status) and status.layout.has_numbers("SS"):
        good &= has_position(t, status.t, status["SS"].astype(np.float64))
    columns = [np.where(good, state.in_unit(name)[row], np.nan) for name in NUMBERS["XKF1"][:6]]
    return np.column_stack(columns[3:]), np.column_stack(columns[:3])
