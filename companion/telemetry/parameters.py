"""What parameters say of a vehicle and of its IMUs: device, range, filter, averaging, and whether biases are removed.

Also here: what a vehicle or a log wrote, made safe to show, and which firmware of ArduPilot wrote it. The kind of
vehicle, where no MAV_TYPE says, is that of the firmware's banner, build or parameters. Vendors have banners of their
own ("TQ-2.2.143", "FLYSTACK V4.5.7-beta1"), and a log may begin behind the banner: then VER.BU tells, before 4.0
SYSID_SW_TYPE, and last a parameter that only one of the vehicles has.

A value comes from damaged logs and untrusted links as well: whatever is read of it has to be in `RANGES`, and beyond
its range a parameter is unknown.

Sources: ArduPilot `AP_InertialSensor.cpp` (INS_GYR_ID, INS_GYRO_FILTER); PX4
`modules/mavlink/streams/HIGHRES_IMU.hpp`, `SCALED_IMU.hpp`, `modules/sensors/vehicle_imu/VehicleIMU.cpp`
(IMU_INTEG_RATE). Of the ranges: ArduPilot `AP_InertialSensor_*.cpp`; PX4 v1.16 `drivers/drv_sensor.h`, `drivers/imu/`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from companion.model import STANDARD_GRAVITY, Array, ImuTrack, SettingNames, Vehicle
from companion.telemetry.samples import Ranges

_USUAL = (2000.0, 16.0)
_UNKNOWN = (None, None)
_PART_RANGES: Mapping[str, Mapping[int | None, Ranges]] = {
    "ARDUPILOTMEGA": {
        None: _USUAL,  # of any other part
        0x2A: _UNKNOWN,  # SITL
        0x2B: (2000.0, 24.0),  # BMI088
        0x2E: (2000.0, 30.0),  # ICM20649
        0x30: (4000.0, 8.0),  # ICM20601
        0x31: (None, 40.0),  # ADIS1647x: 125, 500 or 2000 deg/s, by its model
        0x32: _UNKNOWN,  # external
        0x33: (2000.0, 32.0),  # ICM40609
        0x3B: (4000.0, 32.0),  # ICM45686
        0x3C: _UNKNOWN,  # SCHA63T
        0x3D: (4000.0, 32.0),  # IIM42653
    },
    "PX4": {
        # MPU6000, MPU9250, ICM42688P, ICM20948, ICM42605, MPU6500, ICM20602, ICM20608G, ICM20689
        **dict.fromkeys((0x21, 0x24, 0x26, 0x28, 0x29, 0x36, 0x38, 0x3A, 0x3C), _USUAL),
        0x25: (4000.0, 30.0),  # ICM20649
        0x41: (None, 16.0),  # BMI055, its accelerometer
        0x42: (2000.0, None),  # and its gyro
        0x66: (2000.0, None),  # BMI088, its gyro
        0x6A: (None, 24.0),  # and its accelerometer
    },
}
"""Autopilot → type (bits 16-23 of a device id) → deg/s and g; None where a driver has several, or it is not known."""


def part_ranges(autopilot: str, gyro_id: int | None, accel_id: int | None) -> Ranges:
    """rad/s and m/s², by the device ids of a gyro and an accelerometer; None where one is not known."""
    table = _PART_RANGES.get(autopilot, {})
    (degrees, _), (_, g) = (
        table.get(part >> 16 & 0xFF, table.get(None, _UNKNOWN)) if part else _UNKNOWN for part in (gyro_id, accel_id)
    )
    return None if degrees is None else float(np.radians(degrees)), None if g is None else g * STANDARD_GRAVITY


# MAV_PARAM_TYPE: UINT8, INT8, UINT16, INT16, UINT32, INT32 (common.xml). A float rounds the largest up to a power of 2.
_RANGES = {
    1: (0.0, 2.0**8 - 1), 2: (-(2.0**7), 2.0**7 - 1), 3: (0.0, 2.0**16 - 1), 4: (-(2.0**15), 2.0**15 - 1),
    5: (0.0, 2.0**32), 6: (-(2.0**31), 2.0**31),
}  # fmt: skip


def out_of_range(values: Array, types: Array) -> Array:
    """Which values (N,) are none of their MAV_PARAM_TYPE (N,), NaN and infinity among them."""
    wrong = ~np.isfinite(values)
    for number, (low, high) in _RANGES.items():
        wrong |= (types == number) & ~((values >= low) & (values <= high))
    return np.asarray(wrong)


def declination(parameters: Mapping[str, float]) -> float:
    """The magnetic declination, rad; 0: none, as before ArduPilot has looked it up for the place."""
    return parameters.get("COMPASS_DEC", 0.0)


@dataclass(frozen=True, slots=True)
class Range:
    """What parameters of some names can be."""

    names: str  # a regular expression
    low: float
    high: float
    unit: str = ""
    or_zero: bool = False  # stands for "none"

    def has(self, values: Array) -> npt.NDArray[np.bool_]:
        """Which values (N,) are inside; no NaN is."""
        return np.asarray((self.low <= values) & (values <= self.high) | (self.or_zero & (values == 0.0)))

    def __str__(self) -> str:
        zero = "0, or " if self.or_zero else ""
        return f"{zero}{self.low:g} to {self.high:g} {self.unit}".rstrip()


RANGES = (
    Range(r"INS_(GYRO|ACCEL)_FILTER|IMU_(GYRO|ACCEL)_CUTOFF", 1.0, 1000.0, "Hz", or_zero=True),
    Range(r"IMU_INTEG_RATE", 50.0, 2000.0, "Hz"),
    Range(r"COMPASS_DEC|AHRS_TRIM_[XY]", -np.pi, np.pi, "rad"),
    Range(r"PTCH_TRIM_DEG", -90.0, 90.0, "°"),
    Range(r"TRIM_PITCH_CD", -9000.0, 9000.0, "0.01°"),
    Range(r"FLIGHT_OPTIONS", 0.0, 2.0**31),
    Range(r"INS(_|\d_)(GYR|ACC)\d?_ID|CAL_(GYRO|ACC|MAG)\d_ID", 0.0, 2.0**32),
    Range(r"CAL_GYRO\d_[XYZ]OFF", -5.0, 5.0, "rad/s"),
    Range(r"CAL_ACC\d_[XYZ]OFF", -50.0, 50.0, "m/s²"),
    Range(r"CAL_(GYRO|ACC)\d_[XYZ]SCALE", 0.1, 3.0),
    Range(r"CAL_(GYRO|ACC)\d_ROT|SENS_BOARD_ROT", -1.0, 255.0),
    Range(r"SENS_BOARD_[XYZ]_OFF", -180.0, 180.0, "°"),
    Range(r"CAL_MAG\d_ROT|AHRS_ORIENTATION|COMPASS_ORIENT[23]?", -1.0, 255.0),
    Range(r"COMPASS_EXTERN(AL|2|3)|COMPASS_AUTODEC|EKF2_DECL_TYPE", 0.0, 255.0),
    Range(r"EKF2_MAG_DECL|ATT_MAG_DECL", -180.0, 180.0, "°"),
    Range(r"GPS1?_DELAY_MS|EKF2_GPS_DELAY", 0.0, 1000.0, "ms"),
    Range(r"GPS(1_POS|_POS1)_[XYZ]|INS_POS\d_[XYZ]|EKF2_(GPS|IMU)_POS_[XYZ]", -100.0, 100.0, "m"),
    Range(r"AHRS_EKF_(TYPE|USE)|EK[23]_(IMU_MASK|PRIMARY)|Q_ENABLE", 0.0, 255.0),
    Range(r"MAV_SYSID|SYSID_(THISMAV|SW_TYPE)|MAV_(SYS|COMP)_ID|MAV_TYPE", 0.0, 255.0),
    Range(r"SERVO\d+_FUNCTION", -1.0, 1000.0),
    Range(r"SERVO\d+_(MIN|MAX)|MOT_PWM_(MIN|MAX)", 0.0, 5000.0, "µs"),
    Range(r"BRD_SERIAL_NUM", -(2.0**31), 2.0**31),
)
"""Of every parameter that is read: what the parts and the firmware allow, with room for what is odd but possible."""

_MOST_NOTED = 5


@lru_cache(maxsize=4096)  # a vehicle has some 1000 parameters, sent again and again
def range_of(name: str) -> Range | None:
    """The row of RANGES for a parameter; None for one that is not read."""
    return next((one for one in RANGES if re.fullmatch(one.names, name, re.ASCII)), None)


def possible(names: Sequence[bytes | str], values: Array, notes: list[str]) -> Array:
    """Values (N,) of parameters, NaN where they are no finite number, or beyond what a parameter of that name can be.

    What is so of parameters that are read is added to the notes.
    """
    kept = np.where(np.isfinite(values), values, np.nan)
    rows: dict[bytes | str, list[int]] = {}
    for row, name in enumerate(names):
        rows.setdefault(name, []).append(row)
    odd = []
    for raw, own in rows.items():
        name = words(raw)
        if (one := range_of(name)) is not None and not (good := one.has(values[own])).all():
            wrong = np.array(own)[~good]
            kept[wrong] = np.nan
            odd.append(f"{name} = {values[wrong[-1]]:g} (possible: {one})")
    if odd:
        more = f" and {len(odd) - _MOST_NOTED} more" if len(odd) > _MOST_NOTED else ""
        notes.append(f"parameters out of range are treated as unknown: {', '.join(odd[:_MOST_NOTED])}{more}")
    return kept


def values_of(names: Sequence[bytes | str], values: Array, *, first: bool = False) -> dict[str, float]:
    """The last value of every parameter that has one, or the first; names and values: (N,) in order of time."""
    decoded = {name: words(name) for name in set(names)}  # sent many times
    named = [(decoded[n], v) for n, v in zip(names, values.tolist(), strict=True) if math.isfinite(v)]
    return dict(reversed(named) if first else named)


_AT_BOOT = ("EK2_IMU_MASK", "EK3_IMU_MASK")  # read where the EKF begins: another value is of the next boot


def at_boot(parameters: Mapping[str, float], at_first: Mapping[str, float]) -> dict[str, float]:
    """The parameters as they work: of those that are read at boot alone the first value, of others the last."""
    return {**parameters, **{name: at_first[name] for name in _AT_BOOT if name in at_first}}


def identity(parameters: Mapping[str, float], *names: str, otherwise: int = 1) -> int:
    """The first that there is of these, a MAVLink id."""
    return int(next((parameters[name] for name in names if name in parameters), otherwise))


def px4_vehicle(parameters: Mapping[str, float], kind: str, firmware: str = "") -> Vehicle:
    """The vehicle of an on-board log; kind: MAV_TYPE without prefix."""
    ids = identity(parameters, "MAV_SYS_ID"), identity(parameters, "MAV_COMP_ID")
    return Vehicle(*ids, autopilot="PX4", type=kind, firmware=firmware)


NOT_EKF: Mapping[float, str] = {0.0: "DCM", 10.0: "the simulator, its truth", 11.0: "an external AHRS"}
"""AHRS_EKF_TYPE → by whom the vehicle flies in place of an EKF (ArduPilot `AP_AHRS/AP_AHRS.h`, EKFType)."""

_NAMES: Mapping[str, SettingNames] = {
    "ARDUPILOTMEGA": SettingNames(
        full_rate=" (LOG_BITMASK: fast or raw IMU)",
        imu_stream="SRx_RAW_SENS or SET_MESSAGE_INTERVAL",
        board_trim="AHRS_TRIM_X, _Y",
        imu_place="INS_POSn_X, _Y, _Z",
    ),
    "PX4": SettingNames(
        full_rate=" (SDLOG_PROFILE: high rate)",
        imu_stream="SCALED_IMU on an onboard link (MAV_x_MODE 2)",
        board_trim="SENS_BOARD_X_OFF, _Y_OFF",
        imu_place="EKF2_IMU_POS_X, _Y, _Z",
    ),
}


def setting_names(autopilot: str) -> SettingNames:
    """Those of an autopilot (MAV_AUTOPILOT without prefix), in general words where it is neither."""
    return _NAMES.get(autopilot, SettingNames())


def with_facts(track: ImuTrack, vehicle: Vehicle, parameters: Mapping[str, float]) -> ImuTrack:
    """The track with what is known of its sensor. PX4's samples are means: their times are moved to the middles."""
    ardupilot_id, px4_id = id_parameters("gyro", track.instance)
    if vehicle.autopilot == "PX4":
        track = replace(track, device_id=_device(parameters, px4_id), bias_removed=track.source == "HIGHRES_IMU")
        if (rate := parameters.get("IMU_INTEG_RATE")) is not None:
            track = replace(track, t=track.t - 0.5 / rate, interval=np.full(len(track), 1.0 / rate))
    elif vehicle.autopilot == "ARDUPILOTMEGA":
        gyro_range, accel_range = known_ranges(vehicle, parameters, track.instance)
        track = replace(
            track,
            device_id=_device(parameters, ardupilot_id),
            gyro_low_pass_hz=parameters.get("INS_GYRO_FILTER"),
            accel_low_pass_hz=parameters.get("INS_ACCEL_FILTER"),
            gyro_range=gyro_range,
            accel_range=accel_range,
        )
    return track


def known_ranges(vehicle: Vehicle, parameters: Mapping[str, float], instance: int) -> Ranges:
    """Of the gyro and accelerometer of an IMU, by their device ids: on ArduPilot, where the parameters are known."""
    if vehicle.autopilot != "ARDUPILOTMEGA":
        return None, None
    gyro, accel = (_device(parameters, id_parameters(sensor, instance)[0]) for sensor in ("gyro", "accel"))
    return part_ranges(vehicle.autopilot, gyro, accel)


def of_instance(track: ImuTrack, instance: int, parameters: Mapping[str, float]) -> ImuTrack:
    """PX4's HIGHRES_IMU, which says IMU 0 whatever sensor it speaks of, as that of the selected one."""
    return replace(track, instance=instance, device_id=_device(parameters, id_parameters("gyro", instance)[1]))


def id_parameters(sensor: str, instance: int) -> tuple[str, str]:
    """What the device id of an IMU's "gyro" or "accel" is called: by ArduPilot, and by PX4.

    INS_GYR_ID, INS_GYR2_ID, INS_GYR3_ID, INS4_GYR_ID, ...; CAL_GYRO0_ID, CAL_GYRO1_ID, ...
    """
    ardupilot, px4 = {"gyro": ("GYR", "GYRO"), "accel": ("ACC", "ACC")}[sensor]
    number = instance + 1 if instance else ""
    return (f"INS{number}_{ardupilot}_ID" if instance > 2 else f"INS_{ardupilot}{number}_ID", f"CAL_{px4}{instance}_ID")


def _device(parameters: Mapping[str, float], name: str) -> int | None:
    return int(parameters.get(name, 0.0)) or None


UNKNOWN = "UNKNOWN"


class _Firmware(NamedTuple):
    """What tells that one of ArduPilot's firmwares wrote a log."""

    type: str  # MAV_TYPE without prefix
    name: str  # in its banner
    build: int  # VER.BU, AP_Vehicle_Type.h
    software: float = math.nan  # SYSID_SW_TYPE
    parameter: str | None = None  # that no other has


_FIRMWARES = (
    _Firmware("QUADROTOR", "Copter", 2, 10, "PILOT_THR_BHV"),
    _Firmware("FIXED_WING", "Plane", 3, 0, "RLL2SRV_TCONST"),
    _Firmware("GROUND_ROVER", "Rover", 1, 20, "CRUISE_SPEED"),
    _Firmware("SUBMARINE", "Sub", 7, 40, "JS_GAIN_DEFAULT"),
    _Firmware("AIRSHIP", "Blimp", 12),
    _Firmware("ANTENNA_TRACKER", "AntennaTracker", 4, 4),
    _Firmware("HELICOPTER", "Copter", 13),  # whose banner is that of the multicopter
)

_BANNER = re.compile(
    rf"(?:Ardu|APM:)?(?P<name>{'|'.join(one.name for one in _FIRMWARES)}) V(?P<version>\d[\w.-]*)", re.ASCII
)


def banner(texts: Iterable[str]) -> tuple[str, str] | None:
    """Type (MAV_TYPE without prefix) and version by the banner among the texts, "ArduCopter V4.7.0-dev (90700977)"."""
    match = next((match for text in texts if (match := _BANNER.match(text))), None)
    return (next(one.type for one in _FIRMWARES if one.name == match["name"]), match["version"]) if match else None


def vehicle_type(parameters: Mapping[str, float], build: int | None = None) -> str:
    """Type by the build (VER.BU) and the parameters; UNKNOWN where neither tells."""
    software = parameters.get("SYSID_SW_TYPE")
    known = (
        *(one.type for one in _FIRMWARES if one.build == build),
        *(one.type for one in _FIRMWARES if one.software == software),
        *(one.type for one in _FIRMWARES if one.parameter in parameters),
    )
    return known[0] if known else UNKNOWN


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
