"""`companion analyze --json`, `companion compare --json` and `companion incident --json` (docs/json.md)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from companion.analysis import (
    PARTS,
    Alignment,
    Assessment,
    Contrast,
    Drift,
    DriftRow,
    Expected,
    Finding,
    Incident,
)
from companion.app.examination import Examination, Unexamined
from companion.app.recording import Source
from companion.documents.document import SCHEMA, Document, document, flight_head, of, plain, reference
from companion.estimation import BestEstimate, hypothesis_of
from companion.model import Flight


def confusion_part(best: BestEstimate | None) -> Document | None:
    """None where it was not requested, or no best estimate could be made."""
    if best is None or (matrix := best.confusion) is None:
        return None
    faults = [
        {
            "kind": row.kind,
            "side": hypothesis_of(row.kind).device,
            "shape": row.shape,
            "lasts_s": row.lasts or None,
            "unit": hypothesis_of(row.kind).unit,
            **of(row, "detectable", "identifiable", "called"),
            "undetected": {
                "tilt_rad": row.tilt,
                "heading_rad": row.heading,
                "velocity_mps": row.velocity,
                "position_m": row.position,
            },
        }
        for row in matrix.rows
    ]
    return {"draws": matrix.draws, "faults": faults, "not_shown": matrix.not_shown}


_QUANTITIES = {"attitude": "attitude_deg", "velocity": "velocity_mps", "position": "position_m"}
_FITTED = {
    "gyro_bias": "radps", "accel_bias": "mps2", "mounting": "rad", "time_offset": "s", "gyro_scale": "",
    "accel_scale": "", "gyro_misalignment": "rad", "accel_misalignment": "rad", "lever_arm": "m",
}  # fmt: skip
"""Part of a calibration → the unit at the end of its key."""


def analysis_document(source: Source, examined: Examination | Unexamined) -> Document:
    """An examined flight; of one that cannot be examined its verdict, and what the log has."""
    flight = examined.flight
    known = _UNEXAMINED | {"notes": flight.notes} if isinstance(examined, Unexamined) else _examined(examined)
    analysed = {
        **flight_head(flight),
        "duration_s": flight.duration,
        "imu": [
            {
                "message": name,
                "samples": len(track),
                "rate_hz": track.rate_hz,
                "gaps": examined.gaps[name],
                "longest_gap_s": float(np.diff(track.t).max()) if len(track) > 1 else None,
                "duplicates": flight.messages[name].duplicates if name in flight.messages else 0,
            }
            for name, track in flight.imus.items()
        ],
        "reference": reference(flight),
        **known,
        "verdict": _verdict(examined),
        "confusion": None if isinstance(examined, Unexamined) else confusion_part(examined.assessment.best),
    }
    return document(source, [analysed])


_UNEXAMINED: Document = {
    **dict.fromkeys(("used_imu", "method", "middle", "gravity_mps2", "correction")), "notes": (), "drift": (),
    "figures": None, "consistency": (), "calibration": None, "rests": (), "autopilot_gyro_bias": None,
    "alignment": None, "imus": (),
}  # fmt: skip
"""The keys of `_examined`, where nothing was examined."""


def _examined(examined: Examination) -> Document:
    assessment = examined.assessment
    table, noise = assessment.drift, assessment.measured_noise
    rows = list(zip(table.rows, assessment.expected, strict=True))
    return {
        "used_imu": table.imu,
        **of(table, "method", "middle"),
        "gravity_mps2": assessment.comparison.how.gravity,
        "correction": examined.correction,
        "notes": [*examined.flight.notes, *table.notes],
        "drift": [_drift(row, expected) for row, expected in rows],
        "figures": {
            **of(assessment.imu_spec, "name", "reason"),
            "measured_gyro_noise": noise.gyro,
            "measured_accel_noise": noise.accel,
        },
        "consistency": [
            {
                "horizon_s": row.horizon_s,
                **_by_quantity(expected.inside),
                "judged": {"windows": judged.windows, **_by_quantity(judged.inside)},
            }
            for row, expected in rows
            if expected is not None and (judged := assessment.agreements[row.horizon_s])
        ],
        "calibration": _calibration(assessment),
        "rests": [
            {
                **of(rest, "start_s", "end_s"),
                "gyro_bias_radps": rest.gyro,
                "gyro_bias_sigma_radps": rest.gyro_sigma,
                "accel_mps2": rest.accel,
                **of(rest, "gyro_noise", "accel_noise"),
            }
            for rest in assessment.rests
        ],
        "autopilot_gyro_bias": (held := assessment.autopilot_bias)
        and {**of(held, "start_s", "end_s"), "value": held.gyro, "sigma": held.sigma},
        "alignment": examined.alignment and _alignment(examined.alignment),
        "imus": [
            {
                "message": other.imu,
                "rate_hz": other.rate_hz,
                **of(other.drift, "horizon_s", "windows", "attitude_deg", "position_m"),
                "inside": other.inside,
            }
            for other in examined.redundant_imus
        ],
    }


def contrast_document(
    contrast: Contrast, a: tuple[Source, Examination], b: tuple[Source, Examination], *, same_flight: bool
) -> Document:
    """Both analyses whole, and what differs."""
    return plain({
        "schema": SCHEMA,
        "a": analysis_document(*a),
        "b": analysis_document(*b),
        "same_flight": same_flight,
        "drift": [
            {
                "horizon_s": row.a.horizon_s,
                "a": _drift(row.a, row.expected_a),
                "b": _drift(row.b, row.expected_b),
                "change": {
                    quantity: of(change, "ratio", "low", "high", "paired", "direction")
                    for quantity, change in row.changes.items()
                },
            }
            for row in contrast.rows
        ],
        "findings": {
            "gone": [_finding(one) for one in contrast.gone],
            "new": [_finding(one) for one in contrast.new],
            "kept": contrast.kept,
        },
        "calibration": [of(figure, "name", "a", "b", "sigma", "differs") for figure in contrast.figures],
    })  # fmt: skip


def _verdict(examined: Examination | Unexamined) -> Document:
    verdict = examined.verdict
    could = None if isinstance(examined, Unexamined) else examined.assessment.sensitivity
    return {
        **of(verdict, "status", "summary"),
        "findings": [_finding(one) for one in verdict.findings],
        "cause": verdict.cause,
        "detectable": {} if could is None else could.smallest,
        "not_judged": () if could is None else could.not_judged,
        **of(verdict, "probability", "flights"),
    }


def _finding(finding: Finding) -> Document:
    """Without the numbers behind it."""
    return of(finding, "kind", "side", "severity", "start_s", "end_s", "evidence", "advice")


def _drift(row: DriftRow, expected: Expected | None) -> Document:
    """A row of the drift table, and what was expected of it."""
    keys = _QUANTITIES.values()
    return {
        **of(row, "horizon_s", "windows", "excluded", *keys),
        "expected": None if expected is None else of(expected, *keys, "shares"),
    }


def _by_quantity(inside: Mapping[str, float]) -> Document:
    return {quantity: inside.get(quantity) for quantity in _QUANTITIES}


def _calibration(assessment: Assessment) -> Document | None:
    fit, by_best = assessment.calibration, assessment.judged_by_best or (None, None)
    if fit is None:
        return None

    def parameter(place: slice) -> Document:
        return {
            "value": fit.values[place],
            "sigma": fit.sigma[place],
            "observable": fit.observable[place],
            "confounded": [other or None for other in fit.confounded[place]],
            "from_best_estimate": fit.from_best[place],
        }

    def first(drift: Drift | None) -> Document | None:
        return None if drift is None else _drift(drift.rows[0], None)

    return {
        **of(fit, "windows", "horizon_s"),
        **{f"{part}_{unit}".removesuffix("_"): parameter(PARTS[part]) for part, unit in _FITTED.items()},
        "level_force_mps2": dict(zip(("value", "sigma"), fit.level_force, strict=True)),
        "before": first(assessment.uncorrected),
        "after": first(assessment.corrected),
        "best_estimate_before": first(by_best[0]),
        "best_estimate_after": first(by_best[1]),
    }


def _alignment(alignment: Alignment) -> Document:
    return {
        **of(alignment.rest, "start_s", "end_s"),
        **of(alignment, "q_ned_frd", "heading_from"),
        "tilt_sigma_rad": alignment.tilt_sigma,
        "heading_sigma_rad": alignment.heading_sigma,
        "magnetic_heading_rad": alignment.magnetic_rad,
        "declination_rad": alignment.declination_rad,
        "magnetic_minus_autopilot_rad": alignment.magnetic_error_rad,
        **of(alignment, "later", "notes"),
    }


def incident_document(source: Source, flight: Flight, incident: Incident) -> Document:
    """The seconds around an incident."""
    content = {
        **flight_head(flight),
        "moment": {"t_s": incident.moment.t, **of(incident.moment, "kind", "text")},
        **of(incident, "start_s", "end_s", "causes", "timeline", "imus", "tracking", "outputs", "missing"),
    }
    return document(source, [content])
