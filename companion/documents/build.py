"""Results → the JSON documents of `companion.documents.schema`."""

from __future__ import annotations

from dataclasses import asdict

import msgspec
import numpy as np

from companion.analysis import (
    PARTS,
    Agreement,
    Alignment,
    Assessment,
    AutopilotBias,
    Drift,
    DriftRow,
    Expected,
    RedundantImu,
    Rest,
    inventory,
    phases,
)
from companion.app.examination import Examination, Unexamined
from companion.app.recording import Recording, Source
from companion.documents import schema
from companion.documents.confusion import confusion_object
from companion.documents.verdict import verdict_object
from companion.model import Flight, ImuTrack, SensorInUse


def encode(document: msgspec.Struct) -> str:
    """Indented JSON text. Non-finite numbers become null."""
    return msgspec.json.format(msgspec.json.encode(document), indent=2).decode()


def info_document(recording: Recording) -> schema.Info:
    """`companion info --json`."""
    flights = [_info_flight(flight) for flight in recording.flights]
    others = [schema.OtherObject(other.sysid, other.compid, other.reason) for other in recording.bystanders]
    unknown = {str(number): count for number, count in recording.source.unknown_frames.items()}
    return schema.Info(
        log=log_object(recording.source), flights=flights, others=others, crowd=recording.crowd, unknown_frames=unknown
    )


def analysis_document(source: Source, examined: Examination) -> schema.Analysis:
    """`companion analyze --json`."""
    flight, assessment = examined.flight, examined.assessment
    table = assessment.drift
    analysed = schema.AnalyzeFlight(
        vehicle=vehicle_object(flight),
        boot=flight.boot,
        duration_s=flight.duration,
        imu=[_imu(flight, name, track, examined.gaps[name]) for name, track in flight.imus.items()],
        reference=_reference(flight),
        used_imu=table.imu,
        method=table.method,
        middle=table.middle,
        gravity_mps2=assessment.comparison.how.gravity,
        correction=examined.correction,
        notes=(*flight.notes, *table.notes),
        drift=[drift_object(row, expected) for row, expected in zip(table.rows, assessment.expected, strict=True)],
        figures=_figures(assessment),
        consistency=[
            schema.ConsistencyObject(
                row.horizon_s,
                expected.inside["attitude"],
                expected.inside.get("velocity"),
                expected.inside.get("position"),
                _judged(assessment.agreements[row.horizon_s]),
            )
            for row, expected in zip(table.rows, assessment.expected, strict=True)
            if expected is not None
        ],
        calibration=_calibration(assessment),
        rests=[_rest(rest) for rest in assessment.rests],
        autopilot_gyro_bias=_held(assessment.autopilot_bias),
        alignment=_alignment(examined.alignment),
        imus=[_redundant(other) for other in examined.redundant_imus],
        verdict=verdict_object(assessment.verdict, assessment.sensitivity),
        confusion=confusion_object(assessment.best.confusion if assessment.best else None),
    )
    return schema.Analysis(log=log_object(source), flights=[analysed])


def unexamined_document(source: Source, unexamined: Unexamined) -> schema.Analysis:
    """The same of a flight that cannot be examined: its verdict, and what the log has."""
    flight = unexamined.flight
    bare = schema.AnalyzeFlight(
        vehicle=vehicle_object(flight),
        boot=flight.boot,
        duration_s=flight.duration,
        imu=[_imu(flight, name, track, unexamined.gaps[name]) for name, track in flight.imus.items()],
        reference=_reference(flight),
        used_imu=None,
        method=None,
        middle=None,
        gravity_mps2=None,
        correction=None,
        notes=tuple(flight.notes),
        drift=[],
        figures=None,
        consistency=[],
        calibration=None,
        rests=[],
        autopilot_gyro_bias=None,
        alignment=None,
        imus=[],
        verdict=verdict_object(unexamined.verdict),
    )
    return schema.Analysis(log=log_object(source), flights=[bare])


def log_object(source: Source) -> schema.LogObject:
    """The "log" key."""
    return schema.LogObject(
        path=str(source.path).encode("utf-8", "replace").decode(),  # a name need not be UTF-8, JSON has to be
        size_bytes=source.size_bytes,
        frames=source.frames,
        bad_crc_frames=source.bad_crc_frames,
        skipped_bytes=source.skipped_bytes,
        content_bytes=source.content_bytes,
        trouble=source.trouble,
    )


def _info_flight(flight: Flight) -> schema.InfoFlight:
    """One of the "flights" of `info`."""
    return schema.InfoFlight(
        vehicle=vehicle_object(flight),
        boot=flight.boot,
        start_s=flight.start,
        duration_s=flight.duration,
        default_imu=flight.default_imu,
        reference=_reference(flight),
        notes=tuple(flight.notes),
        phases=[schema.PhaseObject(part.kind, part.start, part.end, part.reason) for part in phases(flight)],
        sensors=[schema.SensorObject(**asdict(item)) for item in inventory(flight)],
        imu_in_use=None if flight.imu_in_use is None else _in_use(flight.imu_in_use),
        aiding_in_use={kind: _in_use(used) for kind, used in flight.aiding_in_use.items()},
        resets=[schema.ResetObject(reset.t, reset.kind, reset.text, reset.core) for reset in flight.resets],
        parameter_changes=[schema.ParameterObject(one.t, one.name, one.value) for one in flight.parameter_changes],
        messages={
            name: schema.StatsObject(
                count=s.count, rate_hz=s.rate_hz, longest_gap_s=s.longest_gap_s, duplicates=s.duplicates
            )
            for name, s in flight.messages.items()
        },
    )


def _in_use(used: SensorInUse) -> list[schema.SensorInUseObject]:
    return [schema.SensorInUseObject(t, i) for t, i in used.changes]


def vehicle_object(flight: Flight) -> schema.VehicleObject:
    """Who flew."""
    v = flight.vehicle
    return schema.VehicleObject(sysid=v.sysid, compid=v.compid, autopilot=v.autopilot, type=v.type, firmware=v.firmware)


def _reference(flight: Flight) -> schema.ReferenceObject:
    return schema.ReferenceObject(
        attitude=flight.attitude.source if flight.attitude else None,
        position=flight.position.source if flight.position else None,
    )


def _imu(flight: Flight, name: str, track: ImuTrack, gaps: int) -> schema.ImuObject:
    stats = flight.messages.get(name)  # an on-board log has one message for all its IMUs
    return schema.ImuObject(
        message=name,
        samples=len(track),
        rate_hz=track.rate_hz,
        gaps=gaps,
        longest_gap_s=float(np.diff(track.t).max()) if len(track) > 1 else None,
        duplicates=stats.duplicates if stats else 0,
    )


def _judged(agreement: Agreement) -> schema.JudgedObject:
    inside = agreement.inside
    return schema.JudgedObject(
        agreement.windows, inside.get("attitude"), inside.get("velocity"), inside.get("position")
    )


def _redundant(other: RedundantImu) -> schema.RedundantImuObject:
    row = other.drift
    return schema.RedundantImuObject(
        message=other.imu,
        rate_hz=other.rate_hz,
        horizon_s=row.horizon_s,
        windows=row.windows,
        attitude_deg=row.attitude_deg,
        position_m=row.position_m,
        inside=other.inside,
    )


def _figures(assessment: Assessment) -> schema.FiguresObject:
    figures, noise = assessment.figures, assessment.measured_noise
    return schema.FiguresObject(figures.name, figures.reason, noise.gyro, noise.accel)


def _calibration(assessment: Assessment) -> schema.CalibrationObject | None:
    fit, by_best = assessment.calibration, assessment.judged_by_best
    if fit is None:
        return None

    def figure(part: str) -> schema.FigureObject:
        place = PARTS[part]
        return schema.FigureObject(
            tuple(fit.values[place].tolist()),
            tuple(fit.sigma[place].tolist()),
            fit.observable[place],
            tuple(other or None for other in fit.confounded[place]),
            fit.from_best[place],
        )

    return schema.CalibrationObject(
        windows=fit.windows,
        horizon_s=fit.horizon_s,
        gyro_bias_radps=figure("gyro_bias"),
        accel_bias_mps2=figure("accel_bias"),
        mounting_rad=figure("mounting"),
        time_offset_s=figure("time_offset"),
        gyro_scale=figure("gyro_scale"),
        accel_scale=figure("accel_scale"),
        gyro_misalignment_rad=figure("gyro_misalignment"),
        accel_misalignment_rad=figure("accel_misalignment"),
        lever_arm_m=figure("lever_arm"),
        level_force_mps2=schema.EstimateObject(*fit.level_force),
        before=_first_row(assessment.uncorrected),
        after=_first_row(assessment.corrected),
        best_estimate_before=_first_row(by_best and by_best[0]),
        best_estimate_after=_first_row(by_best and by_best[1]),
    )


def _first_row(drift: Drift | None) -> schema.DriftObject | None:
    return drift_object(drift.rows[0], None) if drift else None


def _rest(rest: Rest) -> schema.RestObject:
    return schema.RestObject(
        rest.start_s,
        rest.end_s,
        tuple(rest.gyro.tolist()),
        tuple(rest.gyro_sigma.tolist()),
        tuple(rest.accel.tolist()),
        rest.gyro_noise,
        rest.accel_noise,
    )


def _held(held: AutopilotBias | None) -> schema.AutopilotBiasObject | None:
    if held is None:
        return None
    return schema.AutopilotBiasObject(held.start_s, held.end_s, tuple(held.gyro.tolist()), tuple(held.sigma.tolist()))


def _alignment(alignment: Alignment | None) -> schema.AlignmentObject | None:
    if alignment is None:
        return None
    return schema.AlignmentObject(
        start_s=alignment.rest.start_s,
        end_s=alignment.rest.end_s,
        q_ned_frd=tuple(alignment.q_ned_frd.tolist()),
        heading_from=alignment.heading_from,
        tilt_sigma_rad=alignment.tilt_sigma,
        heading_sigma_rad=alignment.heading_sigma,
        magnetic_heading_rad=alignment.magnetic_rad,
        declination_rad=alignment.declination_rad,
        magnetic_minus_autopilot_rad=alignment.magnetic_error_rad,
        later=[schema.LaterObject(**asdict(row)) for row in alignment.later],
        notes=alignment.notes,
    )


def drift_object(row: DriftRow, expected: Expected | None) -> schema.DriftObject:
    """A row of the drift table, and what was expected of it."""
    return schema.DriftObject(
        horizon_s=row.horizon_s,
        windows=row.windows,
        excluded=row.excluded,
        attitude_deg=row.attitude_deg,
        velocity_mps=row.velocity_mps,
        position_m=row.position_m,
        expected=None
        if expected is None
        else schema.ExpectedObject(expected.attitude_deg, expected.velocity_mps, expected.position_m, expected.shares),
    )
