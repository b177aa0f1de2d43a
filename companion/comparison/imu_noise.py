"""The noise of an IMU beside its data sheet: at rest, in flight, and which of its figures to believe."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from companion.comparison.alignment import Rest, rests
from companion.comparison.imu_spec import ImuSpec, SensorSpec
from companion.comparison.reference import Limits, within_any
from companion.constants import check, healthy
from companion.model import Array, DataError, Flight, ImuTrack, rows
from companion.noise import (
    AllanDeviation,
    Coefficient,
    Peak,
    Sampling,
    SensorName,
    Spectrum,
    WhiteNoise,
    allan_deviation,
    confirmed_sampling,
    imu_spectrum,
    noise_figures,
    peaks,
    quantisation_bound,
    sampling_of,
    stretches,
    white_noise,
)

_SENSORS: tuple[SensorName, ...] = ("gyro", "accel")
_AXES = "xyz"


@dataclass(frozen=True, slots=True)
class AxisNoise:
    """One axis at rest. Its unit u is rad/s or m/s²."""

    white: Coefficient  # N, u/√Hz, of the readings as they are sampled
    instability: Coefficient | None  # B, u; None where the steps of the readings hide it
    walk: Coefficient | None  # K, u/√s
    hidden: bool  # below quantisation: `white` is an upper bound


@dataclass(frozen=True, slots=True, eq=False)
class RestNoise:
    """A rest of an IMU."""

    start_s: float  # boot clock
    end_s: float
    gyro: AllanDeviation
    accel: AllanDeviation
    gyro_axes: tuple[AxisNoise | None, ...]  # forward, right, down; None for an axis that never changes
    accel_axes: tuple[AxisNoise | None, ...]

    @property
    def duration_s(self) -> float:
        """s"""
        return self.end_s - self.start_s


@dataclass(frozen=True, slots=True, eq=False)
class FlightNoise:
    """An IMU in flight: all that is not rest, and armed where arming is known."""

    duration_s: float
    spectrum: Spectrum
    gyro: WhiteNoise | None  # None where the rate is too low to read it
    accel: WhiteNoise | None
    gyro_peaks: tuple[Peak, ...]
    accel_peaks: tuple[Peak, ...]


@dataclass(frozen=True, slots=True, eq=False)
class ImuNoise:
    """The noise of one IMU of a flight."""

    imu: str
    rate_hz: float
    sampling: Sampling  # how the gyro was read
    accel_sampling: Sampling  # the same, unless the log gives the accelerometer a low-pass of its own
    imu_spec: ImuSpec  # the data sheet's
    rests: tuple[RestNoise, ...]  # those of two minutes or more, else the longest if it has ten seconds
    flight: FlightNoise | None  # None where no part of the flight is long enough
    notes: tuple[str, ...]

    @property
    def rest(self) -> RestNoise | None:
        """The longest one."""
        return max(self.rests, key=lambda rest: rest.duration_s, default=None)


def imu_noise(flight: Flight, imu: str, imu_spec: ImuSpec, limits: Limits) -> ImuNoise:
    """The noise of the IMU message `imu` of a flight.

    Raises DataError when the flight lacks it, or when it neither rests for ten seconds nor has a stretch without gaps
    that is long enough for a spectrum.
    """
    track = flight.imu(imu)
    gap = limits.longest_step(track.t)
    still = rests(flight, track, imu_spec)
    chosen = _chosen(still)
    sampling = _sampling(track, chosen, gap)
    resting = tuple(made for rest in chosen if (made := _rest_noise(rest.of(track), sampling, gap)))
    flying = _flight_noise(_flown(flight, track, still), sampling, gap)
    if not resting and flying is None:
        lacking = f"no rest of {check.SHORT_REST_S:g} s and no stretch without a gap that is long enough for a spectrum"
        samples = f"{track.source} has {len(track)} samples in {track.t[-1] - track.t[0]:.1f} s"
        raise DataError(f"{samples}: {lacking}. {flight.how_to_record}.")
    noise = ImuNoise(track.source, track.rate_hz, *sampling, imu_spec, resting, flying, ())
    return replace(noise, notes=tuple(_notes(noise, track)))


@dataclass(frozen=True, slots=True)
class FlightDensity:
    """White-noise density in flight, worst axis: the number that everything says of it; None where none is told."""

    gyro: float | None  # rad/s/√Hz
    accel: float | None  # m/s²/√Hz


def noise_in_flight(flight: Flight, track: ImuTrack, imu_spec: ImuSpec, limits: Limits) -> FlightDensity:
    """What `imu_noise` says of the flight, without what takes long there. None where the steps hide every axis."""
    still, gap = rests(flight, track, imu_spec), limits.longest_step(track.t)
    sampling, flown = _sampling(track, _chosen(still), gap), _flown(flight, track, still)

    def worst(white: WhiteNoise | None) -> float | None:
        seen = white.sampled[~white.hidden] if white is not None else np.zeros(0)
        return float(seen.max()) if len(seen) else None

    each = zip(_SENSORS, sampling, strict=True)
    return FlightDensity(*(worst(white_noise(flown, sensor, gap, how)) for sensor, how in each))


_Samplings = tuple[Sampling, Sampling]
"""Of gyro and accelerometer."""


def _sampling(track: ImuTrack, chosen: Sequence[Rest], gap: float) -> _Samplings:
    """How the readings were taken, confirmed by the longest rest where there is one.

    By the spectra of both sensors together, unless the log says that they have low-passes of their own.
    """
    longest = max(chosen, key=lambda rest: rest.duration_s, default=None)
    if sampling_of(track, "gyro") == sampling_of(track, "accel"):
        both = confirmed_sampling(longest.of(track), gap) if longest else sampling_of(track)
        return both, both
    rest = None if longest is None else longest.of(track)
    gyro, accel = (confirmed_sampling(rest, gap, one) if rest else sampling_of(track, one) for one in _SENSORS)
    return gyro, accel


def _chosen(still: tuple[Rest, ...]) -> list[Rest]:
    long = [rest for rest in still if rest.duration_s >= check.LONG_REST_S]
    by_length = sorted(still, key=lambda rest: -rest.duration_s)
    return long or [rest for rest in by_length[:1] if rest.duration_s >= check.SHORT_REST_S]


def _flown(flight: Flight, track: ImuTrack, still: tuple[Rest, ...]) -> ImuTrack:
    """The samples in flight: what is cut out is a gap."""
    mask = ~within_any(track.t, [(rest.start_s, rest.end_s) for rest in still])
    flying = flight.armed(track.t, track.t)
    return rows(track, mask & flying if flying is not None and flying.any() else mask)


def _rest_noise(track: ImuTrack, sampling: _Samplings, gap: float) -> RestNoise | None:
    """The Allan deviation over the longest stretch of a rest that has no gap; single lost samples are closed up."""
    a, b = max(stretches(track.t, gap), key=lambda edges: edges[1] - edges[0], default=(0, 0))
    part = track[a:b]
    if len(part) < 2:
        return None
    rate = float((len(part) - 1) / (part.t[-1] - part.t[0]))
    gyro, accel = allan_deviation(part.gyro, rate), allan_deviation(part.accel, rate)
    if gyro is None or accel is None:
        return None
    gyro_axes = tuple(_axis(part.gyro[:, i], gyro, i, part.gyro_step, rate, sampling[0]) for i in range(3))
    accel_axes = tuple(_axis(part.accel[:, i], accel, i, part.accel_step, rate, sampling[1]) for i in range(3))
    return RestNoise(float(part.t[0]), float(part.t[-1]), gyro, accel, gyro_axes, accel_axes)


def _axis(
    readings: Array, allan: AllanDeviation, axis: int, step: float, rate: float, sampling: Sampling
) -> AxisNoise | None:
    bound = quantisation_bound(readings, step, rate, sampling)
    if bound is not None:
        return AxisNoise(Coefficient(None, 0.0, bound), None, None, hidden=True)
    shortest = check.FILTERED_PERIODS / sampling.corner_hz if sampling.corner_hz else 0.0
    fitted = noise_figures(allan, axis, shortest, step**2 / (12.0 * rate))
    return AxisNoise(fitted.white, fitted.instability, fitted.walk, hidden=False) if fitted else None


def _flight_noise(track: ImuTrack, sampling: _Samplings, gap: float) -> FlightNoise | None:
    spectrum = imu_spectrum(track, gap)
    if spectrum is None:
        return None
    each = zip(_SENSORS, sampling, strict=True)
    gyro, accel = (white_noise(track, sensor, gap, how) for sensor, how in each)
    seconds = float(sum(track.t[b - 1] - track.t[a] for a, b in stretches(track.t, gap)))
    return FlightNoise(seconds, spectrum, gyro, accel, peaks(spectrum, spectrum.gyro), peaks(spectrum, spectrum.accel))


def _notes(noise: ImuNoise, track: ImuTrack) -> Iterator[str]:
    rest, flight = noise.rest, noise.flight
    if rest is None:
        yield f"no rest of {check.SHORT_REST_S:g} s: N is that of the flight, vibration included; B and K are not told"
    elif rest.duration_s < check.LONG_REST_S:
        longest = f"no rest of {check.LONG_REST_S:g} s: the longest has {rest.duration_s:.0f} s, which tells N at best"
        yield f"{longest}; for B and K record 10 minutes or more in which the vehicle stands still"
    if flight is not None and flight.gyro is None:
        yield f"{noise.rate_hz:.1f} Hz is too low to tell noise from motion in flight: more than 10 Hz are needed"
    for how in dict.fromkeys(one for one in (noise.sampling, noise.accel_sampling) if one.confirmed is False):
        yield f"the log says a low-pass of {how.corner_hz:g} Hz, but the spectrum at rest does not show that"
    if track.bias_removed:
        yield "the estimator's bias has been taken off these readings: B and K are of both together"
    for sensor in _SENSORS if rest else ():
        axes = getattr(rest, f"{sensor}_axes")
        hidden = [name for name, axis in zip(_AXES, axes, strict=True) if axis is not None and axis.hidden]
        if hidden:
            yield f"{sensor} {', '.join(hidden)} at rest: below quantisation, N is an upper bound"
    yield from _quiet_notes(noise, track)


def _quiet_notes(noise: ImuNoise, track: ImuTrack) -> Iterator[str]:
    """Axes that never change, or change less than any sensor does."""
    for sensor, values, step in (("gyro", track.gyro, track.gyro_step), ("accel", track.accel, track.accel_step)):
        least = healthy.TOO_QUIET * getattr(noise.imu_spec, sensor).noise_density * np.sqrt(noise.rate_hz)
        spread, why = values.std(axis=0), "less than its steps show, or stuck" if step else "stuck, no noise is told"
        for i in np.flatnonzero(spread < least):
            between = f"{values[:, i].min():.6g} to {values[:, i].max():.6g}" if spread[i] else f"{values[0, i]:.6g}"
            yield f"{sensor} {_AXES[i]} reads {between} throughout: {why}"


@dataclass(frozen=True, slots=True)
class ModelFigure:
    """A figure of an IMU model, u/√Hz or u/√s with u rad/s or m/s²."""

    value: float
    source: str  # where it is from, in words
    measured: bool  # in this flight; else the data sheet's


@dataclass(frozen=True, slots=True)
class SensorModel:
    """What Kalibr and the IMU library want to know of the noise of a sensor: of its worst axis."""

    white: ModelFigure  # N, u/√Hz
    walk: ModelFigure  # K, u/√s


def noise_model(noise: ImuNoise) -> tuple[SensorModel, SensorModel]:
    """Gyro and accelerometer. An upper bound replaces the data sheet's figure only where it is smaller than that."""
    return _sensor(noise, "gyro", noise.imu_spec.gyro), _sensor(noise, "accel", noise.imu_spec.accel)


def _sensor(noise: ImuNoise, sensor: Literal["gyro", "accel"], sheet: SensorSpec) -> SensorModel:
    axes = [axis for axis in getattr(noise.rest, f"{sensor}_axes", ()) if axis is not None]
    white = _worst([axis.white for axis in axes], sheet.noise_density, noise)
    walk = _worst([axis.walk for axis in axes if axis.walk is not None], sheet.bias_walk, noise)
    flying: WhiteNoise | None = getattr(noise.flight, sensor, None)
    if not axes and flying is not None and noise.flight is not None:
        seen = flying.sampled if flying.hidden.all() else flying.sampled[~flying.hidden]
        flown, (low, high) = f"spectrum of {noise.flight.duration_s:.0f} s in flight", flying.band_hz
        text = f"{flown} at {low:.0f} to {high:.0f} Hz, vibration included, worst axis"
        if (worst := float(np.max(seen))) >= healthy.TOO_QUIET * sheet.noise_density:  # else it is stuck
            white = ModelFigure(worst, text, measured=True)
    return SensorModel(white, walk)


def _worst(axes: list[Coefficient], sheet: float, noise: ImuNoise) -> ModelFigure:
    known = [axis for axis in axes if axis.value is not None]
    if noise.rest is not None and known:
        worst = max(known, key=lambda axis: axis.most)
        rested = f"Allan deviation of a rest of {noise.rest.duration_s:.0f} s at {noise.rate_hz:.1f} Hz"
        text = f"{rested}, worst axis, 95 %: {worst.low:.2g} to {worst.high:.2g}"
        return ModelFigure(worst.most, text, measured=True)
    bound = max((axis.high for axis in axes), default=np.inf)
    if bound < sheet:
        return ModelFigure(bound, "upper bound of a rest that is too short or too coarse to show more", measured=True)
    return ModelFigure(sheet, f"not seen in this flight: that of {noise.imu_spec.name}", measured=False)
