"""Message layouts, units, CRC seeds and names of flight modes of a MAVLink dialect, from pymavlink's generated modules.

Nothing is retyped here: a layout is the message class of `pymavlink.dialects.v20.NAME` in the form NumPy reads.
Sources: https://mavlink.io/en/guide/serialization.html (wire order, CRC_EXTRA, extension fields).
"""

from __future__ import annotations

import difflib
import importlib
import pkgutil
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.model import SettingsError

DEFAULT_DIALECT = "ardupilotmega"
NO_VEHICLES = frozenset({5, 6, 18, 26, 27, 30, 31})
"""MAV_TYPE of components: tracker, ground station, companion, gimbal, ADS-B, camera, charging station."""

_FORMAT = re.compile(r"(\d*)([a-zA-Z])")  # one field of a struct format such as "<Ih4f20s"


@dataclass(frozen=True, slots=True, eq=False)
class MessageLayout:
    """The wire layout of one message."""

    id: int  # 24 bits; MAVLink 1 can carry ids below 256
    name: str  # as in the dialect: "RAW_IMU"
    crc_extra: int  # the byte that ends the CRC, so that both ends agree on the layout
    dtype: np.dtype[np.void]  # packed, little endian, wire order, extensions last; text is "S<n>", arrays are subarrays
    units: Mapping[str, str]  # field -> unit as written in the dialect ("mG", "mrad/s", "degE7"); absent: no unit
    min_length: int  # bytes without the extension fields: the payload of a MAVLink 1 frame

    @property
    def max_length(self) -> int:
        """Bytes with all extension fields: the untrimmed payload of a MAVLink 2 frame."""
        return self.dtype.itemsize

    @property
    def fields(self) -> tuple[str, ...]:
        """Field names in wire order."""
        return self.dtype.names or ()


@dataclass(frozen=True, slots=True, eq=False)
class Dialect:
    """The messages and enums of one dialect."""

    name: str
    by_id: Mapping[int, MessageLayout]
    by_name: Mapping[str, MessageLayout]
    crc_extra: npt.NDArray[np.int16]  # (largest id + 2,) by id, -1 where there is no such message; the last one is -1
    conforms_1: npt.NDArray[np.bool_]  # (65536,) by 256 times id plus length: whether MAVLink 1 can have such a frame
    enums: Mapping[str, Mapping[int, Any]]  # as pymavlink has them

    def enum_names(self, enum: str) -> Mapping[int, str]:
        """Value -> name of an enum, without the enum's own ("MAV_AUTOPILOT" -> {3: "ARDUPILOTMEGA", ...}).

        Raises SettingsError, with the nearest names, if the dialect has no such enum.
        """
        if enum not in self.enums:
            raise SettingsError(f"The dialect {self.name} has no enum {enum!r}.{_nearest(enum, self.enums)}")
        # The generator ends each enum with a sentinel that is no value of it.
        names = {value: str(entry.name) for value, entry in self.enums[enum].items()}
        names |= _RENAMED.get(enum, {})
        return {v: name.removeprefix(f"{enum}_") for v, name in names.items() if not name.endswith("_ENUM_END")}


@cache
def load_dialect(name: str = DEFAULT_DIALECT) -> Dialect:
    """The dialect `name`, any of `dialect_names()`; "all" is the union of them all.

    Raises SettingsError, with the nearest names, if pymavlink has no such dialect.
    """
    if name not in dialect_names():
        raise SettingsError(f"There is no MAVLink dialect {name!r}.{_nearest(name, dialect_names())}")
    # The v20 module is imported by its full name: pymavlink.mavutil would choose v10 or v20 by the environment
    # variable MAVLINK20, and takes six times as long to load.
    module = importlib.import_module(f"pymavlink.dialects.v20.{name}")
    layouts = {number: _layout(message, module.x25crc) for number, message in sorted(module.mavlink_map.items())}
    crc_extra = np.full(max(*layouts, 255) + 2, -1, np.int16)
    conforms_1 = np.zeros((256, 256), np.bool_)
    for number, layout in layouts.items():
        crc_extra[number] = layout.crc_extra
        if number < 256:  # MAVLink 1 has no others
            conforms_1[number, layout.min_length : layout.max_length + 1] = True
    return Dialect(
        name=name,
        by_id=MappingProxyType(layouts),
        by_name=MappingProxyType({layout.name: layout for layout in layouts.values()}),
        crc_extra=crc_extra,
        conforms_1=conforms_1.ravel(),
        enums=module.enums,
    )


@cache
def dialect_names() -> tuple[str, ...]:
    """The dialects that the installed pymavlink has, in alphabetical order."""
    package = importlib.import_module("pymavlink.dialects.v20")
    return tuple(sorted(module.name for module in pkgutil.iter_modules(package.__path__)))


def _layout(message: Any, x25crc: Any) -> MessageLayout:
    """One generated message class as a layout."""
    fields: list[tuple[Any, ...]] = []
    for field, (count, code) in zip(message.ordered_fieldnames, _FORMAT.findall(message.unpacker.format), strict=True):
        if code in "sc":
            fields.append((field, f"S{count or 1}"))
            continue
        kind = np.dtype(f"<{code}").str  # the letters of struct are NumPy's
        fields.append((field, kind, (int(count),)) if count else (field, kind))
    return MessageLayout(
        id=int(message.id),
        name=str(message.msgname),
        crc_extra=int(message.crc_extra),
        dtype=np.dtype(fields),
        units=MappingProxyType(dict(message.fieldunits_by_name)),
        min_length=np.dtype(fields[: _base_fields(message, x25crc)]).itemsize,
    )


def _base_fields(message: Any, x25crc: Any) -> int:
    """How many of the fields, in wire order, are not extensions.

    The generated classes lack it. But CRC_EXTRA is the CRC of name, types and names of exactly those fields, so it
    is the prefix of the fields with that CRC. Base fields also stand before extensions in the order of the XML. Of
    several such prefixes (one in 256 fits by chance) the longest is right for every message of pymavlink 2.4.50.
    """
    types = dict(zip(message.fieldnames, message.fieldtypes, strict=True))
    crc = x25crc(f"{message.msgname} ")
    base = len(types)
    for count, (field, length) in enumerate(zip(message.ordered_fieldnames, message.array_lengths, strict=True), 1):
        crc.accumulate(f"{types[field]} {field} ")
        if length:
            crc.accumulate([length])
        folded = (crc.crc & 0xFF) ^ (crc.crc >> 8)
        if folded == message.crc_extra and set(message.ordered_fieldnames[:count]) == set(message.fieldnames[:count]):
            base = count
    return base


def _nearest(name: str, known: Any) -> str:
    near = difflib.get_close_matches(name, list(known), n=5, cutoff=0.4)
    return f" Did you mean {', '.join(near)}?" if near else f" Known are: {', '.join(sorted(known))}."


_RENAMED: Mapping[str, Mapping[int, str]] = {
    "MAV_TYPE": {
        19: "VTOL_TAILSITTER_DUOROTOR", 20: "VTOL_TAILSITTER_QUADROTOR", 22: "VTOL_FIXEDROTOR", 23: "VTOL_TAILSITTER",
        24: "VTOL_TILTWING",
    },
}  # fmt: skip
"""MAVLink's own names (minimal.xml) of values that the dialects of pymavlink 2.4.50 have by older ones."""

_MODES_OF = {
    **dict.fromkeys((
        "QUADROTOR", "HEXAROTOR", "OCTOROTOR", "TRICOPTER", "HELICOPTER", "COAXIAL", "DECAROTOR", "DODECAROTOR",
    ), "COPTER_MODE"),
    **dict.fromkeys((
        "FIXED_WING", "VTOL_TILTROTOR", *_RENAMED["MAV_TYPE"].values(),
    ), "PLANE_MODE"),
    "GROUND_ROVER": "ROVER_MODE", "SURFACE_BOAT": "ROVER_MODE",
    "SUBMARINE": "SUB_MODE", "ANTENNA_TRACKER": "TRACKER_MODE",
}  # fmt: skip
"""MAV_TYPE → enum of the custom modes that ArduPilot gives it."""

# Common short names.
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

# PX4 msg/VehicleStatus.msg, nav_state: its own log has it in place of the above.
_PX4_NAV_STATE = {
    0: "MANUAL", 1: "ALTCTL", 2: "POSCTL", 3: "MISSION", 4: "LOITER", 5: "RTL", 10: "ACRO", 12: "DESCEND",
    13: "TERMINATION", 14: "OFFBOARD", 15: "STABILIZED", 17: "TAKEOFF", 18: "LAND", 19: "FOLLOWME", 20: "PRECLAND",
    21: "ORBIT", 22: "VTOL_TAKEOFF",
}  # fmt: skip


def mode_name(dialect: Dialect, autopilot: str, kind: str, custom_mode: int) -> str:
    """The name of HEARTBEAT.custom_mode ("LOITER"); "mode 99" where it has none.

    autopilot, kind: MAV_AUTOPILOT and MAV_TYPE without their prefix.
    """
    name = None
    if autopilot == "PX4":
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24
        name = _PX4_AUTO.get(sub) if main == _AUTO else _PX4_MAIN.get(main)
    elif autopilot == "ARDUPILOTMEGA" and (enum := _MODES_OF.get(kind)) and enum in dialect.enums:
        name = dialect.enum_names(enum).get(custom_mode)
    return _SHORT.get(name, name) if name else f"mode {custom_mode}"


def px4_nav_state_name(nav_state: int) -> str:
    """The same for vehicle_status.nav_state of PX4's log."""
    return _PX4_NAV_STATE.get(nav_state, f"mode {nav_state}")
