"""`companion smooth --json` (docs/json.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec
import numpy as np

from companion.analysis import AutopilotError
from companion.app.recording import Source
from companion.documents.build import log_object, vehicle_object
from companion.documents.schema import SCHEMA, LogObject, VehicleObject
from companion.estimation import CONSTANTS, BestEstimate, Residuals, kind_of, probabilities
from companion.model import BiasTrack, Flight


class WitnessObject(msgspec.Struct, frozen=True):
    """What the best estimate leaves of a sensor's readings."""

    name: str
    used: int
    unit: str
    residual_rms: float
    residual_over_sigma: float
    scale: float
    doubted_share: float


class RivalObject(msgspec.Struct, frozen=True):
    """What else it could have been."""

    kind: str
    shape: str
    log_odds: float  # natural logarithm of its posterior odds against nothing
    fault: float  # probability, if it occurred, that its size is harmful


class ExplainedObject(msgspec.Struct, frozen=True):
    """Something that changed during the flight."""

    kind: str
    side: str
    shape: str
    onset_s: float
    onset_sigma_s: float
    end_s: float | None
    size: tuple[float, ...]
    sigma: tuple[float, ...]
    unit: str
    probability: dict[str, float]  # by side, "nobody" among them
    rivals: list[RivalObject]  # every hypothesis in its place, itself among them


class BiasObject(msgspec.Struct, frozen=True):
    """How much a sensor reads too much: mean over the flight, 1σ, and what the autopilot's estimator believes."""

    value: tuple[float, ...]
    sigma: tuple[float, ...]
    first: tuple[float, ...]
    last: tuple[float, ...]
    autopilot: tuple[float, ...] | None


class ConstantObject(msgspec.Struct, frozen=True):
    """A constant of the flight."""

    value: tuple[float, ...]
    sigma: tuple[float, ...]


class AutopilotErrorObject(msgspec.Struct, frozen=True):
    """Autopilot minus best estimate, one quantity."""

    quantity: str
    unit: str
    samples: int
    median: float
    p95: float
    worst: float
    worst_s: float
    sigma: float
    typical_sigma: float


class EstimateFlight(msgspec.Struct, frozen=True):
    """A flight in `companion smooth`."""

    vehicle: VehicleObject
    boot: int
    imu: str
    keyframes: int
    start_s: float
    end_s: float
    heading_from: str
    witnesses: list[WitnessObject]
    explained: list[ExplainedObject]
    gyro_bias_radps: BiasObject
    accel_bias_mps2: BiasObject
    noise: Mapping[str, float]
    constants: Mapping[str, ConstantObject]
    detectable: Mapping[str, float]
    autopilot_error: list[AutopilotErrorObject]
    notes: tuple[str, ...]


class EstimateDocument(msgspec.Struct, frozen=True, kw_only=True):
    """`companion smooth --json`."""

    schema: int = SCHEMA
    log: LogObject
    flights: list[EstimateFlight]


def estimate_document(
    source: Source, flight: Flight, best: BestEstimate, errors: Sequence[AutopilotError], believed: BiasTrack | None
) -> EstimateDocument:
    """The document of a flight's best estimate."""
    s = best.states
    estimated = EstimateFlight(
        vehicle=vehicle_object(flight),
        boot=flight.boot,
        imu=best.imu.source,
        keyframes=len(best.t),
        start_s=float(best.t[0]),
        end_s=float(best.t[-1]),
        heading_from=best.heading_from,
        witnesses=[_witness(name, left, best) for name, left in best.residuals.items()],
        explained=[
            ExplainedObject(
                one.kind,
                kind_of(one.kind).side,
                one.shape,
                one.onset,
                one.onset_sigma,
                one.end if np.isfinite(one.end) else None,
                tuple(one.size.tolist()),
                tuple(one.sigma.tolist()),
                kind_of(one.kind).unit,
                probabilities(one.rivals),
                [RivalObject(other.kind, other.shape, other.log_odds, other.fault) for other in one.rivals],
            )
            for one in best.explained
        ],
        gyro_bias_radps=_bias(s.gyro_bias, best.gyro_bias_sigma, None if believed is None else believed.gyro),
        accel_bias_mps2=_bias(s.accel_bias, best.accel_bias_sigma, None if believed is None else believed.accel),
        noise={
            "gyro_white": best.noise.gyro_noise,
            "accel_white": best.noise.accel_noise,
            "gyro_lasting": best.lasting[0],
            "accel_lasting": best.lasting[1],
        },
        constants={
            name: ConstantObject(tuple(s.constants[place].tolist()), tuple(best.constants_sigma[place].tolist()))
            for name, (place, _) in CONSTANTS.items()
        },
        detectable=best.detectable,
        autopilot_error=[
            AutopilotErrorObject(**{name: getattr(one, name) for name in one.__slots__}) for one in errors
        ],
        notes=best.notes,
    )
    return EstimateDocument(log=log_object(source), flights=[estimated])


def _witness(name: str, left: Residuals, best: BestEstimate) -> WitnessObject:
    return WitnessObject(
        name, len(left.t), left.unit, left.rms, left.normalised_rms, best.measurement_scale[name], left.doubted
    )


def _bias(value: np.ndarray, sigma: np.ndarray, believed: np.ndarray | None) -> BiasObject:
    held = None
    if believed is not None and np.isfinite(believed).all(axis=1).any():
        held = tuple(np.nanmean(believed, axis=0).tolist())
    return BiasObject(
        tuple(value.mean(axis=0).tolist()),
        tuple(np.median(sigma, axis=0).tolist()),
        tuple(value[0].tolist()),
        tuple(value[-1].tolist()),
        held,
    )
