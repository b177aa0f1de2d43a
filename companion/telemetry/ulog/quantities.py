"""Which field of which topic becomes which column of a flight's series. The one table of them for PX4's logs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial

from companion.model import Series
from companion.telemetry.quantities import Raw, RawSeries, raw_series, series_of
from companion.telemetry.ulog.estimator import Version, attitude_elements
from companion.telemetry.ulog.topics import Topic, Topics, instances, sampled

Alternatives = tuple[tuple[str, str], ...]
"""Fields and their units, of which a topic has the first (today's PX4) or another (older ones)."""


@dataclass(frozen=True, slots=True)
class TopicSeries:
    """A kind of series that each instance of a topic has."""

    topic: str
    kind: str
    columns: Mapping[str, Alternatives]


def _one(**fields: str) -> Mapping[str, Alternatives]:
    """Columns with one field each, written "field unit"."""
    return {name: ((field.partition(" ")[0], field.partition(" ")[2]),) for name, field in fields.items()}


def _vector(names: tuple[str, ...], field: str, unit: str = "", first: int = 0) -> Mapping[str, Alternatives]:
    """Columns that are elements of an array."""
    return {name: ((f"{field}[{first + i}]", unit),) for i, name in enumerate(names)}


_PLACE = ("north_m2", "east_m2", "down_m2")
_SPEED = ("vn_m2ps2", "ve_m2ps2", "vd_m2ps2")

_GPS: Mapping[str, Alternatives] = {
    "lat_rad": (("latitude_deg", "deg"), ("lat", "degE7")),  # integers before PX4 1.14
    "lon_rad": (("longitude_deg", "deg"), ("lon", "degE7")),
    "height_m": (("altitude_msl_m", "m"), ("alt", "mm")),
    **_one(
        speed_mps="vel_m_s m/s",
        satellites="satellites_used",
        fix_type="fix_type",
        hdop="hdop",
        course_rad="cog_rad rad",
        vn_mps="vel_n_m_s m/s",
        ve_mps="vel_e_m_s m/s",
        vd_mps="vel_d_m_s m/s",
        horizontal_sigma_m="eph m",
        vertical_sigma_m="epv m",
        speed_sigma_mps="s_variance_m_s m/s",
    ),
}
_INNOVATIONS: Mapping[str, Alternatives] = {
    **_vector(("vn_mps", "ve_mps"), "gps_hvel", "m/s"),
    **_one(vd_mps="gps_vvel m/s"),
    **_vector(("north_m", "east_m"), "gps_hpos", "m"),
    **_one(down_m="baro_vpos m", gps_down_m="gps_vpos m"),
    **_vector(("x_tesla", "y_tesla", "z_tesla"), "mag_field", "gauss"),
    **_one(yaw_rad="heading rad", airspeed_mps="airspeed m/s"),
}
_OLD_INNOVATIONS: Mapping[str, Alternatives] = {
    **_vector(("vn_mps", "ve_mps", "vd_mps"), "vel_pos_innov", "m/s"),
    **_vector(("north_m", "east_m", "down_m"), "vel_pos_innov", "m", first=3),
    **_vector(("x_tesla", "y_tesla", "z_tesla"), "mag_innov", "gauss"),
    **_one(yaw_rad="heading_innov rad", airspeed_mps="airspeed_innov m/s"),
}
_TEST_RATIOS: Mapping[str, Alternatives] = {
    # "In case the field is a vector, the test ratio will be put in the first component" (EstimatorInnovations.msg).
    **_one(
        velocity_ratio="gps_hvel[0]",
        vertical_velocity_ratio="gps_vvel",
        position_ratio="gps_hpos[0]",
        height_ratio="baro_vpos",
        gps_height_ratio="gps_vpos",
        heading_ratio="heading",
        compass_ratio="mag_field[0]",
        airspeed_ratio="airspeed",
    ),
}
_ESTIMATOR: Mapping[str, Alternatives] = {
    **_one(velocity_ratio="vel_test_ratio", position_ratio="pos_test_ratio", height_ratio="hgt_test_ratio"),
    "compass_ratio": (("mag_test_ratio", ""), ("hdg_test_ratio", "")),  # since PX4 1.15 that of the heading alone
    **_one(airspeed_ratio="tas_test_ratio", flags="solution_status_flags"),
}
_FLOW: Mapping[str, Alternatives] = {
    "x_rad": (("pixel_flow[0]", "rad"), ("pixel_flow_x_integral", "rad")),  # since PX4 1.13, before
    "y_rad": (("pixel_flow[1]", "rad"), ("pixel_flow_y_integral", "rad")),
    "gyro_x_rad": (("delta_angle[0]", "rad"), ("gyro_x_rate_integral", "rad")),
    "gyro_y_rad": (("delta_angle[1]", "rad"), ("gyro_y_rate_integral", "rad")),
    "gyro_z_rad": (("delta_angle[2]", "rad"), ("gyro_z_rate_integral", "rad")),
    "interval_us": (("integration_timespan_us", ""), ("integration_timespan", "")),
    "quality": (("quality", ""),),
    "range_m": (("distance_m", "m"), ("ground_distance_m", "m")),
}


def _aid(source: str, names: tuple[str, ...], suffix: str, unit: str) -> TopicSeries:
    """An estimator_aid_src_*: of each axis the innovation and its share of what is let in, and whether it was."""
    columns: dict[str, Alternatives] = {}
    for i, name in enumerate(names):
        element = f"[{i}]" if len(names) > 1 else ""
        columns[f"{name}_{suffix}"] = ((f"innovation{element}", unit),)
        columns[f"{name}_ratio"] = ((f"test_ratio{element}", ""),)
    columns.update(_one(rejected="innovation_rejected", fused="fused"))
    return TopicSeries(f"estimator_aid_src_{source}", "aiding", columns)


TOPIC_SERIES: tuple[TopicSeries, ...] = (
    TopicSeries(
        "vehicle_imu_status",
        "vibration",
        {
            "coning_rad2": (("delta_angle_coning_metric", ""), ("gyro_coning_vibration", "")),
            **_one(gyro_radps="gyro_vibration_metric rad/s", accel_mps2="accel_vibration_metric m/s/s"),
            **_vector(("clips_x", "clips_y", "clips_z"), "accel_clipping"),
            **_vector(("gyro_clips_x", "gyro_clips_y", "gyro_clips_z"), "gyro_clipping"),
        },
    ),
    TopicSeries(
        "vehicle_air_data",
        "barometer",
        {
            **_one(pressure_pa="baro_pressure_pa Pa", altitude_m="baro_alt_meter m"),
            "temperature_degc": (("ambient_temperature", "degC"), ("baro_temp_celcius", "degC")),
        },
    ),
    TopicSeries("vehicle_gps_position", "gps", _GPS),
    TopicSeries("sensor_gps", "gps", _GPS),
    *(
        TopicSeries(
            name,
            "interference",
            _one(jamming_state="jamming_state", jamming_indicator="jamming_indicator", spoofing_state="spoofing_state"),
        )
        for name in ("vehicle_gps_position", "sensor_gps")
    ),
    TopicSeries(
        "vehicle_magnetometer", "magnetometer", _vector(("x_tesla", "y_tesla", "z_tesla"), "magnetometer_ga", "gauss")
    ),
    TopicSeries("vehicle_imu_status", "temperature", _one(temperature_degc="temperature_accel degC")),
    TopicSeries(
        "sensors_status_imu",
        "inconsistency",
        {
            **_vector(tuple(f"gyro_{i}_radps" for i in range(4)), "gyro_inconsistency_rad_s", "rad/s"),
            **_vector(tuple(f"accel_{i}_mps2" for i in range(4)), "accel_inconsistency_m_s_s", "m/s/s"),
            **_vector(tuple(f"gyro_{i}_healthy" for i in range(4)), "gyro_healthy"),
            **_vector(tuple(f"accel_{i}_healthy" for i in range(4)), "accel_healthy"),
        },
    ),
    TopicSeries("estimator_status", "estimator", _ESTIMATOR),
    TopicSeries(
        "vehicle_odometry",
        "variance",
        {
            **_vector(_PLACE, "position_variance"),
            **_vector(("roll_rad2", "pitch_rad2", "yaw_rad2"), "orientation_variance"),
            **_vector(_SPEED, "velocity_variance"),
        },
    ),
    TopicSeries(
        "airspeed",
        "airspeed",
        _one(
            airspeed_mps="indicated_airspeed_m_s m/s",
            true_airspeed_mps="true_airspeed_m_s m/s",
            temperature_degc="air_temperature_celsius degC",
        ),
    ),
    TopicSeries(
        "differential_pressure",
        "airspeed",
        _one(pressure_pa="differential_pressure_pa Pa", temperature_degc="temperature degC"),
    ),
    TopicSeries(
        "distance_sensor",
        "range",
        _one(
            range_m="current_distance m",
            least_m="min_distance m",
            most_m="max_distance m",
            variance_m2="variance",
            orientation="orientation",
            quality="signal_quality",
        ),
    ),
    TopicSeries("vehicle_optical_flow", "flow", _FLOW),
    TopicSeries("sensor_optical_flow", "flow", _FLOW),
    TopicSeries("optical_flow", "flow", _FLOW),
    TopicSeries("estimator_innovations", "innovation", _INNOVATIONS),
    TopicSeries("ekf2_innovations", "innovation", _OLD_INNOVATIONS),
    TopicSeries("estimator_innovation_test_ratios", "test_ratio", _TEST_RATIOS),
    _aid("gnss_pos", ("north", "east"), "m", "m"),
    _aid("gnss_vel", ("vn", "ve", "vd"), "mps", "m/s"),
    _aid("gnss_hgt", ("down",), "m", "m"),
    _aid("gnss_yaw", ("yaw",), "rad", "rad"),
    _aid("baro_hgt", ("down",), "m", "m"),
    _aid("rng_hgt", ("down",), "m", "m"),
    _aid("mag", ("x", "y", "z"), "tesla", "gauss"),
    _aid("mag_heading", ("yaw",), "rad", "rad"),
    _aid("gravity", ("x", "y", "z"), "mps2", "m/s/s"),
    _aid("airspeed", ("airspeed",), "mps", "m/s"),
    _aid("ev_pos", ("north", "east"), "m", "m"),
    _aid("ev_vel", ("vn", "ve", "vd"), "mps", "m/s"),
    _aid("ev_hgt", ("down",), "m", "m"),
    _aid("ev_yaw", ("yaw",), "rad", "rad"),
    _aid("optical_flow", ("x", "y"), "radps", "rad/s"),
)


OF_SERIES = ("airspeed", "range", "flow")
"""Kinds whose tracks are made of the series; those of GPS, compasses and barometers are made of the topics."""


def topic_series(topics: Topics, version: Version, notes: list[str]) -> Mapping[str, Series]:
    """The series of a PX4 log of this version; what is left out is added to the notes."""
    return series_of(
        _raw_series(row, name, topic, instance, notes)
        for row in (*TOPIC_SERIES, *_covariances(version))
        for instance, name, topic in instances(topics, row.topic)
    )


def _covariances(version: Version) -> Iterator[TopicSeries]:
    """Variances of EKF2's position and velocity, which come after those of the attitude."""
    velocity = attitude_elements(version)
    columns = {
        **_vector(_PLACE, "covariances", first=velocity + 3),
        **_vector(_SPEED, "covariances", first=velocity),
    }
    for topic in ("estimator_states", "estimator_status"):  # in the latter before PX4 1.11
        yield TopicSeries(topic, "variance", columns)


def _raw_series(row: TopicSeries, name: str, topic: Topic, instance: int, notes: list[str]) -> RawSeries | None:
    fields = {
        column: next(((field, unit) for field, unit in ways if field in topic), ways[0])
        for column, ways in row.columns.items()
    }
    # The thermometer is that of vehicle_imu, which is the name of the track.
    source = name.replace("_status", "") if row.kind == "temperature" else name
    told = notes if row.kind in OF_SERIES else None
    return raw_series(row.kind, source, sampled(topic), fields, partial(_column, topic), instance=instance, notes=told)


def _column(topic: Topic, field: str) -> Raw | None:
    """A field; None where it is that of a sensor whose device id is 0: there is no such sensor."""
    name, _, place = field.partition("[")
    device = topic.get(f"{name.partition('_')[0]}_device_ids[{place}") if place else None
    return None if device is not None and not device.any() else topic.get(field)
