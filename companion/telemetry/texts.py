"""What a vehicle or a log wrote: made safe to show, and which firmware of ArduPilot wrote it.

The kind of vehicle, where no MAV_TYPE says, is that of the firmware's banner, build or parameters. Vendors have banners
of their own ("TQ-2.2.143", "FLYSTACK V4.5.7-beta1"), and a log may begin behind the banner: then VER.BU tells, before
4.0 SYSID_SW_TYPE, and last a parameter that only one of the vehicles has.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

UNKNOWN = "UNKNOWN"

_BANNER = re.compile(
    r"(?:Ardu|APM:)?(?P<name>Copter|Plane|Rover|Sub|Blimp|AntennaTracker) V(?P<version>\d[\w.-]*)", re.ASCII
)
_NAMES = {
    "Copter": "QUADROTOR",
    "Plane": "FIXED_WING",
    "Rover": "GROUND_ROVER",
    "Sub": "SUBMARINE",
    "Blimp": "AIRSHIP",
    "AntennaTracker": "ANTENNA_TRACKER",
}
_BUILDS = {
    1: "GROUND_ROVER", 2: "QUADROTOR", 3: "FIXED_WING", 4: "ANTENNA_TRACKER", 7: "SUBMARINE", 12: "AIRSHIP",
    13: "HELICOPTER",
}  # fmt: skip
"""VER.BU, AP_Vehicle_Type.h."""
_SOFTWARE: Mapping[float, str] = {
    0: "FIXED_WING", 4: "ANTENNA_TRACKER", 10: "QUADROTOR", 20: "GROUND_ROVER", 40: "SUBMARINE"
}  # fmt: skip
"""SYSID_SW_TYPE."""
_OWN_PARAMETERS = {
    "PILOT_THR_BHV": "QUADROTOR",
    "RLL2SRV_TCONST": "FIXED_WING",
    "CRUISE_SPEED": "GROUND_ROVER",
    "JS_GAIN_DEFAULT": "SUBMARINE",
}


def banner(texts: Iterable[str]) -> tuple[str, str] | None:
    """Type (MAV_TYPE without prefix) and version by the banner among the texts, "ArduCopter V4.7.0-dev (90700977)"."""
    match = next((match for text in texts if (match := _BANNER.match(text))), None)
    return (_NAMES[match["name"]], match["version"]) if match else None


def vehicle_type(parameters: Mapping[str, float], build: int | None = None) -> str:
    """Type by the build (VER.BU) and the parameters; UNKNOWN where neither tells."""
    if build in _BUILDS:
        return _BUILDS[build]
    software = _SOFTWARE.get(parameters.get("SYSID_SW_TYPE", -1.0))
    return software or next((kind for name, kind in _OWN_PARAMETERS.items() if name in parameters), UNKNOWN)


def release(code: int) -> str:
    """ "4.7.0" of a version in four bytes: major, minor, patch and type; "" of none."""
    return f"{code >> 24}.{code >> 16 & 255}.{code >> 8 & 255}" if code else ""


_COLOURS = re.compile(r"\x1b\[[0-9;]*m")  # PX4 writes its log texts for a terminal
_CONTROLS = {
    **dict.fromkeys((*range(32), *range(127, 160)), "\N{REPLACEMENT CHARACTER}"),
    **dict.fromkeys(map(ord, "\t\n\r"), " "),
}


def words(raw: bytes | str) -> str:
    """The text up to the first NUL, without the characters that command a terminal or begin a line there.

    Anybody on the link can send them: they would make colours, clear the screen, or write lines that seem to be ours.
    """
    text = raw.split(b"\0")[0].decode("utf-8", "replace") if isinstance(raw, bytes) else raw
    return text if text.isprintable() else _COLOURS.sub("", text).translate(_CONTROLS)
