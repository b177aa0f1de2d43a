"""`companion noise --json`, `preflight`, `smooth` and `lanes` (docs/json.md): the sensors and what they tell."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from companion.analysis import Ageing, AutopilotError, AxisNoise, ImuNoise, Lanes, Preflight
from companion.app.recording import Source
from companion.documents.document import Document, document, flight_head, of
from companion.estimation import (
    CONSTANTS,
    AllanDeviation,
    BestEstimate,
    Explained,
    Peak,
    WhiteNoise,
    folded_gain,
    folded_onto,
    hypothesis_of,
    probabilities,
)
from companion.model import Array, BiasTrack, Flight


def noise_document(source: Source, flight: Flight, noises: Sequence[ImuNoise]) -> Document:
    """The noise of a flight's IMUs."""
    return document(source, [{**flight_head(flight), "imus": [_imu(noise) for noise in noises]}])


def _imu(noise: ImuNoise) -> Document:
    sampling, sheet, rate = noise.sampling, noise.imu_spec, noise.rate_hz
    filtered = sampling.kind == "filtered"
    share = 1.0 - 1.0 / float(folded_gain(np.zeros(1), rate, sampling)[0]) if filtered else None
    return {
        "message": noise.imu,
        "rate_hz": rate,
        "sampling": {
            **of(sampling, "kind", "corner_hz", "interval_s", "source", "confirmed"),
            "folded_share": share,
        },
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
        **flight_head(flight),
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
    return document(source, [checked])


def estimate_document(
    source: Source, flight: Flight, best: BestEstimate, errors: Sequence[AutopilotError], autopilot: BiasTrack | None
) -> Document:
    """A flight's best estimate. autopilot: the biases of its estimator."""
    states = best.states
    estimated = {
        **flight_head(flight),
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
    return document(source, [estimated])


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
        **flight_head(flight),
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
    return document(source, [judged])
