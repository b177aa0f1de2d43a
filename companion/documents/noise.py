"""`companion noise --json` (docs/json.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec
import numpy as np

from companion.analysis import AxisNoise, FlightNoise, ImuNoise, RestNoise
from companion.app.recording import Source
from companion.documents.build import log_object, vehicle_object
from companion.documents.schema import SCHEMA, LogObject, VehicleObject
from companion.estimation import AllanDeviation, Coefficient, Peak, WhiteNoise, folded_gain, folded_onto
from companion.model import Flight


class CoefficientObject(msgspec.Struct, frozen=True):
    """A figure with its 95 % interval; without a value, `high` is an upper bound."""

    value: float | None
    low: float
    high: float


class AxisObject(msgspec.Struct, frozen=True):
    """An axis at rest."""

    white: CoefficientObject
    instability: CoefficientObject | None
    walk: CoefficientObject | None
    below_quantisation: bool


class RestSensorObject(msgspec.Struct, frozen=True):
    """A sensor at rest: its figures by axis, and its Allan deviation."""

    axes: tuple[AxisObject | None, ...]
    tau_s: tuple[float, ...]
    deviation: tuple[tuple[float, ...], ...]


class RestObject(msgspec.Struct, frozen=True):
    """A rest."""

    start_s: float
    end_s: float
    gyro: RestSensorObject
    accel: RestSensorObject


class PeakObject(msgspec.Struct, frozen=True):
    """A line in a spectrum, and what else it may be."""

    axis: int
    frequency_hz: float
    amplitude: float
    or_hz: tuple[float, ...]


class FlightSensorObject(msgspec.Struct, frozen=True):
    """A sensor in flight."""

    density: tuple[float, ...] | None
    sensor_density: tuple[float, ...] | None
    sigma: tuple[float, ...] | None
    below_quantisation: tuple[bool, ...] | None
    band_hz: tuple[float, float] | None
    peaks: list[PeakObject]


class FlightObject(msgspec.Struct, frozen=True):
    """An IMU in flight."""

    duration_s: float
    segments: int
    gyro: FlightSensorObject
    accel: FlightSensorObject


class SamplingObject(msgspec.Struct, frozen=True):
    """How the readings were taken from the sensor's signal."""

    kind: str
    corner_hz: float | None
    interval_s: float | None
    source: str
    confirmed: bool | None
    folded_share: float | None


class ImuNoiseObject(msgspec.Struct, frozen=True):
    """The noise of an IMU message."""

    message: str
    rate_hz: float
    sampling: SamplingObject
    imu_model: str
    datasheet: Mapping[str, float]
    rests: list[RestObject]
    flight: FlightObject | None
    notes: tuple[str, ...]


class NoiseFlight(msgspec.Struct, frozen=True):
    """A flight in `companion noise`."""

    vehicle: VehicleObject
    boot: int
    imus: list[ImuNoiseObject]


class Noise(msgspec.Struct, frozen=True, kw_only=True):
    """`companion noise --json`."""

    schema: int = SCHEMA
    log: LogObject
    flights: list[NoiseFlight]


def noise_document(source: Source, flight: Flight, noises: Sequence[ImuNoise]) -> Noise:
    """The document of a flight's IMUs."""
    imus = [_imu(noise) for noise in noises]
    return Noise(log=log_object(source), flights=[NoiseFlight(vehicle_object(flight), flight.boot, imus)])


def _imu(noise: ImuNoise) -> ImuNoiseObject:
    how, sheet = noise.sampling, noise.figures
    told = how.kind == "filtered"
    share = 1.0 - 1.0 / float(folded_gain(np.zeros(1), noise.rate_hz, how)[0]) if told else None
    return ImuNoiseObject(
        message=noise.imu,
        rate_hz=noise.rate_hz,
        sampling=SamplingObject(how.kind, how.corner_hz, how.interval_s, how.source, how.confirmed, share),
        imu_model=sheet.name,
        datasheet={
            "gyro_white": sheet.gyro.noise_density,
            "gyro_walk": sheet.gyro.bias_walk,
            "accel_white": sheet.accel.noise_density,
            "accel_walk": sheet.accel.bias_walk,
        },
        rests=[_rest(rest) for rest in noise.rests],
        flight=_flight(noise.flight, noise.rate_hz) if noise.flight else None,
        notes=noise.notes,
    )


def _rest(rest: RestNoise) -> RestObject:
    return RestObject(
        rest.start_s, rest.end_s, _resting(rest.gyro, rest.gyro_axes), _resting(rest.accel, rest.accel_axes)
    )


def _resting(curve: AllanDeviation, axes: tuple[AxisNoise | None, ...]) -> RestSensorObject:
    return RestSensorObject(
        tuple(None if axis is None else _axis(axis) for axis in axes),
        tuple(curve.tau.tolist()),
        tuple(tuple(row) for row in curve.deviation.T.tolist()),
    )


def _axis(axis: AxisNoise) -> AxisObject:
    return AxisObject(
        _coefficient(axis.white),
        None if axis.instability is None else _coefficient(axis.instability),
        None if axis.walk is None else _coefficient(axis.walk),
        axis.hidden,
    )


def _coefficient(coefficient: Coefficient) -> CoefficientObject:
    return CoefficientObject(coefficient.value, coefficient.low, coefficient.high)


def _flight(noise: FlightNoise, rate: float) -> FlightObject:
    return FlightObject(
        noise.duration_s,
        noise.spectrum.segments,
        _flying(noise.gyro, noise.gyro_peaks, rate),
        _flying(noise.accel, noise.accel_peaks, rate),
    )


def _flying(white: WhiteNoise | None, lines: tuple[Peak, ...], rate: float) -> FlightSensorObject:
    shown = [PeakObject(p.axis, p.frequency_hz, p.amplitude, folded_onto(p.frequency_hz, rate)) for p in lines]
    if white is None:
        return FlightSensorObject(None, None, None, None, None, shown)
    return FlightSensorObject(
        tuple(white.sampled.tolist()),
        None if white.sensor is None else tuple(white.sensor.tolist()),
        tuple(white.sigma.tolist()),
        tuple(white.hidden.tolist()),
        white.band_hz,
        shown,
    )
