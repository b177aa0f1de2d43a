"""A flight and what was made of it → tables: every track, both trajectories, the drift, the findings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from companion.analysis import NAMES, PARTS, Assessment, Calibration, DriftRow, Replay, phases, replay
from companion.estimation import ATTITUDE, POSITION, VELOCITY, BestEstimate
from companion.export.kml import places
from companion.export.sensors import imu_table, sensor_tables, series_table
from companion.export.table import BOOT_CLOCK, Column, Table, euler_angles, quaternions, times, vectors
from companion.model import Array, AttitudeTrack, Flight, PositionTrack, interpolated
from companion.present import QUANTITIES, STATISTICS

_PLACE = ("latitude_deg", "longitude_deg", "height_m")
_PART_UNITS = {"gyro_bias": "rad/s", "accel_bias": "m/s²", "time_offset": "s", "lever_arm": "m", "gyro_scale": "",
               "accel_scale": ""}  # fmt: skip
_FIGURE_UNITS = {name: _PART_UNITS.get(part, "rad") for part, place in PARTS.items() for name in NAMES[place]}
"""Figure of a calibration → its unit; what is not named is an angle."""


def tables(flight: Flight, shown: Replay | None = None, assessed: Assessment | None = None) -> dict[str, Table]:
    """Everything of a flight as tables by name, SI units, body FRD, world NED, quaternions wxyz.

    Always: each IMU message (raw_imu, scaled_imu2, ...), `attitude`, `position`, each series (gps, vibration, ...),
    `bias_0`, `control`, `actuators`, `imu_in_use` and `truth` where it has them; `texts`, `events`, `phases`, `resets`,
    `parameters`, `parameter_changes`. With a replay: `reckoning`, the IMU alone beside the autopilot. With an
    assessment: `drift`, `windows`, `findings`, `calibration`, `best_estimate`. Every table with a time has it twice:
    `t_s` on the boot clock, and `unix_s`, which is NaN where the log does not tell the date.

    >>> import companion as c
    >>> flight = c.open_log("tlogs/copter-demo-100hz.tlog")[0]
    >>> found = c.export.tables(flight, c.replay(flight))
    >>> sorted(found)[:4]
    ['attitude', 'bias_0', 'estimator', 'events']
    >>> f"{found['raw_imu']['accel_z_mps2'].mean():.1f} m/s²"
    '-9.8 m/s²'
    >>> found["raw_imu"].arrow().schema.field("gyro_x_radps").metadata
    {b'unit': b'rad/s', b'frame': b'FRD'}
    """
    parts = [imu_table(flight, track) for track in flight.imus.values()]
    if flight.attitude is not None:
        parts.append(_attitude(flight, flight.attitude))
    if flight.position is not None:
        parts.append(_position(flight, flight.position))
    parts += [series_table(flight, key, series) for key, series in flight.series.items()]
    parts += list(sensor_tables(flight))
    parts += [_texts(flight), _events(flight), _phases(flight), _resets(flight)]
    parts += [_parameters(flight), _parameter_changes(flight)]
    if shown is not None:
        parts.append(_reckoning(flight, shown))
    if assessed is not None:
        parts += [_drift(assessed), _windows(flight, assessed.drift.rows), _findings(flight, assessed)]
        parts += [_calibration(assessed.calibration)] if assessed.calibration else []
        parts += [_best(flight, assessed.best)] if assessed.best else []
    return {table.name: table for table in parts}


def reckoning_of(flight: Flight, assessed: Assessment, reanchor_s: float | None) -> Replay:
    """Both trajectories of the IMU that was assessed, as it was assessed: corrected, if that was asked for."""
    track = assessed.comparison.track
    judged = replace(flight, imus={**flight.imus, track.source: track})
    return replay(judged, imu=track.source, how=assessed.comparison.how, reanchor_s=reanchor_s)


def _attitude(flight: Flight, track: AttitudeTrack) -> Table:
    columns = (
        *times(flight, track.t),
        *quaternions("q", track.q_ned_frd),
        *euler_angles("", track.q_ned_frd),
        *vectors("rate", track.rates, "rad/s", "radps", "FRD"),
    )
    return Table("attitude", columns, {"source": track.source, "q": "Hamilton, wxyz, turns FRD vectors into NED"})


def _position(flight: Flight, track: PositionTrack) -> Table:
    columns = (
        *times(flight, track.t),
        *vectors("position", track.position, "m", "m", "NED"),
        *vectors("velocity", track.velocity, "m/s", "mps", "NED"),
    )
    return Table("position", columns, {"source": track.source})


def _phases(flight: Flight) -> Table:
    spans = phases(flight)
    columns = (
        *times(flight, np.array([part.start for part in spans], np.float64), prefix="start_"),
        *times(flight, np.array([part.end for part in spans], np.float64), prefix="end_"),
        Column("kind", np.array([part.kind for part in spans], np.str_)),
        Column("reason", np.array([part.reason for part in spans], np.str_)),
    )
    return Table("phases", columns, {"source": "arming, estimator's flags, texts, motion"})


def _resets(flight: Flight) -> Table:
    columns = (
        *times(flight, np.array([reset.t for reset in flight.resets], np.float64)),
        Column("kind", np.array([reset.kind for reset in flight.resets], np.str_)),
        Column("core", np.array([_or_nan(reset.core) for reset in flight.resets], np.float64)),
        Column("text", np.array([reset.text for reset in flight.resets], np.str_)),
    )
    return Table("resets", columns, {"source": "jumps that the estimator announced"})


def _parameters(flight: Flight) -> Table:
    names = sorted(flight.parameters)
    columns = (
        Column("name", np.array(names, np.str_)),
        Column("value", np.array([flight.parameters[name] for name in names], np.float64)),
    )
    return Table("parameters", columns, {"source": "the vehicle's parameters, as far as the log has them"})


def _parameter_changes(flight: Flight) -> Table:
    columns = (
        *times(flight, np.array([change.t for change in flight.parameter_changes], np.float64)),
        Column("name", np.array([change.name for change in flight.parameter_changes], np.str_)),
        Column("value", np.array([change.value for change in flight.parameter_changes], np.float64)),
    )
    return Table("parameter_changes", columns, {"source": "parameters that got another value in the log"})


def _texts(flight: Flight) -> Table:
    columns = (
        *times(flight, np.array([text.t for text in flight.texts], np.float64)),
        Column("severity", np.array([text.severity for text in flight.texts], np.int64), "", "MAV_SEVERITY"),
        Column("text", np.array([text.text for text in flight.texts], np.str_)),
    )
    return Table("texts", columns, {"source": "what the vehicle said"})


def _events(flight: Flight) -> Table:
    columns = (
        *times(flight, np.array([event.t for event in flight.events], np.float64)),
        Column("kind", np.array([event.kind for event in flight.events], np.str_)),
        Column("text", np.array([event.text for event in flight.events], np.str_)),
    )
    return Table("events", columns, {"source": "arming, modes, errors"})


def _reckoning(flight: Flight, shown: Replay) -> Table:
    anchor = shown.anchors[np.searchsorted(shown.anchors, shown.t, side="right") - 1]
    columns = (
        *times(flight, shown.t),
        Column("anchor_t_s", anchor, "s", BOOT_CLOCK),
        *quaternions("q_imu", shown.q_imu),
        *euler_angles("imu_", shown.q_imu),
        *vectors("velocity_imu", shown.velocity_imu, "m/s", "mps", "NED"),
        *vectors("position_imu", shown.position_imu, "m", "m", "NED"),
        *quaternions("q_autopilot", shown.q_ref),
        *euler_angles("autopilot_", shown.q_ref),
        *vectors("velocity_autopilot", shown.velocity_ref, "m/s", "mps", "NED"),
        *vectors("position_autopilot", shown.position_ref, "m", "m", "NED"),
        *vectors("attitude_error", shown.attitude_error, "rad", "rad", "NED"),
        *vectors("velocity_error", shown.velocity_error, "m/s", "mps", "NED"),
        *vectors("position_error", shown.position_error, "m", "m", "NED"),
        Column("autopilot_known", shown.reference_valid.astype(np.int64), "", "0 inside a gap of its messages"),
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
        *(Column(f"position_{n}", v, u) for n, v, u in zip(_PLACE, where, ("°", "°", "m"), strict=False)),
        *vectors("velocity", velocity, "m/s", "mps", "NED"),
        *vectors("position", position, "m", "m", "NED"),
        *vectors("attitude_sigma", sigma[ATTITUDE.start], "rad", "rad", "NED"),
        *vectors("velocity_sigma", sigma[VELOCITY.start], "m/s", "mps", "NED"),
        *vectors("position_sigma", sigma[POSITION.start], "m", "m", "NED"),
    )
    if "gps_position" not in best.residuals:
        columns = tuple(c for c in columns if not c.name.startswith(("velocity", "position")))
    return Table("best_estimate", columns, {"source": ", ".join([best.imu.source, *best.residuals])})


def _drift(assessed: Assessment) -> Table:
    table = assessed.drift.to_dict()
    columns = [
        Column("horizon_s", np.array(table["horizon_s"]), "s"),
        *(Column(name, np.array(table[name], np.int64)) for name in ("windows", "excluded")),
    ]
    for quantity in QUANTITIES:
        keys = [quantity.column(statistic) for statistic in STATISTICS]
        columns += [Column(key, np.array(table[key]), quantity.unit) for key in keys]
        values = np.array([_or_nan(getattr(expected, quantity.attribute, None)) for expected in assessed.expected])
        columns.append(Column(quantity.column("expected"), values, quantity.unit, "1σ by the error budget"))
    about = {"imu": assessed.drift.imu, "method": assessed.drift.method, "middle": assessed.drift.middle}
    return Table("drift", tuple(columns), about)


def _windows(flight: Flight, rows: Sequence[DriftRow]) -> Table:
    """Every window of every horizon with its error at the end."""
    has_position = any(row.position_m is not None for row in rows)

    def joined(name: str) -> Array:
        return np.concatenate([getattr(row.errors, name) for row in rows])

    columns = (
        Column("horizon_s", np.repeat([row.horizon_s for row in rows], [row.windows for row in rows]), "s"),
        *times(flight, joined("anchor_s"), prefix="anchor_"),
        *times(flight, joined("end_s"), prefix="end_"),
        *vectors("attitude_error", joined("attitude"), "rad", "rad", "NED"),
        *(vectors("velocity_error", joined("velocity"), "m/s", "mps", "NED") if has_position else ()),
        *(vectors("position_error", joined("position"), "m", "m", "NED") if has_position else ()),
    )
    return Table("windows", columns, {"error": "autopilot minus IMU at the end of the window"})


def _findings(flight: Flight, assessed: Assessment) -> Table:
    findings = assessed.verdict.findings

    def text(name: str) -> Column:
        return Column(name, np.array([getattr(finding, name) for finding in findings], np.str_))

    columns = (
        *times(flight, np.array([finding.start_s for finding in findings], np.float64), prefix="start_"),
        *times(flight, np.array([finding.end_s for finding in findings], np.float64), prefix="end_"),
        *(text(name) for name in ("kind", "side", "severity", "evidence", "advice")),
    )
    return Table("findings", columns, {"status": assessed.verdict.status, "summary": assessed.verdict.summary})


def _calibration(fit: Calibration) -> Table:
    columns = (
        Column("figure", np.array(NAMES, np.str_)),
        Column("value", fit.values),
        Column("sigma", fit.sigma),
        Column("unit", np.array([_FIGURE_UNITS[name] for name in NAMES], np.str_)),
        Column("observable", np.array(fit.observable, np.int64)),
    )
    about = {"windows": str(fit.windows), "horizon_s": f"{fit.horizon_s:g}"}
    return Table("calibration", columns, about)


def _or_nan(value: float | None) -> float:
    return np.nan if value is None else value
