"""What a simulator knows, what the controller wanted, and what it asked of the motors.

Sources: ArduPilot `SITL/SITL.cpp` (SIM, SIM2), `AP_AHRS/LogStructure.h` (ATT), `AP_Logger/LogStructure.h` (RCOU, RCO2,
RCO3).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from companion.logs import Records
from companion.model import ActuatorTrack, Array, ControlTrack, TruthTrack, from_euler
from companion.telemetry.control import actuators_of, control_of, side_by_side
from companion.telemetry.convert import trim
from companion.telemetry.dataflash.pose import ekf_origin
from companion.telemetry.samples import increasing
from companion.telemetry.sources import SI
from companion.telemetry.truth import truth_track

OUTPUTS = {"RCOU": 14, "RCO2": 4, "RCO3": 14}
"""Records of the outputs → how many they have; each goes on where the one before ends."""

NUMBERS: Mapping[str, tuple[str, ...]] = {
    "SIM": ("Lat", "Lng", "Alt", "Roll", "Pitch", "Yaw"),
    "SIM2": ("VN", "VE", "VD"),
}
"""Columns that these records must have."""

_DESIRED = ("DesRoll", "DesPitch", "DesYaw")


def truth(records: Mapping[str, Records]) -> TruthTrack | None:
    """SITL's own state: SIM, with the velocity of SIM2 where that is logged; position about the estimator's origin."""
    if "SIM" not in records:
        return None
    one = records["SIM"]
    if one.layout.has_numbers("Q1", "Q2", "Q3", "Q4"):
        q = one.columns("Q1", "Q2", "Q3", "Q4")
    else:
        q = from_euler(*np.radians(one.columns("Roll", "Pitch", "Yaw")).T)
    velocity = np.full((len(one), 3), np.nan)
    if "SIM2" in records:
        fine = records["SIM2"]
        for i, name in enumerate(("VN", "VE", "VD")):
            velocity[:, i] = np.interp(one.t, fine.t, fine[name], left=np.nan, right=np.nan)
    place = one.columns("Lat", "Lng", "Alt") * (SI["deg"], SI["deg"], 1.0)
    return truth_track("SIM", one.t, q, velocity, place, ekf_origin(records), None)


def control(
    records: Mapping[str, Records], parameters: Mapping[str, float], *, in_imu_frame: bool
) -> ControlTrack | None:
    """The desired attitude of ATT, in the frame of the attitude track.

    in_imu_frame: that is the IMU's; ATT speaks of the vehicle's, which AHRS_TRIM turns.
    """
    one = records.get("ATT")
    if one is None or not one.layout.has_numbers(*_DESIRED):
        return None
    angles = np.radians(one.columns(*_DESIRED))
    if not angles.any():
        return None
    q = from_euler(*angles.T)
    if in_imu_frame and (level := trim(parameters)) is not None:
        q = turned_by(q, from_euler(*level, 0.0))
    return control_of("ATT", one.t, q)


def turned_by(a: Array, b: Array) -> Array:
    """Hamilton product of quaternions (N, 4) with one (4,): first b, then a."""
    w, x, y, z = b
    right = np.array([[w, x, y, z], [-x, w, -z, y], [-y, z, w, -x], [-z, -y, x, w]])
    return np.asarray(a @ right)


def actuators(records: Mapping[str, Records], parameters: Mapping[str, float]) -> ActuatorTrack | None:
    """RCOU: the first 8 or 14 outputs; RCO2 and RCO3: 15 to 18, and 19 to 32. None where none of them is in use."""
    banks: list[tuple[Array, Array]] = []
    for name, count in OUTPUTS.items():
        one = records.get(name)
        if one is None and not banks:
            return None
        pulses = _pulses(one, count)
        keep = slice(0) if one is None else increasing(one.t, np.isfinite(one.t))
        banks.append((np.zeros(0) if one is None else one.t[keep], pulses[keep]))
    return actuators_of("RCOU", *side_by_side(banks), parameters)


def _pulses(one: Records | None, count: int) -> Array:
    """µs (N, count), NaN for outputs that the records lack."""
    if one is None:
        return np.zeros((0, count))
    names = [name for name in one.layout.fields if name != one.layout.clock and one.layout.has_numbers(name)][:count]
    pulses = np.full((len(one), count), np.nan)
    for i, name in enumerate(names):
        pulses[:, i] = one[name]
    return pulses
