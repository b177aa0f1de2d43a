"""Results as JSON documents: the head of every one, the conversion to plain JSON values, and each command's own.

docs/json.md describes each key, and a test holds them: keys are added, never renamed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from companion.app.examination import Examination, Unexamined
from companion.app.recording import Recording, Source
from companion.comparison import PARTS, Alignment, AxisNoise, Drift, DriftRow, Expected, ImuNoise, phases
from companion.estimation import CONSTANTS, BestEstimate, Explained, hypothesis_of, probabilities
from companion.model import Array, BiasTrack, Flight, SensorInUse, inventory
from companion.noise import AllanDeviation, Peak, Sampling, WhiteNoise, folded_gain, folded_onto
from companion.verdict import Ageing, Assessment, AutopilotError, Contrast, Finding, Incident, Lanes, Preflight

Document = dict[str, Any]
"""Keys as they are printed. Values are plain (numbers, text, lists, dictionaries, None)."""

SCHEMA = 2


def document(source: Source, flights: list[Document], **more: Any) -> Document:
    """A document about flights of one log; more: keys of its own."""
    log = of(source, "size_bytes", "frames", "bad_crc_frames", "skipped_bytes", "content_bytes", "trouble")
    path = str(source.path).encode("utf-8", "replace").decode()  # a name need not be UTF-8, JSON has to be
    return plain({"schema": SCHEMA, "log": {"path": path, **log}, "flights": flights, **more})


def _of_flight(source: Source, flight: Flight, content: Document) -> Document:
    """A document about one flight of a log."""
    return document(source, [of(flight, "vehicle", "boot") | content])


def of(one: object, *names: str) -> Document:
    """Some attributes of an object under their own names."""
    return {name: getattr(one, name) for name in names}


def plain(document: Document) -> Document:
    """The same of plain values: dataclasses become dictionaries with their fields as keys, arrays become lists."""
    builtins: Document = msgspec.to_builtins(document, enc_hook=_plain)
    return builtins


def encode(document: Document) -> str:
    """Indented JSON text. Non-finite numbers become null."""
    return msgspec.json.format(msgspec.json.encode(document), indent=2).decode()


def _plain(value: object) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, Sequence):  # what a flight works out when it is first looked at
        return list(value)
    raise TypeError(f"a document has no {type(value).__name__}")


def info_document(recording: Recording) -> Document:
    """What is in a log."""
    return document(
        recording.source,
        [_flight(flight) for flight in recording.flights],
        others=[of(other, "sysid", "compid", "reason") for other in recording.bystanders],
        crowd=recording.unread_senders,
        unknown_frames={str(number): count for number, count in recording.source.unknown_frames.items()},
    )


def _flight(flight: Flight) -> Document:
    return {
        **of(flight, "vehicle", "boot"),
        "start_s": flight.start,
        "duration_s": flight.duration,
        "default_imu": flight.default_imu,
        "reference": reference(flight),
        "notes": flight.notes,
        "phases": [
            {"kind": part.kind, "start_s": part.start, "end_s": part.end, "reason": part.reason}
            for part in phases(flight)
        ],
        "sensors": inventory(flight),
        "imu_in_use": None if flight.imu_in_use is None else _in_use(flight.imu_in_use),
        "aiding_in_use": {kind: _in_use(used) for kind, used in flight.aiding_in_use.items()},
        "resets": [{"t_s": reset.t, **of(reset, "kind", "text", "core")} for reset in flight.resets],
        "parameter_changes": [{"t_s": one.t, **of(one, "name", "value")} for one in flight.parameter_changes],
        "messages": flight.messages,
    }


def reference(flight: Flight) -> Document:
    """The messages that the autopilot's state is taken from."""
    tracks = {"attitude": flight.attitude, "position": flight.position}
    return {name: track.source if track else None for name, track in tracks.items()}


def _in_use(used: SensorInUse) -> list[Document]:
    return [{"t_s": t, "instance": i} for t, i in used.changes]


def series_document(
    source: Source, flight: Flight, tables: Sequence[Document], series: Document | None = None
) -> Document:
    """tables: what the flight has, as `companion.export` lists them; series: the values of the one that was chosen."""
    return _of_flight(source, flight, {"tables": tables, "series": series})


def _confusion_part(best: BestEstimate | None) -> Document | None:
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
        "confusion": None if isinstance(examined, Unexamined) else _confusion_part(examined.assessment.best),
    }
    return _of_flight(source, flight, analysed)


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
        "moment": {"t_s": incident.moment.t, **of(incident.moment, "kind", "text")},
        **of(incident, "start_s", "end_s", "causes", "timeline", "imus", "tracking", "outputs", "missing"),
    }
    return _of_flight(source, flight, content)


def noise_document(source: Source, flight: Flight, noises: Sequence[ImuNoise]) -> Document:
    """The noise of a flight's IMUs."""
    return _of_flight(source, flight, {"imus": [_imu(noise) for noise in noises]})


def _imu(noise: ImuNoise) -> Document:
    sheet, rate = noise.imu_spec, noise.rate_hz
    return {
        "message": noise.imu,
        "rate_hz": rate,
        "sampling": _sampled(noise.sampling, rate),
        "accel_sampling": _sampled(noise.accel_sampling, rate),
        "imu_model": sheet.name,
        "datasheet": {
            "gyro_white": sheet.gyro.noise_density,
            "gyro_walk": sheet.gyro.bias_walk,
            "accel_white": sheet.accel.noise_density,
            "accel_walk": sheet.accel.bias_walk,
        },
        "rests": [
            {
                **of(rest, "start_s", "end_s"),
                "gyro": _at_rest(rest.gyro, rest.gyro_axes),
                "accel": _at_rest(rest.accel, rest.accel_axes),
            }
            for rest in noise.rests
        ],
        "flight": (flown := noise.flight)
        and {
            "duration_s": flown.duration_s,
            "segments": flown.spectrum.segments,
            "gyro": _in_flight(flown.gyro, flown.gyro_peaks, rate),
            "accel": _in_flight(flown.accel, flown.accel_peaks, rate),
        },
        "notes": noise.notes,
    }


def _sampled(sampling: Sampling, rate: float) -> Document:
    filtered = sampling.kind == "filtered"
    share = 1.0 - 1.0 / float(folded_gain(np.zeros(1), rate, sampling)[0]) if filtered else None
    return {**of(sampling, "kind", "corner_hz", "interval_s", "source", "confirmed"), "folded_share": share}


def _at_rest(curve: AllanDeviation, axes: Sequence[AxisNoise | None]) -> Document:
    return {
        "axes": [
            axis and {**of(axis, "white", "instability", "walk"), "below_quantisation": axis.hidden} for axis in axes
        ],
        "tau_s": curve.tau,
        "deviation": curve.deviation.T,
    }


def _in_flight(white: WhiteNoise | None, peaks: Sequence[Peak], rate: float) -> Document:
    return {
        "density": white and white.sampled,
        "sensor_density": white and white.sensor,
        "sigma": white and white.sigma,
        "below_quantisation": white and white.hidden,
        "band_hz": white and white.band_hz,
        "peaks": [
            {**of(peak, "axis", "frequency_hz", "amplitude"), "or_hz": folded_onto(peak.frequency_hz, rate)}
            for peak in peaks
        ],
    }


def preflight_document(source: Source, flight: Flight, result: Preflight, aged: Sequence[Ageing] = ()) -> Document:
    """The checks of a vehicle that stands, and those of its earlier flights beside them."""
    before = {(one.check.name, one.check.sensor): of(one, "before", "spread", "times", "changed") for one in aged}
    checked = {
        **of(result, "outcome", "start_s", "end_s", "motors_off"),
        "checks": [
            {
                **of(one, "name", "sensor", "outcome", "size", "sigma", "limit", "unit", "probability"),
                **of(one, "autopilot", "autopilot_limit", "note", "uncorrected"),
                "history": before.get((one.name, one.sensor)),
            }
            for one in result.checks
        ],
        **of(result, "vehicle_reports", "missing"),
    }
    return _of_flight(source, flight, checked)


def estimate_document(
    source: Source, flight: Flight, best: BestEstimate, errors: Sequence[AutopilotError], autopilot: BiasTrack | None
) -> Document:
    """A flight's best estimate. autopilot: the biases of its estimator."""
    states = best.states
    estimated = {
        "imu": best.imu.source,
        "keyframes": len(best.t),
        "start_s": float(best.t[0]),
        "end_s": float(best.t[-1]),
        "heading_from": best.heading_from,
        "witnesses": [
            {
                "name": name,
                "used": len(left.t),
                "unit": left.unit,
                "residual_rms": left.rms,
                "residual_over_sigma": left.normalised_rms,
                "scale": best.measurement_scale[name],
                "doubted_share": left.doubted,
            }
            for name, left in best.residuals.items()
        ],
        "explained": [_explained(one) for one in best.explained],
        "gyro_bias_radps": _bias(states.gyro_bias, best.gyro_bias_sigma, getattr(autopilot, "gyro", None)),
        "accel_bias_mps2": _bias(states.accel_bias, best.accel_bias_sigma, getattr(autopilot, "accel", None)),
        "noise": {
            "gyro_white": best.noise.gyro_noise,
            "accel_white": best.noise.accel_noise,
            "gyro_lasting": best.correlated[0],
            "accel_lasting": best.correlated[1],
        },
        "constants": {
            name: {"value": states.constants[place], "sigma": best.constants_sigma[place]}
            for name, (place, _) in CONSTANTS.items()
        },
        "detectable": best.detectable,
        "autopilot_error": errors,
        "notes": best.notes,
    }
    return _of_flight(source, flight, estimated)


def _explained(one: Explained) -> Document:
    kind = hypothesis_of(one.kind)
    return {
        "kind": one.kind,
        "side": kind.device,
        "shape": one.shape,
        "onset_s": one.onset,
        "onset_sigma_s": one.onset_sigma,
        "end_s": one.end if np.isfinite(one.end) else None,
        "size": one.size,
        "sigma": one.sigma,
        "unit": kind.unit,
        "probability": probabilities(one.rivals),
        "rivals": [of(rival, "kind", "shape", "log_odds", "fault") for rival in one.rivals],
    }


def _bias(value: Array, sigma: Array, autopilot: Array | None) -> Document:
    known = autopilot is not None and np.isfinite(autopilot).all(axis=1).any()
    return {
        "value": value.mean(axis=0),
        "sigma": np.median(sigma, axis=0),
        "first": value[0],
        "last": value[-1],
        "autopilot": np.nanmean(autopilot, axis=0) if autopilot is not None and known else None,
    }


def lanes_document(source: Source, flight: Flight, best: BestEstimate, lanes: Lanes) -> Document:
    """A flight's lanes against its best estimate."""
    judged = {
        "imu": best.imu.source,
        "lanes": [
            {**of(one, "name", "core", "source", "imu"), "start_s": float(one.t[0]), "end_s": float(one.t[-1])}
            for one in lanes.lanes
        ],
        "flown": [] if lanes.in_use is None else [{"t_s": t, "core": core} for t, core in lanes.in_use.changes],
        "switches": [
            {
                "t_s": one.t,
                **of(one, "before", "after", "judgement", "probability", "end_s"),
                "quantity": one.quantity or None,
                **of(one, "before_size", "after_size", "sigma", "reset_s", "why"),
            }
            for one in lanes.switches
        ],
        "spans": [of(one, "what", "start_s", "end_s", "flown", "right", "readers", "lanes") for one in lanes.spans],
        "notes": lanes.notes,
    }
    return _of_flight(source, flight, judged)
