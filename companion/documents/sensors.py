"""`companion noise --json` and `companion preflight --json` (docs/json.md)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from companion.analysis import Ageing, AxisNoise, ImuNoise, Preflight
from companion.app.recording import Source
from companion.documents.document import Document, document, flight_head, of
from companion.estimation import AllanDeviation, Peak, WhiteNoise, folded_gain, folded_onto
from companion.model import Flight


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
