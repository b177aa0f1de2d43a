"""The names of flight modes, as pymavlink, MAVProxy and ground stations have them."""

from __future__ import annotations

from companion.mavlink.dialect import Dialect

_ENUMS = {
    "COPTER_MODE": (
        "QUADROTOR", "HEXAROTOR", "OCTOROTOR", "TRICOPTER", "HELICOPTER", "COAXIAL", "DECAROTOR", "DODECAROTOR",
    ),
    "PLANE_MODE": (
        "FIXED_WING", "VTOL_DUOROTOR", "VTOL_QUADROTOR", "VTOL_TILTROTOR", "VTOL_TAILSITTER_DUOROTOR",
        "VTOL_TAILSITTER_QUADROTOR", "VTOL_FIXEDROTOR", "VTOL_TAILSITTER", "VTOL_TILTWING",
    ),
    "ROVER_MODE": ("GROUND_ROVER", "SURFACE_BOAT"),
    "SUB_MODE": ("SUBMARINE",),
    "TRACKER_MODE": ("ANTENNA_TRACKER",),
}  # fmt: skip
"""Enum of ArduPilot's custom modes → MAV_TYPE of the vehicles that use it."""

_ENUM_OF = {kind: enum for enum, kinds in _ENUMS.items() for kind in kinds}

# Where everybody says it more shortly than the enum.
_SHORT = {
    "FLY_BY_WIRE_A": "FBWA", "FLY_BY_WIRE_B": "FBWB", "INITIALIZING": "INITIALISING",
    "LOITER_ALT_QLAND": "LOITERALTQLAND",
}  # fmt: skip

# PX4 src/modules/commander/px4_custom_mode.h: the main mode, and the sub mode of AUTO.
_PX4_MAIN = {
    1: "MANUAL", 2: "ALTCTL", 3: "POSCTL", 5: "ACRO", 6: "OFFBOARD", 7: "STABILIZED", 8: "RATTITUDE",
    10: "TERMINATION",
}  # fmt: skip
_PX4_AUTO = {
    1: "READY", 2: "TAKEOFF", 3: "LOITER", 4: "MISSION", 5: "RTL", 6: "LAND", 7: "RTGS", 8: "FOLLOWME", 9: "PRECLAND",
    10: "VTOL_TAKEOFF",
}  # fmt: skip
_AUTO = 4

# PX4 msg/VehicleStatus.msg, nav_state: what its own log says in place of the above.
_PX4_NAV_STATE = {
    0: "MANUAL", 1: "ALTCTL", 2: "POSCTL", 3: "MISSION", 4: "LOITER", 5: "RTL", 10: "ACRO", 12: "DESCEND",
    13: "TERMINATION", 14: "OFFBOARD", 15: "STABILIZED", 17: "TAKEOFF", 18: "LAND", 19: "FOLLOWME", 20: "PRECLAND",
    21: "ORBIT", 22: "VTOL_TAKEOFF",
}  # fmt: skip


def mode_name(dialect: Dialect, autopilot: str, kind: str, custom_mode: int) -> str:
    """What HEARTBEAT.custom_mode says ("LOITER"); "mode 99" where nobody has a name for it.

    autopilot, kind: MAV_AUTOPILOT and MAV_TYPE without their prefix.
    """
    name = None
    if autopilot == "PX4":
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24
        name = _PX4_AUTO.get(sub) if main == _AUTO else _PX4_MAIN.get(main)
    elif autopilot == "ARDUPILOTMEGA" and (enum := _ENUM_OF.get(kind)) and dialect.has_enum(enum):
        name = dialect.enum_names(enum).get(custom_mode, "").removeprefix(f"{enum}_")
    return _SHORT.get(name, name) if name else f"mode {custom_mode}"


def px4_nav_state_name(nav_state: int) -> str:
    """The same for vehicle_status.nav_state of PX4's log."""
    return _PX4_NAV_STATE.get(nav_state, f"mode {nav_state}")
