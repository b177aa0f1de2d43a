"""Which field of which message, record or topic becomes which column of a flight's series: the one table of all three.

A row for each sensor that a MAVLink message tells of, a record of ArduPilot's log (all sensors of its kind) or a topic
of PX4's (all of its instances). A kind that has a typed track (see `companion.telemetry.aiding`) has it from every row
with these columns. What the columns mean is in docs/messages.md.

The first source of a kind is called by the kind ("gps"), each further one by kind and source ("gps:GPS2_RAW");
temperatures, of which each belongs to an IMU, always by both. Values are made when they are first read: of most of a
flight, most never are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from companion.model import IMU_MESSAGES, STANDARD_GRAVITY, Array, Series
from companion.telemetry.samples import increasing

T = TypeVar("T")
Raw = npt.NDArray[Any]


class Lazy(Mapping[str, T]):
    """Name → value, made once by the name's maker, which is forgotten with all that it held."""

    def __init__(self, makers: Mapping[str, Callable[[], T]]) -> None:
        self._names = tuple(makers)
        self._makers = dict(makers)
        self._known: dict[str, T] = {}

    def __getitem__(self, name: str) -> T:
        if name not in self._known and name in self._makers:
            self._known[name] = self._makers[name]()
            del self._makers[name]
        return self._known[name]

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


class LazyTuple(Sequence[T]):
    """A tuple whose items are made together, by its maker, when it is first looked into."""

    def __init__(self, maker: Callable[[], Sequence[T]]) -> None:
        self._maker: Callable[[], Sequence[T]] | None = maker
        self._known: tuple[T, ...] = ()

    def __getitem__(self, index: Any) -> Any:
        return self._items()[index]

    def __len__(self) -> int:
        return len(self._items())

    def _items(self) -> tuple[T, ...]:
        if self._maker is not None:
            self._known = tuple(self._maker())
            self._maker = None
        return self._known


_UNKNOWN: Mapping[str, Mapping[str, tuple[float, ...]]] = {
    # GPS_RAW_INT
    "gps": {"satellites": (255.0,), "speed_mps": (655.35,), "hdop": (655.35,), "course_rad": (math.radians(655.35),)},
    # SYS_STATUS, BATTERY_STATUS, and PX4's battery_status
    "battery": {"voltage_v": (0.0, 65.535), "current_a": (-0.01, -1.0)},
    # AIRSPEED
    "airspeed": {"temperature_degc": (327.67,)},
}
"""Kind → column → what stands in it for "not known"."""

SIGMAS = ("horizontal_sigma_m", "vertical_sigma_m", "speed_sigma_mps")
_FIX_2D, _FIX_3D = 2, 3  # GPS_FIX_TYPE
_POLE = math.radians(89.9)  # nobody flies there: a latitude of 90° is a receiver that has no fix


@dataclass(frozen=True, slots=True, eq=False)
class RawSeries:
    """The raw columns of one source, and what makes them SI."""

    kind: str
    source: str
    t: Array  # (N,) s, boot clock; NaN where it is not known
    raw: Mapping[str, tuple[Raw, float]]  # column → (N,), as the log has it, and the factor that makes it SI
    instance: int = 0  # which sensor of its kind


def raw_series(
    row: Source,
    source: str,
    t: Array,
    column: Callable[[str], Raw | None],
    units: Mapping[str, str] | None = None,
    *,
    instance: int = 0,
    notes: list[str] | None = None,
) -> RawSeries | None:
    """What a source has of a kind; None when that is nothing. `column` gives a field of the source, None for none.

    A sensor that is zero throughout is none, and is noted.
    """
    raw: dict[str, tuple[Raw, float]] = {}
    for name, ways in row.fields.items():
        for field, unit in ways:
            if (values := column(field)) is not None:
                stated = (units or {}).get(field, "")
                factor = SI[stated if stated in SI and stated else unit]
                raw[name] = np.array(values), factor  # not a view: the rows need not stay for it
                break
    silent = row.kind in NONE_IF_ZERO and not any(v.any() for v, _ in raw.values())
    if silent and raw and len(t) and notes is not None and NONE_IF_ZERO[row.kind] and row.noted:
        notes.append(f"{source} left out as {row.kind}: it is zero throughout")
    return None if not raw or not len(t) or silent else RawSeries(row.kind, source, t, raw, instance)


def series_of(several: Iterable[RawSeries | None]) -> Mapping[str, Series]:
    """The series of a flight by key, in the order found, each made when it is read."""
    makers: dict[str, Callable[[], Series]] = {}
    for one in several:
        if one is not None:
            alone = one.kind != "temperature" and one.kind not in makers
            makers[one.kind if alone else f"{one.kind}:{one.source}"] = partial(_series, one)
    return Lazy(makers)


def _series(series: RawSeries) -> Series:
    known = COLUMNS.get(series.kind, ())
    names = known if series.raw.keys() <= set(known) else tuple(series.raw)
    values = np.full((len(series.t), len(names)), np.nan)
    for i, name in enumerate(names):
        if name in series.raw:
            values[:, i] = np.multiply(*series.raw[name])
    columns = {name: values[:, i] for i, name in enumerate(names)}  # views: what follows changes `values`
    values[~np.isfinite(values)] = np.nan
    for name, absent in _UNKNOWN.get(series.kind, {}).items():
        for value in absent:
            columns[name][np.isclose(columns[name], value, atol=1e-6)] = np.nan
    if series.kind == "gps":
        _without_fix(columns)
    if series.kind == "range" and series.source.startswith("DISTANCE_SENSOR"):
        quality = columns["quality"]
        quality[quality == 0.0] = np.nan  # "unknown", as of a sender without the field
        quality[quality == 1.0] = 0.0  # "invalid signal"
    if series.kind == "battery":
        columns["remaining"][~((columns["remaining"] >= 0.0) & (columns["remaining"] <= 1.0))] = np.nan
    if series.kind == "barometer" and np.isnan(columns["altitude_m"]).all():
        columns["altitude_m"][:] = pressure_altitude(columns["pressure_pa"])
    good = np.isfinite(series.t) & ~np.isnan(values).all(axis=1)
    if series.kind == "temperature":
        good &= values[:, 0] != 0.0  # MAVLink: 0 is "no thermometer", and a true 0 °C is sent as 0.01
    keep = increasing(series.t, np.asarray(good))
    return Series(series.t[keep], values[keep], names, series.source, series.instance)


def _without_fix(gps: Mapping[str, Array]) -> None:
    """NaN for what a receiver does not know without a fix, or without one in three dimensions."""
    for name in SIGMAS:
        gps[name][~(gps[name] > 0.0)] = np.nan  # 0 is "not known": the extension fields of an older sender
    nowhere = (gps["fix_type"] < _FIX_2D) | ((gps["lat_rad"] == 0.0) & (gps["lon_rad"] == 0.0))
    nowhere |= ~(np.abs(gps["lat_rad"]) < _POLE)
    for name in ("lat_rad", "lon_rad", "height_m", "course_rad", "speed_mps", "vn_mps", "ve_mps", "vd_mps", *SIGMAS):
        gps[name][nowhere] = np.nan
    gps["height_m"][gps["fix_type"] < _FIX_3D] = np.nan


def pressure_altitude(pressure: Array) -> Array:
    """m, where the standard atmosphere has this pressure (ICAO Doc 7488, below 11 km)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(44330.77 * (1.0 - (pressure / 101325.0) ** 0.1902632))


SI = {
    **dict.fromkeys(("", "m/s/s", "m/s", "m", "rad/s", "rad", "Pa", "V", "A"), 1.0),
    **dict.fromkeys(("cm", "cm/s", "cA", "cdegC", "hundredths"), 1e-2),
    **dict.fromkeys(("mm", "mm/s", "mrad/s", "mV"), 1e-3),
    "mG": STANDARD_GRAVITY * 1e-3,
    "hPa": 100.0,
    "degC": 1.0,  # temperatures stay in °C, as every data sheet has them
    **dict.fromkeys(("deg", "deglatitude", "deglongitude"), float(np.radians(1.0))),
    "cdeg": float(np.radians(1e-2)),
    "degE7": float(np.radians(1e-7)),
    **dict.fromkeys(("gauss", "Gauss"), 1e-4),  # tesla
    "mgauss": 1e-7,
    "percent": 1e-2,  # where it is to be a share: "%" as logs state it stays as it is
}
"""Unit of MAVLink's dialects, of DataFlash's UNIT records or of PX4's topics → factor."""

Fields = dict[str, tuple[tuple[str, str], ...]]
"""Column → the fields that it may come from, the first that there is, each with its unit where the log states none."""


@dataclass(frozen=True, slots=True)
class Source:
    """What a message, a kind of record or a topic says of one kind of sensor."""

    name: str  # of records: of the first sensor, and since 2020 of all, with an instance column
    kind: str
    fields: Fields
    instance: int = 0  # which sensor of its kind: of IMU and compass a message has one each
    by: tuple[str, ...] = ()  # the fields by which a message tells several sensors apart
    others: tuple[str, ...] = ()  # records of the second and third sensor before 2020, and of older estimators
    sampled: str = ""  # the column of a record with the time of the sample itself; "": that of the record is
    noted: bool = True  # whether zeros throughout are worth a note, and do not say that there is no such sensor

    @property
    def names(self) -> tuple[str, ...]:
        """All records that it is for."""
        return (self.name, *self.others)


def _of(columns: str, fields: str, unit: str = "") -> Fields:
    """Columns, and the field of each, all of one unit."""
    return {column: ((field, unit),) for column, field in zip(columns.split(), fields.split(), strict=True)}


def _or(today: Fields, before: Fields) -> Fields:
    """The same columns, and what older firmware calls their fields."""
    return {column: ways + before.get(column, ()) for column, ways in today.items()}


def _each(pattern: str, places: Iterable[int | str] = range(3)) -> str:
    """A name for each place in it: "q[{}]" → "q[0] q[1] q[2]"."""
    return " ".join(pattern.format(place) for place in places)


_TESLA, _MPS2, _RADPS = _each("{}_tesla", "xyz"), _each("{}_mps2", "xyz"), _each("{}_radps", "xyz")
_ANGLES, _NED_MPS, _NED_M = "roll_rad pitch_rad yaw_rad", "vn_mps ve_mps vd_mps", "north_m east_m down_m"
_RATIOS = "velocity_ratio position_ratio height_ratio compass_ratio airspeed_ratio flags"
_SIGMAS = " ".join(SIGMAS)
_PLACE, _LEAN, _SPEED = "north_m2 east_m2 down_m2", "roll_rad2 pitch_rad2 yaw_rad2", "vn_m2ps2 ve_m2ps2 vd_m2ps2"
_IMUS = (_each(of, range(4)) for of in ("gyro_{}_radps", "accel_{}_mps2", "gyro_{}_healthy", "accel_{}_healthy"))

COLUMNS = {
    kind: tuple(columns.split())
    for kind, columns in {
        "vibration": f"{_MPS2} clips_0 clips_1 clips_2",
        "barometer": "pressure_pa altitude_m temperature_degc",
        "gps": f"lat_rad lon_rad height_m speed_mps satellites fix_type hdop course_rad {_NED_MPS} {_SIGMAS}",
        "battery": "voltage_v current_a remaining",
        "interference": "jamming_state jamming_indicator spoofing_state",
        "magnetometer": _TESLA,
        "temperature": "temperature_degc",
        "estimator": _RATIOS,
        "accuracy": "horizontal_sigma_m vertical_sigma_m",
        "variance": f"{_PLACE} {_LEAN} {_SPEED}",
        "innovation": f"{_NED_MPS} {_NED_M} {_TESLA} yaw_rad airspeed_mps",
        "attitude": _ANGLES,
        "airspeed": "airspeed_mps true_airspeed_mps pressure_pa temperature_degc",
        "inconsistency": " ".join(_IMUS),
        "gyro_batch": _RADPS,
        "accel_batch": _MPS2,
        "range": "range_m least_m most_m variance_m2 status orientation quality",
        "flow": "x_radps y_radps body_x_radps body_y_radps quality range_m",
    }.items()
}
"""The columns of each kind, whatever the format. PX4's vibration metrics and flows as angles have their own names."""

NONE_IF_ZERO = dict.fromkeys(("magnetometer", "gps", "airspeed", "range", "flow"), True) | {
    "temperature": False,
    "attitude": False,
    "battery": False,
}
"""Kinds of which a source that is zero throughout is none, and whether that is noted."""

_FLOWN = f"x_rad y_rad {_each('gyro_{}_rad', 'xyz')}"
ANGLES_OF_FLOW = _FLOWN.split()
"""Columns of a flow that comes as angles over an interval."""

_CLIPS = _of("clips_0 clips_1 clips_2", _each("clipping_{}"))
VIBRATION_PX4 = (
    _of("coning_rad2", "vibration_x") | _of("gyro_radps", "vibration_y", "rad/s")
    | _of("accel_mps2", "vibration_z", "m/s/s") | _CLIPS
)  # fmt: skip
"""PX4 puts other things into VIBRATION, of the IMU that it has selected (modules/mavlink/streams/VIBRATION.hpp)."""
_GPS = (
    _of("lat_rad lon_rad", "lat lon", "degE7") | _of("height_m", "alt", "mm") | _of("speed_mps", "vel", "cm/s")
    | _of("satellites fix_type", "satellites_visible fix_type") | _of("hdop", "eph", "hundredths")
    | _of("course_rad", "cog", "cdeg") | _of(_SIGMAS, "h_acc v_acc vel_acc", "mm")
)  # fmt: skip
_PRESSURE = _of("pressure_pa", "press_abs", "hPa") | _of("temperature_degc", "temperature", "cdegC")
_CHARGE = _of("current_a", "current_battery", "cA") | _of("remaining", "battery_remaining", "percent")
_MATRIX = "covariance[{}]"

# MAVLink common.xml: the upper triangle of a symmetric matrix row by row (6 x 6, 9 x 9), or all nine of a 3 x 3.
MESSAGE_SOURCES = (
    Source("VIBRATION", "vibration", _of(_MPS2, _each("vibration_{}", "xyz"), "m/s/s") | _CLIPS),
    Source("SCALED_PRESSURE", "barometer", _PRESSURE),
    Source("SCALED_PRESSURE2", "barometer", _PRESSURE, instance=1),
    Source("SCALED_PRESSURE3", "barometer", _PRESSURE, instance=2),
    Source("GPS_RAW_INT", "gps", _GPS),
    Source("GPS2_RAW", "gps", _GPS, instance=1),
    *(Source(name, "magnetometer", _of(_TESLA, _each("{}mag", "xyz"), "mgauss"), imu.instance)
      for name, imu in IMU_MESSAGES.items()),
    *(Source(name, "temperature", _of("temperature_degc", "temperature", "cdegC"), imu.instance)
      for name, imu in IMU_MESSAGES.items()),
    Source("EKF_STATUS_REPORT", "estimator", _of(
        _RATIOS, "velocity_variance pos_horiz_variance pos_vert_variance compass_variance airspeed_variance flags")),
    Source("ESTIMATOR_STATUS", "estimator", _of(
        _RATIOS, "vel_ratio pos_horiz_ratio pos_vert_ratio mag_ratio tas_ratio flags")),
    Source("ESTIMATOR_STATUS", "accuracy", _of(
        "horizontal_sigma_m vertical_sigma_m", "pos_horiz_accuracy pos_vert_accuracy", "m")),
    Source("SYS_STATUS", "battery", _of("voltage_v", "voltage_battery", "mV") | _CHARGE),
    Source("BATTERY_STATUS", "battery", _of("voltage_v", "voltages[]", "mV") | _CHARGE, by=("id",)),
    Source("AHRS2", "attitude", _of(_ANGLES, "roll pitch yaw", "rad"), instance=1),
    Source("AHRS3", "attitude", _of(_ANGLES, "roll pitch yaw", "rad"), instance=2),
    Source("AIRSPEED", "airspeed", _of("airspeed_mps", "airspeed", "m/s") | _of("pressure_pa", "raw_press", "hPa")
           | _of("temperature_degc", "temperature", "cdegC"), by=("id",)),
    Source("SCALED_PRESSURE", "airspeed", _of("pressure_pa", "press_diff", "hPa")
           | _of("temperature_degc", "temperature_press_diff", "cdegC"), noted=False),
    Source("DISTANCE_SENSOR", "range", _of(
        "range_m least_m most_m", "current_distance min_distance max_distance", "cm")
           | _of("orientation quality", "orientation signal_quality"), by=("id", "orientation")),
    Source("RANGEFINDER", "range", _of("range_m", "distance", "m")),
    Source("OPTICAL_FLOW", "flow", _of("x_radps y_radps", "flow_rate_x flow_rate_y", "rad/s")
           | _of("quality", "quality") | _of("range_m", "ground_distance", "m"), by=("sensor_id",)),
    Source("OPTICAL_FLOW_RAD", "flow",
           _of(_FLOWN, f"integrated_x integrated_y {_each('integrated_{}gyro', 'xyz')}", "rad")
           | _of("interval_us quality", "integration_time_us quality") | _of("range_m", "distance", "m"),
           by=("sensor_id",)),
    Source("LOCAL_POSITION_NED_COV", "variance", _of(f"{_PLACE} {_SPEED}", _each(_MATRIX, (0, 9, 17, 24, 30, 35)))),
    Source("ATTITUDE_QUATERNION_COV", "variance", _of(_LEAN, _each(_MATRIX, (0, 4, 8)))),
    Source("ODOMETRY", "variance", _of(f"{_PLACE} {_LEAN}", _each("pose_covariance[{}]", (0, 6, 11, 15, 18, 20)))
           | _of(_SPEED, _each("velocity_covariance[{}]", (0, 6, 11)))),
)  # fmt: skip

GPS_ACCURACY = _of("horizontal_sigma_m vertical_sigma_m", "HAcc VAcc", "m") | _of("speed_sigma_mps", "SAcc", "m/s")
"""What GPA says of the fix in GPS."""

RECORD_SOURCES = (
    Source("VIBE", "vibration", _of(_MPS2, "VibeX VibeY VibeZ", "m/s/s") | _of(_each("clips_{}"), _each("Clip{}"))),
    Source("BARO", "barometer", _of("pressure_pa", "Press", "Pa") | _of("altitude_m", "Alt", "m")
           | _of("temperature_degc", "Temp", "degC"), others=("BAR2", "BAR3"), sampled="SMS"),
    Source("GPS", "gps", _of("lat_rad lon_rad course_rad", "Lat Lng GCrs", "deg") | _of("height_m", "Alt", "m")
           | _of("speed_mps vd_mps", "Spd VZ", "m/s") | _of("satellites fix_type hdop", "NSats Status HDop")
           | GPS_ACCURACY, others=("GPS2",)),  # AP_GPS::GPS_Status has the numbers of GPS_FIX_TYPE
    Source("UBX1", "interference", _of("jamming_indicator", "jamInd")),
    Source("MAG", "magnetometer", _of(_TESLA, "MagX MagY MagZ", "mgauss"), others=("MAG2", "MAG3"), sampled="S"),
    Source("IMU", "temperature", _of("temperature_degc", "T", "degC"), others=("IMU2", "IMU3")),
    Source("ARSP", "airspeed", _of("airspeed_mps", "Airspeed", "m/s") | _of("pressure_pa", "DiffPress", "Pa")
           | _of("temperature_degc", "Temp", "degC"), others=("ASP2",)),
    Source("RFND", "range", _or(
        _of("range_m", "Dist", "m") | _of("status orientation quality", "Stat Orient Quality"),
        _of("range_m", "Dist1", "m") | _of("orientation", "Orient1"))),  # before 2020
    Source("OF", "flow", _of("x_radps y_radps body_x_radps body_y_radps", "flowX flowY bodyX bodyY", "rad/s")
           | _of("quality", "Qual")),
    Source("BAT", "battery", _of("voltage_v", "Volt", "V") | _of("current_a", "Curr", "A")
           | _of("remaining", "RemPct", "percent"), others=("BAT2",)),
    Source("CURR", "battery", _of("voltage_v", "Volt", "V") | _of("current_a", "Curr", "A"), others=("CUR2",)),
    Source("XKF4", "estimator", _of(_RATIOS, "SV SP SH SM SVT SS"), others=("NKF4", "EKF4")),
    Source("XKF3", "innovation", _of(_NED_MPS, "IVN IVE IVD", "m/s") | _of(_NED_M, "IPN IPE IPD", "m")
           | _of(_TESLA, "IMX IMY IMZ", "mgauss") | _of("yaw_rad", "IYAW", "deg") | _of("airspeed_mps", "IVT", "m/s"),
           others=("NKF3", "EKF3")),
    Source("AHR2", "attitude", _of(_ANGLES, "Roll Pitch Yaw", "deg")),
    Source("DCM", "attitude", _of(_ANGLES, "Roll Pitch Yaw", "deg")),
)  # fmt: skip
"""Of the EKFs' records: EKF3's, EKF2's, and those of the one before them."""

_GPS_TOPIC = (
    _or(_of("lat_rad lon_rad", "latitude_deg longitude_deg", "deg"), _of("lat_rad lon_rad", "lat lon", "degE7"))
    | _or(_of("height_m", "altitude_msl_m", "m"), _of("height_m", "alt", "mm"))  # integers before PX4 1.14
    | _of(f"speed_mps {_NED_MPS}", "vel_m_s vel_n_m_s vel_e_m_s vel_d_m_s", "m/s")
    | _of("satellites fix_type hdop", "satellites_used fix_type hdop") | _of("course_rad", "cog_rad", "rad")
    | _of("horizontal_sigma_m vertical_sigma_m", "eph epv", "m") | _of("speed_sigma_mps", "s_variance_m_s", "m/s")
)  # fmt: skip
_JAMMED = "jamming_state jamming_indicator spoofing_state"
_AIR = _of("pressure_pa", "baro_pressure_pa", "Pa") | _of("altitude_m", "baro_alt_meter", "m") | _or(
    _of("temperature_degc", "ambient_temperature", "degC"), _of("temperature_degc", "baro_temp_celcius", "degC")
)  # fmt: skip
_GAUSS = _of(_TESLA, _each("magnetometer_ga[{}]"), "gauss")
_FLOW_TOPIC = _or(  # since PX4 1.13, and before
    _of(_FLOWN, f"{_each('pixel_flow[{}]', range(2))} {_each('delta_angle[{}]')}", "rad")
    | _of("interval_us quality", "integration_timespan_us quality") | _of("range_m", "distance_m", "m"),
    _of(_FLOWN, f"{_each('pixel_flow_{}_integral', 'xy')} {_each('gyro_{}_rate_integral', 'xyz')}", "rad")
    | _of("interval_us", "integration_timespan") | _of("range_m", "ground_distance_m", "m"),
)  # fmt: skip


def _aid(of: str, axes: str, suffix: str, unit: str) -> Source:
    """An estimator_aid_src_*: of each axis the innovation and its share of what is let in, and whether it was."""
    fields: Fields = {}
    for i, axis in enumerate(axes.split()):
        element = f"[{i}]" if " " in axes else ""
        fields |= _of(f"{axis}_{suffix}", f"innovation{element}", unit) | _of(f"{axis}_ratio", f"test_ratio{element}")
    return Source(f"estimator_aid_src_{of}", "aiding", fields | _of("rejected fused", "innovation_rejected fused"))


TOPIC_SOURCES = (
    Source("vehicle_imu_status", "vibration", _or(
        _of("coning_rad2", "delta_angle_coning_metric"), _of("coning_rad2", "gyro_coning_vibration"))
           | _of("gyro_radps", "gyro_vibration_metric", "rad/s") | _of("accel_mps2", "accel_vibration_metric", "m/s/s")
           | _of(_each("clips_{}", "xyz"), _each("accel_clipping[{}]"))
           | _of(_each("gyro_clips_{}", "xyz"), _each("gyro_clipping[{}]"))),
    Source("vehicle_air_data", "barometer", _AIR),
    Source("vehicle_gps_position", "gps", _GPS_TOPIC),
    Source("sensor_gps", "gps", _GPS_TOPIC),
    Source("vehicle_gps_position", "interference", _of(_JAMMED, _JAMMED)),
    Source("sensor_gps", "interference", _of(_JAMMED, _JAMMED)),
    Source("vehicle_magnetometer", "magnetometer", _GAUSS),
    Source("battery_status", "battery", _of("voltage_v current_a remaining", "voltage_v current_a remaining")),
    Source("vehicle_imu_status", "temperature", _of("temperature_degc", "temperature_accel", "degC")),
    Source("sensors_status_imu", "inconsistency",
           _of(_each("gyro_{}_radps", range(4)), _each("gyro_inconsistency_rad_s[{}]", range(4)), "rad/s")
           | _of(_each("accel_{}_mps2", range(4)), _each("accel_inconsistency_m_s_s[{}]", range(4)), "m/s/s")
           | _of(_each("gyro_{}_healthy", range(4)), _each("gyro_healthy[{}]", range(4)))
           | _of(_each("accel_{}_healthy", range(4)), _each("accel_healthy[{}]", range(4)))),
    Source("estimator_status", "estimator", _or(_of(
        _RATIOS, f"{_each('{}_test_ratio', ('vel', 'pos', 'hgt', 'mag', 'tas'))} solution_status_flags"),
        _of("compass_ratio", "hdg_test_ratio"))),  # since PX4 1.15 that of the heading alone
    Source("vehicle_odometry", "variance", _of(_PLACE, _each("position_variance[{}]"))
           | _of(_LEAN, _each("orientation_variance[{}]")) | _of(_SPEED, _each("velocity_variance[{}]"))),
    Source("airspeed", "airspeed", _of("airspeed_mps", "indicated_airspeed_m_s", "m/s")
           | _of("true_airspeed_mps", "true_airspeed_m_s", "m/s")
           | _of("temperature_degc", "air_temperature_celsius", "degC")),
    Source("differential_pressure", "airspeed", _of("pressure_pa", "differential_pressure_pa", "Pa")
           | _of("temperature_degc", "temperature", "degC")),
    Source("distance_sensor", "range", _of("range_m least_m most_m", "current_distance min_distance max_distance", "m")
           | _of("variance_m2 orientation quality", "variance orientation signal_quality")),
    Source("vehicle_optical_flow", "flow", _FLOW_TOPIC),
    Source("sensor_optical_flow", "flow", _FLOW_TOPIC),
    Source("optical_flow", "flow", _FLOW_TOPIC),
    Source("estimator_innovations", "innovation", _of(_NED_MPS, "gps_hvel[0] gps_hvel[1] gps_vvel", "m/s")
           | _of(f"{_NED_M} gps_down_m", "gps_hpos[0] gps_hpos[1] baro_vpos gps_vpos", "m")
           | _of(_TESLA, _each("mag_field[{}]"), "gauss") | _of("yaw_rad", "heading", "rad")
           | _of("airspeed_mps", "airspeed", "m/s")),
    Source("ekf2_innovations", "innovation", _of(_NED_MPS, _each("vel_pos_innov[{}]"), "m/s")
           | _of(_NED_M, _each("vel_pos_innov[{}]", range(3, 6)), "m") | _of(_TESLA, _each("mag_innov[{}]"), "gauss")
           | _of("yaw_rad", "heading_innov", "rad") | _of("airspeed_mps", "airspeed_innov", "m/s")),
    # "In case the field is a vector, the test ratio will be put in the first component" (EstimatorInnovations.msg).
    Source("estimator_innovation_test_ratios", "test_ratio", _of(_each("{}_ratio", (
        "velocity", "vertical_velocity", "position", "height", "gps_height", "heading", "compass", "airspeed")),
        "gps_hvel[0] gps_vvel gps_hpos[0] baro_vpos gps_vpos heading mag_field[0] airspeed")),
    _aid("gnss_pos", "north east", "m", "m"),
    _aid("gnss_vel", "vn ve vd", "mps", "m/s"),
    _aid("gnss_hgt", "down", "m", "m"),
    _aid("gnss_yaw", "yaw", "rad", "rad"),
    _aid("baro_hgt", "down", "m", "m"),
    _aid("rng_hgt", "down", "m", "m"),
    _aid("mag", "x y z", "tesla", "gauss"),
    _aid("mag_heading", "yaw", "rad", "rad"),
    _aid("gravity", "x y z", "mps2", "m/s/s"),
    _aid("airspeed", "airspeed", "mps", "m/s"),
    _aid("ev_pos", "north east", "m", "m"),
    _aid("ev_vel", "vn ve vd", "mps", "m/s"),
    _aid("ev_hgt", "down", "m", "m"),
    _aid("ev_yaw", "yaw", "rad", "rad"),
    _aid("optical_flow", "x y", "radps", "rad/s"),
)  # fmt: skip

DRIVER_SOURCES = (
    Source("sensor_mag", "magnetometer", _of(_TESLA, "x y z", "gauss")),
    Source("sensor_baro", "barometer", _of("pressure_pa", "pressure", "Pa") | _of("altitude_m", "altitude", "m")
           | _of("temperature_degc", "temperature", "degC")),
    Source("sensor_combined", "magnetometer", _GAUSS),
    Source("sensor_combined", "barometer", _AIR),
)  # fmt: skip
"""Topics of single drivers, of which tracks are made where the selected sensors are others, and no series."""


SDLOG2_SOURCES = (
    Source("GPS", "gps", _of("lat_rad lon_rad", "Lat Lon", "deg") | _of("height_m horizontal_sigma_m vertical_sigma_m",
           "Alt EPH EPV", "m") | _of(_NED_MPS, "VelN VelE VelD", "m/s") | _of("satellites fix_type", "nSat Fix")),
    Source("GPS", "interference", _of("jamming_indicator", "J")),
    *(Source(name, "magnetometer", _of(_TESLA, "MagX MagY MagZ", "gauss"), instance=i)
      for i, name in enumerate(("IMU", "IMU1", "IMU2"))),
    Source("BATT", "battery", _of("voltage_v current_a remaining", "V C Remaining")),
    Source("SENS", "barometer", _of("pressure_pa", "BaroPres", "hPa") | _of("altitude_m", "BaroAlt", "m")
           | _of("temperature_degc", "BaroTemp", "degC")),
)  # fmt: skip
"""Of PX4's log before .ulg."""


def covariances(velocity: int) -> tuple[Source, ...]:
    """Variances of EKF2's velocity, which begin at a place in its covariances, and of its position behind them."""
    places = _of(f"{_SPEED} {_PLACE}", _each("covariances[{}]", range(velocity, velocity + 6)))
    return tuple(Source(topic, "variance", places) for topic in ("estimator_states", "estimator_status"))
