"""A flight and what was made of it → tables: every sensor and track, both trajectories, the drift, the findings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Protocol

import numpy as np

from companion.comparison import NAMES, PARTS, Calibration, DriftRow, Replay, phases, replay
from companion.estimation import ATTITUDE, POSITION, VELOCITY, BestEstimate
from companion.export.paths import offset, places
from companion.export.table import (
    BOOT_CLOCK,
    Column,
    Table,
    euler_angles,
    quaternions,
    records,
    series_name,
    table_name,
    times,
    vectors,
)
from companion.model import Array, AttitudeTrack, Flight, ImuTrack, PositionTrack, Series, TruthTrack, interpolated
from companion.present import CALIBRATED, QUANTITIES, STATISTICS
from companion.verdict import Assessment

_PLACE = ("latitude_deg", "longitude_deg", "height_m")
_CALIBRATED_UNITS = [CALIBRATED[part].si for part, place in PARTS.items() for _ in NAMES[place]]
"""Of the parameters in NAMES."""


def tables(flight: Flight, shown: Replay | None = None, assessed: Assessment | None = None) -> dict[str, Table]:
    """Everything of a flight as tables by name, SI units, body FRD, world NED, quaternions wxyz.

    Always: each IMU message (raw_imu, scaled_imu2, ...), `attitude`, `position`, each series (gps, vibration, ...),
    `bias_0`, `control`, `actuators`, `imu_in_use` and `truth` where it has them; `texts`, `events`, `phases`, `resets`,
    `parameters`, `parameter_changes`. With a replay: `reckoning`, the IMU alone beside the autopilot. With an
    assessment: `drift`, `windows`, `findings`, `calibration`, `best_estimate`. Every table with a time has it twice:
    `t_s` on the boot clock, and `unix_s`, which is NaN where the date is unknown.

    >>> import companion as c
    >>> flight = c.open_log("tlogs/copter-demo-100hz.tlog")[0]
    >>> found = c.export.tables(flight, c.replay(flight))
    >>> sorted(found)[:4]
    ['attitude', 'battery', 'bias_0', 'estimator']
    >>> f"{found['raw_imu']['accel_z_mps2'].mean():.1f} m/s²"
    '-9.8 m/s²'
    >>> found["raw_imu"].arrow().schema.field("gyro_x_radps").metadata
    {b'unit': b'rad/s', b'frame': b'FRD'}
    """
    return {table.name: table for table in _tables(flight, shown, assessed)}


def _tables(flight: Flight, shown: Replay | None, assessed: Assessment | None) -> Iterator[Table]:
    yield from (imu_table(flight, track) for track in flight.imus.values())
    if flight.attitude is not None:
        yield _attitude(flight, flight.attitude)
    if flight.position is not None:
        yield _track(flight, "position", flight.position, *_moved(flight.position))
    yield from (series_table(flight, key, series) for key, series in flight.series.items())
    yield from sensor_tables(flight)
    yield from _records(flight)
    if shown is not None:
        yield _dead_reckoning(flight, shown)
    if assessed is None:
        return
    yield from (_drift(assessed), _windows(flight, assessed.drift.rows), _findings(flight, assessed))
    if assessed.calibration is not None:
        yield _calibration(assessed.calibration)
    if assessed.best is not None:
        yield _best(flight, assessed.best)


def assessed_replay(flight: Flight, assessed: Assessment, reanchor_s: float | None) -> Replay:
    """Both trajectories of the IMU that was assessed, as it was assessed: corrected, if that was requested."""
    track, how = assessed.comparison.track, assessed.comparison.how
    return replay(flight.with_imu(track), imu=track.source, how=how, reanchor_s=reanchor_s)


class _Timed(Protocol):
    @property
    def t(self) -> Array: ...
    @property
    def source(self) -> str: ...


def _track(flight: Flight, name: str, of: _Timed, *columns: Column, **about: str) -> Table:
    """Columns beside the times of a track."""
    return Table(name, (*times(flight, of.t), *columns), {"source": of.source, **about})


def _attitude(flight: Flight, track: AttitudeTrack) -> Table:
    q, rates = track.q_ned_frd, vectors("rate", "radps", track.rates, "FRD")
    about = "Hamilton, wxyz, turns FRD vectors into NED"
    return _track(flight, "attitude", track, *quaternions("q", q), *euler_angles("", q), *rates, q=about)


def _moved(track: PositionTrack | TruthTrack) -> tuple[Column, ...]:
    return (*vectors("position", "m", track.position, "NED"), *vectors("velocity", "mps", track.velocity, "NED"))


def _records(flight: Flight) -> Iterator[Table]:
    about = {"source": "the vehicle's messages"}
    yield records(flight, "texts", flight.texts, about, {"severity": (int, "MAV_SEVERITY"), "text": str})
    about = {"source": "arming, modes, errors"}
    yield records(flight, "events", flight.events, about, {"kind": str, "text": str})
    about, span = {"source": "arming, estimator's flags, texts, motion"}, {"start": "start_", "end": "end_"}
    yield records(flight, "phases", phases(flight), about, {"kind": str, "reason": str}, span)
    about = {"source": "jumps that the estimator announced"}
    yield records(flight, "resets", flight.resets, about, {"kind": str, "core": float, "text": str})
    about = {"source": "parameters that got another value in the log"}
    yield records(flight, "parameter_changes", flight.parameter_changes, about, {"name": str, "value": float})
    names = sorted(flight.parameters)
    values = np.array([flight.parameters[name] for name in names], np.float64)
    about = {"source": "the vehicle's parameters, as far as the log has them"}
    yield Table("parameters", (Column("name", np.array(names, np.str_)), Column("value", values)), about)


def _dead_reckoning(flight: Flight, shown: Replay) -> Table:
    anchor = shown.anchors[np.searchsorted(shown.anchors, shown.t, side="right") - 1]
    columns = (
        *times(flight, shown.t),
        Column("anchor_t_s", anchor, BOOT_CLOCK),
        *quaternions("q_imu", shown.q_imu),
        *euler_angles("imu_", shown.q_imu),
        *vectors("velocity_imu", "mps", shown.velocity_imu, "NED"),
        *vectors("position_imu", "m", shown.position_imu, "NED"),
        *quaternions("q_autopilot", shown.q_ref),
        *euler_angles("autopilot_", shown.q_ref),
        *vectors("velocity_autopilot", "mps", shown.velocity_ref, "NED"),
        *vectors("position_autopilot", "m", shown.position_ref, "NED"),
        *vectors("attitude_error", "rad", shown.attitude_error, "NED"),
        *vectors("velocity_error", "mps", shown.velocity_error, "NED"),
        *vectors("position_error", "m", shown.position_error, "NED"),
        Column("autopilot_known", shown.reference_valid.astype(np.int64), "0 inside a gap of its messages"),
    )
    if not shown.has_position:
        columns = tuple(c for c in columns if not c.name.startswith(("velocity", "position")))
    return Table("reckoning", columns, {"error": "autopilot minus IMU; attitude: rotation vector of q_ap ⊗ q_imu⁻¹"})


def _best(flight: Flight, best: BestEstimate) -> Table:
    t = best.imu.t
    q, velocity, position = best.at(t)
    sigma = {block.start: interpolated(t, best.t, best.sigma(block)) for block in (ATTITUDE, VELOCITY, POSITION)}
    where = () if best.origin is None else places(position, best.origin).T
    columns = (
        *times(flight, t),
        *quaternions("q", q),
        *euler_angles("", q),
        *(Column(f"position_{name}", values) for name, values in zip(_PLACE, where, strict=False)),
        *vectors("velocity", "mps", velocity, "NED"),
        *vectors("position", "m", position + offset(flight, best), "NED"),
        *vectors("attitude_sigma", "rad", sigma[ATTITUDE.start], "NED"),
        *vectors("velocity_sigma", "mps", sigma[VELOCITY.start], "NED"),
        *vectors("position_sigma", "m", sigma[POSITION.start], "NED"),
    )
    if "gps_position" not in best.residuals:
        columns = tuple(c for c in columns if not c.name.startswith(("velocity", "position")))
    return Table("best_estimate", columns, {"source": ", ".join([best.imu.source, *best.residuals])})


def _drift(assessed: Assessment) -> Table:
    table = assessed.drift.to_dict()
    columns = [
        Column("horizon_s", np.array(table["horizon_s"])),
        *(Column(name, np.array(table[name], np.int64)) for name in ("windows", "excluded")),
    ]
    for quantity in QUANTITIES:
        keys = [quantity.column(statistic) for statistic in STATISTICS]
        columns += [Column(key, np.array(table[key])) for key in keys]
        allowed = [getattr(expected, quantity.attribute, None) for expected in assessed.expected]
        sigma = np.array([np.nan if value is None else value for value in allowed])
        columns.append(Column(quantity.column("expected"), sigma, "1σ by the error budget"))
    about = {"imu": assessed.drift.imu, "method": assessed.drift.method, "middle": assessed.drift.middle}
    return Table("drift", tuple(columns), about)


def _windows(flight: Flight, rows: Sequence[DriftRow]) -> Table:
    """Every window of every horizon with its error at the end."""
    has_position = any(row.position_m is not None for row in rows)

    def joined(name: str) -> Array:
        return np.concatenate([getattr(row.errors, name) for row in rows])

    columns = (
        Column("horizon_s", np.repeat([row.horizon_s for row in rows], [row.windows for row in rows])),
        *times(flight, joined("anchor_s"), prefix="anchor_"),
        *times(flight, joined("end_s"), prefix="end_"),
        *vectors("attitude_error", "rad", joined("attitude"), "NED"),
        *(vectors("velocity_error", "mps", joined("velocity"), "NED") if has_position else ()),
        *(vectors("position_error", "m", joined("position"), "NED") if has_position else ()),
    )
    return Table("windows", columns, {"error": "autopilot minus IMU at the end of the window"})


def _findings(flight: Flight, assessed: Assessment) -> Table:
    about = {"status": assessed.verdict.status, "summary": assessed.verdict.summary}
    span = {"start_s": "start_", "end_s": "end_"}
    words = dict.fromkeys(("kind", "side", "severity", "evidence", "advice"), str)
    return records(flight, "findings", assessed.verdict.findings, about, words, span)


def _calibration(fit: Calibration) -> Table:
    columns = (
        Column("figure", np.array(NAMES, np.str_)),
        Column("value", fit.values),
        Column("sigma", fit.sigma),
        Column("unit", np.array(_CALIBRATED_UNITS, np.str_)),
        Column("observable", np.array(fit.observable, np.int64)),
    )
    about = {"windows": str(fit.windows), "horizon_s": f"{fit.horizon_s:g}"}
    return Table("calibration", columns, about)


_AIDING = ("gps", "magnetometer", "barometer")  # kinds of series


def imu_table(flight: Flight, track: ImuTrack) -> Table:
    known = {
        "device_id": track.device_id,
        "low_pass_hz": track.low_pass_hz,
        "gyro_range_radps": track.gyro_range,
        "accel_range_mps2": track.accel_range,
    }
    about = {
        "instance": str(track.instance),
        "accel": "specific force: (0, 0, -g) at rest and level",
        "bias_removed": "the estimator's" if track.bias_removed else "no",
        "sample": "an instant's" if track.interval is None else "the mean over interval_s, whose middle is t_s",
        **{name: f"{value:.6g}" if isinstance(value, float) else str(value) for name, value in known.items() if value},
    }
    columns = (*vectors("gyro", "radps", track.gyro, "FRD"), *vectors("accel", "mps2", track.accel, "FRD"))
    if track.interval is not None:
        columns = (*columns, Column("interval_s", track.interval))
    return _track(flight, table_name(track.source), track, *columns, **about)


def series_table(flight: Flight, key: str, series: Series) -> Table:
    frame = "FRD" if key.startswith(("vibration", "magnetometer")) else ""
    columns = (Column(name, series[name], frame) for name in series.columns)
    return _track(flight, series_name(key), series, *columns)


def sensor_tables(flight: Flight) -> Iterator[Table]:
    """Biases, desired attitude, motors, and a simulator's truth: those that the flight has.

    GPS, compasses and barometers are among the series, but for those that only PX4's drivers report.
    """
    known = {series.source for key, series in flight.series.items() if key.startswith(_AIDING)}
    table = partial(_track, flight)
    for gps in flight.gps:
        if gps.source not in known:
            yield table(
                table_name(f"gps_{gps.source}"), gps, Column("lat_rad", gps.latitude),
                Column("lon_rad", gps.longitude), Column("height_m", gps.height),
                *vectors("velocity", "mps", gps.velocity, "NED"), Column("horizontal_sigma_m", gps.horizontal_sigma),
                Column("vertical_sigma_m", gps.vertical_sigma), Column("speed_sigma_mps", gps.speed_sigma),
                Column("fix_type", gps.fix_type), Column("satellites", gps.satellites),
            )  # fmt: skip
    for compass in flight.compasses:
        if compass.source not in known:
            columns = (
                Column(f"{axis}_tesla", field, "FRD") for axis, field in zip("xyz", compass.field.T, strict=True)
            )
            yield table(table_name(f"magnetometer_{compass.source}"), compass, *columns)
    for air in flight.barometers:
        if air.source not in known:
            values = {"pressure_pa": air.pressure, "altitude_m": air.altitude, "temperature_degc": air.temperature}
            yield table(table_name(f"barometer_{air.source}"), air, *(Column(*column) for column in values.items()))
    for i, bias in enumerate(flight.biases):
        yield table(
            f"bias_{i}", bias, *vectors("gyro", "radps", bias.gyro, "FRD"),
            *vectors("accel", "mps2", bias.accel, "FRD"), *vectors("gyro_sigma", "radps", bias.gyro_sigma, "FRD"),
            *vectors("accel_sigma", "mps2", bias.accel_sigma, "FRD"),
            instance="" if bias.imu_instance is None else str(bias.imu_instance),
        )  # fmt: skip
    if (control := flight.control) is not None:
        yield table("control", control, *quaternions("q", control.q_ned_frd))
    if (motors := flight.actuators) is not None:
        yield table("actuators", motors, *(Column(f"output_{i}", share) for i, share in enumerate(motors.output.T, 1)))
    if (used := flight.imu_in_use) is not None:
        yield table("imu_in_use", used, Column("instance", used.instance))
    if flight.aiding_in_use:
        yield _aiding_in_use(flight)
    if (truth := flight.truth) is not None:
        yield table("truth", truth, *quaternions("q", truth.q_ned_frd), *_moved(truth))


def _aiding_in_use(flight: Flight) -> Table:
    used = [(kind, one.source, t, i) for kind, one in flight.aiding_in_use.items() for t, i in one.changes]
    columns = (
        *times(flight, np.array([t for _, _, t, _ in used], np.float64)),
        Column("kind", np.array([kind for kind, _, _, _ in used], np.str_)),
        Column("instance", np.array([i for _, _, _, i in used], np.int64)),
    )
    return Table("aiding_in_use", columns, {"source": ", ".join(dict.fromkeys(source for _, source, _, _ in used))})
