"""The estimates beside the one that flies which ArduPilot sends: AHRS2, DCM while an EKF flies, and AHRS3."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from companion.model import EstimatorLane, Series, from_euler, of_kind
from companion.telemetry.samples import attitudes

_NAMES = {"AHRS2": "second estimate", "AHRS3": "third estimate"}
"""Since ArduPilot 3.5 AHRS2 is DCM while an EKF flies (`AP_AHRS.cpp`, _get_secondary_EKF_type); before, another EKF."""


def message_lanes(series: Mapping[str, Series]) -> tuple[EstimatorLane, ...]:
    """Their attitudes: they have no velocity, and a position of latitude and longitude alone."""
    made = []
    for one in of_kind(series, "attitude"):
        if one.source in _NAMES:
            _, t, q = attitudes(one.t, from_euler(one["roll_rad"], one["pitch_rad"], one["yaw_rad"]))
            unknown = np.full((len(t), 3), np.nan)
            made.append(EstimatorLane(t, q, unknown, unknown, _NAMES[one.source], None, one.source))
    return tuple(lane for lane in made if len(lane) > 1)
