"""Where a vehicle stood still: what its IMU alone says about its tilt, its gyro bias and its noise.

An IMU cannot tell rest from even flight, and a simulated hover is quieter than a real bench. So the readings have to be
as quiet as this IMU gets, gravity has to be all that they feel, and what the autopilot knows must not speak against it:
a speed, or a height above the ground while armed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from companion.analysis.budget import persistent_step_error
from companion.analysis.finding import IntArray, run_edges
from companion.analysis.imu_spec import ImuSpec
from companion.analysis.reference import BoolArray, length
from companion.constants import check, harm, healthy
from companion.model import STANDARD_GRAVITY, Array, Flight, ImuTrack


@dataclass(frozen=True, slots=True, eq=False)
class Rest:
    """A stretch at rest."""

    first: int  # sample
    last: int  # sample
    start_s: float  # boot clock
    end_s: float
    gyro: Array  # (3,) mean reading, rad/s, FRD: the bias
    gyro_sigma: Array  # (3,) standard error of it as the bias
    accel: Array  # (3,) mean reading, m/s²
    gyro_noise: float | None  # rad/s/√Hz, worst axis; None where the readings' steps hide it
    accel_noise: float | None  # m/s²/√Hz

    @property
    def duration_s(self) -> float:
        """s"""
        return self.end_s - self.start_s


@dataclass(frozen=True, slots=True, eq=False)
class _Blocks:
    """The track in short pieces, end to end: B of them."""

    edges: IntArray  # (B+1,) samples
    t: Array  # (B+1,) s
    gyro: Array  # (B, 3) means
    accel: Array  # (B, 3)
    gyro_spread: Array  # (B,) standard deviation of the samples, worst axis
    accel_spread: Array  # (B,)
    size: int  # samples of each


def rests(flight: Flight, track: ImuTrack, imu: ImuSpec) -> tuple[Rest, ...]:
    """Every stretch of three seconds or more in which the vehicle stood still, in order of time."""
    blocks = _blocks(track)
    if blocks is None:
        return ()
    still = _quiet(blocks, track, imu) & _possible(flight, blocks)
    return tuple(_rest(track, blocks, imu, first, last) for first, last in _stretches(still, blocks, track))


def why_none(flight: Flight, track: ImuTrack, imu: ImuSpec) -> str:
    """What the quietest moment of a flight without rest was like, in words."""
    blocks = _blocks(track)
    if blocks is None:
        return f"{track.source} has {len(track)} samples in {track.t[-1] - track.t[0]:.1f} s"
    i = int(np.argmin(blocks.gyro_spread / np.median(blocks.gyro_spread + 1e-12) + length(blocks.gyro)))
    moment = (
        f"the quietest moment, at {blocks.t[i]:.1f} s, turns by {length(blocks.gyro[i]) * 1e3:.1f} mrad/s "
        f"(spread {blocks.gyro_spread[i] * 1e3:.1f}) and feels {length(blocks.accel[i]):.2f} m/s² "
        f"(spread {blocks.accel_spread[i]:.3f})"
    )
    quiet, possible = _quiet(blocks, track, imu), _possible(flight, blocks)
    if quiet.any() and not (quiet & possible).any():
        return moment + "; the vehicle was moving or in the air whenever its IMU was quiet"
    if (quiet & possible).any():
        return moment + f"; no quiet stretch lasts {check.REST_MIN_S:g} s"
    return moment


def _blocks(track: ImuTrack) -> _Blocks | None:
    size = max(check.REST_BLOCK_SAMPLES, round(check.REST_BLOCK_S * track.rate_hz))
    count = len(track) // size
    if count < 2:
        return None
    edges = np.arange(count + 1) * size
    part = slice(0, count * size)
    gyro, accel = (x[part].reshape(count, size, 3) for x in (track.gyro, track.accel))
    return _Blocks(
        edges=edges,
        t=track.t[np.minimum(edges, len(track) - 1)],
        gyro=gyro.mean(axis=1),
        accel=accel.mean(axis=1),
        gyro_spread=gyro.std(axis=1).max(axis=1),
        accel_spread=accel.std(axis=1).max(axis=1),
        size=size,
    )


def _quiet(blocks: _Blocks, track: ImuTrack, imu: ImuSpec) -> BoolArray:
    """Blocks in which the IMU is as quiet as it gets and feels gravity alone."""
    heavy = np.abs(length(blocks.accel) - STANDARD_GRAVITY)
    turning = length(blocks.gyro)
    possible = (heavy < imu.accel.offset + imu.accel.scale_tolerance * STANDARD_GRAVITY) & (
        turning < 2.0 * imu.gyro.offset
    )
    quiet = possible & (np.diff(blocks.t) < 2.0 * blocks.size / max(track.rate_hz, 1e-9))  # no gap in it
    for spread, step, sheet, most in (
        (blocks.gyro_spread, track.gyro_step, imu.gyro.noise_density, healthy.REST_SPREAD[0]),
        (blocks.accel_spread, track.accel_step, imu.accel.noise_density, healthy.REST_SPREAD[1]),
    ):
        floor = float(np.percentile(spread, check.REST_QUIETEST))
        # a reading at the edge of a step flickers by half a step; a data sheet's noise is nobody's fault
        quiet &= spread < min(most, max(healthy.REST_LOUDER * floor, 0.55 * step, sheet * np.sqrt(0.5 * track.rate_hz)))
    return np.asarray(quiet)


def _possible(flight: Flight, blocks: _Blocks) -> BoolArray:
    """Blocks in which nothing that the autopilot knows speaks against rest."""
    begin, end = blocks.t[:-1], blocks.t[1:]
    fine = np.ones(len(begin), np.bool_)
    motors, known = armed(flight, begin, end)
    position = flight.position
    if position is not None and len(position) > 1:
        inside = (begin >= position.t[0]) & (end <= position.t[-1])
        speed = np.interp(0.5 * (begin + end), position.t, length(position.velocity))
        # an estimator that starts up may think that it moves
        fine &= ~inside | (speed < healthy.REST_MPS) | (known & ~motors)
        down = np.interp(0.5 * (begin + end), position.t, position.position[:, 2])
        if np.ptp(position.position[:, 2]) > harm.FLOWN_M:
            ground = float(position.position[:, 2].max()) - healthy.GROUND_M
            fine &= ~inside | (down > ground) | (known & ~motors)
    if motors.any():  # motors off and motors on are not the same
        loud = float(np.percentile(blocks.gyro_spread, 75.0))
        fine &= ~motors | (blocks.gyro_spread * healthy.REST_CONTRAST < loud)
    return np.asarray(fine)


def armed(flight: Flight, begin: Array, end: Array) -> tuple[BoolArray, BoolArray]:
    """Whether the vehicle was armed in some of each block, and whether that is known."""
    was_armed = flight.armed(begin, end)
    if was_armed is None:
        return np.zeros(len(begin), np.bool_), np.full(len(begin), "HEARTBEAT" in flight.messages)
    return was_armed, np.ones(len(begin), np.bool_)


def _stretches(still: BoolArray, blocks: _Blocks, track: ImuTrack) -> Iterator[tuple[int, int]]:
    """First and last block of each rest: cut where the mean reading steps, as when a calibration is saved."""
    same = still[:-1] & still[1:]
    for mean, spread, step, little in (
        (blocks.gyro, blocks.gyro_spread, track.gyro_step, 5e-4),
        (blocks.accel, blocks.accel_spread, track.accel_step, 0.02),
    ):
        noise = 6.0 * np.maximum(spread[:-1], spread[1:]) / np.sqrt(blocks.size)
        same &= np.abs(np.diff(mean, axis=0)).max(axis=1) < noise + 1.1 * step + little
    first, last = run_edges(np.asarray(same))
    for i, j in zip(first.tolist(), (last + 1).tolist(), strict=True):
        if blocks.t[j + 1] - blocks.t[i] >= check.REST_MIN_S:
            yield i, j


def _rest(track: ImuTrack, blocks: _Blocks, imu: ImuSpec, first: int, last: int) -> Rest:
    part = slice(int(blocks.edges[first]), int(blocks.edges[last + 1]))
    gyro, accel = track.gyro[part], track.accel[part]
    span = float(track.t[part.stop - 1] - track.t[part.start])
    gyro_noise = _density(gyro, track.gyro_step, track.rate_hz)
    density = imu.gyro.noise_density if gyro_noise is None else gyro_noise
    return Rest(
        first=part.start,
        last=part.stop - 1,
        start_s=float(track.t[part.start]),
        end_s=float(track.t[part.stop - 1]),
        gyro=gyro.mean(axis=0),
        gyro_sigma=np.sqrt(density**2 / span + persistent_step_error(gyro, track.gyro_step) ** 2),
        accel=accel.mean(axis=0),
        gyro_noise=gyro_noise,
        accel_noise=_density(accel, track.accel_step, track.rate_hz),
    )


def _density(readings: Array, step: float, rate: float) -> float | None:
    """White-noise density of readings (N, 3) at rest, worst axis; None where their steps hide it.

    From neighbouring clusters (Allan's deviation times the root of the cluster's length), so that a filter that makes
    samples alike does not make the sensor look better. What the steps add is taken off.
    """
    if step and float(readings.std(axis=0).max()) < 0.3 * step:
        return None
    size = max(1, round(check.REST_CLUSTER_S * rate))
    count = len(readings) // size
    if count < 5:
        return None
    means = readings[: count * size].reshape(count, size, 3).mean(axis=1)
    variance = float((0.5 * np.diff(means, axis=0) ** 2).mean(axis=0).max()) * size / rate
    return float(np.sqrt(max(variance - step**2 / (12.0 * rate), 0.0))) or None
