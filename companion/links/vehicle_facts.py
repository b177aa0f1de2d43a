"""Asks one vehicle for what it is: its firmware's version, and the few parameters that the comparison needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from companion.links import requests
from companion.links.requests import Request, Target
from companion.mavlink import Messages

PARAMETERS = (
    "AHRS_TRIM_X", "AHRS_TRIM_Y", "AHRS_ORIENTATION", "INS_GYRO_FILTER", "INS_ACCEL_FILTER", "INS_GYR_ID", "INS_GYR2_ID"
)  # fmt: skip
"""ArduPilot's: the frame of the attitude, the IMU's low-pass, and which parts measure."""

PX4_PARAMETERS = ("CAL_GYRO0_ID",)
"""PX4's: the part behind SCALED_IMU."""

_AUTOPILOT_VERSION = 148
_SPACING_S = 0.5
_ATTEMPTS = {"version": 2, "parameter": 4}  # at what is not answered


class Facts:
    """Messages and times go in, requests come out. Parameters outlive a reboot: each is known once it was said."""

    def __init__(self, target: Target, parameters: Sequence[str]) -> None:
        self._target = target
        self._parameters = dict.fromkeys(parameters, 0)  # not yet known → times asked
        self._version_asked = 0
        self._next = 0.0

    def hear(self, messages: Mapping[str, Messages]) -> None:
        """Take note of what the vehicle said."""
        if "PARAM_VALUE" in messages:
            for raw in messages["PARAM_VALUE"]["param_id"].tolist():
                self._parameters.pop(raw.split(b"\0")[0].decode("ascii", "replace"), None)
        if "AUTOPILOT_VERSION" in messages:
            self._version_asked = _ATTEMPTS["version"]

    def next_request(self, now: float) -> Request | None:
        """What to send now, if anything."""
        if now < self._next:
            return None
        self._next = now + _SPACING_S
        if self._version_asked < _ATTEMPTS["version"]:
            self._version_asked += 1
            return requests.request_message(self._target, _AUTOPILOT_VERSION)
        for name, times in self._parameters.items():
            if times < _ATTEMPTS["parameter"]:
                self._parameters[name] += 1
                return requests.read_parameter(self._target, name)
        return None
