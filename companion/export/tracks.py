"""A flight and what was made of it → tables: every track, both trajectories, the drift, the findings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from companion.analysis import NAMES, PARTS, Assessment, Calibration, DriftRow, Replay, phases, replay
from companion.estimation import ATTITUDE, POSITION, VELOCITY, BestEstimate
from companion.export.kml import places
from companion.export.sensors import imu_table, sensor_tables, series_table
from companion.export.table import BOOT_CLOCK, Column, Table, euler_angles, quaternions, records, times, vectors
from companion.model import Array, AttitudeTrack, Flight, PositionTrack, interpolated
from companion.present import CALIBRATED, QUANTITIES, STATISTICS

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
        yield _position(flight, flight.position)
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


def _attitude(flight: Flight, track: AttitudeTrack) -> Table:
    columns = (
        *times(flight, track.t),
        *quaternions("q", track.q_ned_frd),
        *euler_angles("", track.q_ned_frd),
        *vectors("rate", "radps", track.rates, "FRD"),
    )
    return Table("attitude", columns, {"source": track.source, "q": "Hamilton, wxyz, turns FRD vectors into NED"})


def _position(flight: Flight, track: PositionTrack) -> Table:
    columns = (
        *times(flight, track.t),
        *vectors("position", "m", track.position, "NED"),
        *vectors("velocity", "mps", track.velocity, "NED"),
    )
    return Table("position", columns, {"source": track.source})


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
        *vectors("position", "m", position, "NED"),
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
