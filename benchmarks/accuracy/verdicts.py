"""How often the verdict is right on simulated flights whose fault is known: `python benchmarks/accuracy/verdicts.py`.

Random motion, a random sensor of config/imu with errors drawn from its figures, RAW_IMU's whole milli-units, an
autopilot with small errors of its own; then one fault, or none. Right means the right status, a finding of the right
kind, and an interval that overlaps the true one.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from companion.analysis import ImuFigures, assess
from companion.sensors import imu_parts, load_imu_figures
from companion.strapdown import ImuModel, Motion, Sensor, motions, quaternion, simulate
from companion.tracks import (
    STANDARD_GRAVITY,
    Array,
    AttitudeTrack,
    Flight,
    ImuTrack,
    PositionTrack,
    Vehicle,
)

RATE_HZ, SECONDS = 100.0, 80.0
Random = np.random.Generator


@dataclass(frozen=True)
class Fault:
    """What is done to a flight, and what has to be said of it."""

    name: str
    status: str
    kinds: tuple[str, ...]
    spoil: Callable[[Flight, ImuFigures, Random], tuple[Flight, float, float]]  # the flight, and when it is wrong
    lively: bool = False  # needs a vehicle that turns: a stuck axis of one that does not reads the truth


def motion(rng: Random, rate_hz: float, *, lively: bool) -> Motion:
    """Some way to fly for a while; a lively one turns about every axis all the time."""
    t = 20.0 + np.arange(round(SECONDS * rate_hz)) / rate_hz
    if not lively and rng.uniform() < 0.5:
        return motions.circle(t, radius=rng.uniform(15, 80), speed=rng.uniform(3, 12), bank=rng.uniform(0.05, 0.5))
    return motions.coning(
        t,
        angle=rng.uniform(0.2 if lively else 0.05, 0.4),
        frequency=rng.uniform(0.2 if lively else 0.05, 0.5),
        amplitude=tuple(rng.uniform(1, 8, 3)),
        swing=tuple(rng.uniform(0.03, 0.15, 3)),
    )


def flight(rng: Random, rate_hz: float = RATE_HZ, *, lively: bool = False) -> tuple[Flight, ImuFigures]:
    """A flight without fault, and the figures of its sensor."""
    figures = load_imu_figures(str(rng.choice(imu_parts())))
    true = motion(rng, rate_hz, lively=lively)
    model = ImuModel(
        gyro=_sensor(figures.gyro.noise_density, figures.gyro.residual_bias, figures.gyro.scale, 1e-3, rng),
        accel=_sensor(
            figures.accel.noise_density, figures.accel.residual_bias, figures.accel.scale, STANDARD_GRAVITY * 1e-3, rng
        ),
    )
    imu = replace(simulate(true.imu, model, rng), source="RAW_IMU")
    every = max(1, round(rate_hz / 25))
    part = slice(None, None, every)
    t, n = true.t[part], len(true.t[part])
    lean = quaternion.exp(np.append(rng.normal(0, 0.003, 2), rng.normal(0, 0.02)))
    q = quaternion.multiply(
        quaternion.multiply(quaternion.exp(rng.normal(0, 5e-4, (n, 3))), lean), true.q_ned_frd[part]
    )
    built = Flight(
        Vehicle(1, 1, "ARDUPILOTMEGA", "QUADROTOR"),
        boot=1,
        start=float(t[0]),
        duration=float(t[-1] - t[0]),
        imus={"RAW_IMU": imu},
        attitude=AttitudeTrack(t, quaternion.continuous_sign(q), true.gyro[part], "ATTITUDE"),
        position=PositionTrack(
            t,
            true.position[part] + rng.normal(0, 0.02, (n, 3)),
            true.velocity[part] + rng.normal(0, 0.02, (n, 3)),
            "LOCAL_POSITION_NED",
        ),
    )
    return built, figures


def _sensor(noise: float, bias: float, scale: float, step: float, rng: Random) -> Sensor:
    return Sensor(
        noise_density=noise,
        bias=rng.normal(0, bias, 3),
        matrix=np.eye(3) + np.diag(rng.normal(0, scale, 3)),
        step=step,
    )


def none(f: Flight, figures: ImuFigures, rng: Random) -> tuple[Flight, float, float]:
    del figures, rng
    return f, f.start, f.start + f.duration


def gyro_bias(f: Flight, figures: ImuFigures, rng: Random) -> tuple[Flight, float, float]:
    """Ten times the turn-on bias that calibration leaves, about a random axis, from somewhere on."""
    begin = rng.uniform(25, 70)
    direction = rng.normal(size=3)
    bias = 10 * figures.gyro.residual_bias * direction / np.linalg.norm(direction)
    return _changed(f, gyro=lambda imu: imu.gyro + bias * (imu.t >= begin)[:, None]), begin, f.start + f.duration


def stuck_axis(f: Flight, figures: ImuFigures, rng: Random) -> tuple[Flight, float, float]:
    """One gyro axis holds its reading for two seconds."""
    del figures
    begin, axis = rng.uniform(25, 90), int(rng.integers(2))  # a coning motion turns evenly about its third axis

    def held(imu: ImuTrack) -> Array:
        readings = imu.gyro.copy()
        inside = (imu.t >= begin) & (imu.t < begin + 2)
        readings[inside, axis] = readings[np.argmax(inside), axis]
        return readings

    return _changed(f, gyro=held), begin, begin + 2


def clipping(f: Flight, figures: ImuFigures, rng: Random) -> tuple[Flight, float, float]:
    """Shocks beyond the accelerometer's range for a tenth of a second."""
    begin, full = rng.uniform(25, 90), figures.accel.full_scale

    def shaken(imu: ImuTrack) -> Array:
        shock = rng.normal(0, 3 * full, imu.accel.shape) * ((imu.t >= begin) & (imu.t < begin + 0.1))[:, None]
        return np.clip(imu.accel + shock, -full, full)

    return _changed(f, accel=shaken), begin, begin + 0.1


def gps_glitch(f: Flight, figures: ImuFigures, rng: Random) -> tuple[Flight, float, float]:
    """The position is 10 m off for a while."""
    del figures
    begin, angle = rng.uniform(25, 70), rng.uniform(0, 2 * np.pi)
    end = begin + rng.uniform(5, 20)
    assert f.position
    inside = ((f.position.t >= begin) & (f.position.t < end))[:, None]
    moved = f.position.position + inside * [10 * np.cos(angle), 10 * np.sin(angle), 0]
    return replace(f, position=replace(f.position, position=moved)), begin, end


def yaw_reset(f: Flight, figures: ImuFigures, rng: Random) -> tuple[Flight, float, float]:
    """The heading steps by 15° and stays there."""
    del figures
    begin = rng.uniform(30, 90)
    assert f.attitude
    q, after = f.attitude.q_ned_frd.copy(), f.attitude.t >= begin
    q[after] = quaternion.multiply(quaternion.exp(np.array([0, 0, np.radians(15)])), q[after])
    return replace(f, attitude=replace(f.attitude, q_ned_frd=q)), begin, begin


def orientation(f: Flight, figures: ImuFigures, rng: Random) -> tuple[Flight, float, float]:
    """The board is turned by 90° about a random axis."""
    del figures
    axis = int(rng.integers(3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[[i, j]] = np.eye(3)[[j, i]] * [[1], [-1]]
    spoilt = _changed(f, gyro=lambda imu: imu.gyro @ turn.T, accel=lambda imu: imu.accel @ turn.T)
    return spoilt, f.start, f.start + f.duration


FAULTS = (
    Fault("none", "consistent", (), none),
    Fault("gyro bias, 10 x residual", "imu_suspect", ("gyro_bias",), gyro_bias),
    Fault("stuck gyro axis, 2 s", "imu_suspect", ("stuck_axis",), stuck_axis, lively=True),
    Fault("accelerometer clipping, 0.1 s", "imu_suspect", ("accel_clipping",), clipping),
    Fault("GPS glitch of 10 m", "autopilot_suspect", ("position_jump",), gps_glitch),
    Fault("yaw reset of 15°", "autopilot_suspect", ("heading_jump",), yaw_reset),
    Fault("board turned by 90°", "imu_suspect", ("axes_wrong",), orientation),
)


def _changed(
    f: Flight, *, gyro: Callable[[ImuTrack], Array] | None = None, accel: Callable[[ImuTrack], Array] | None = None
) -> Flight:
    imu = f.imus["RAW_IMU"]
    new = replace(imu, gyro=gyro(imu) if gyro else imu.gyro, accel=accel(imu) if accel else imu.accel)
    return replace(f, imus={"RAW_IMU": new})


def judged(fault: Fault, seed: int, rate_hz: float = RATE_HZ) -> tuple[bool, bool, str]:
    """Whether the status, and the kind with its interval, are right; and the status with its first finding."""
    rng = np.random.default_rng(seed)
    built, figures = flight(rng, rate_hz, lively=fault.lively)
    built, begin, end = fault.spoil(built, figures, rng)
    verdict = assess(built, figures).verdict
    right = not fault.kinds or any(
        f.kind in fault.kinds and f.start_s <= end + 2 and f.end_s >= begin - 2 for f in verdict.findings
    )
    said = verdict.findings[0].kind if verdict.findings else ""
    return verdict.status == fault.status, right, f"{verdict.status} {said}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=200)
    flights = parser.parse_args().flights
    slow = Fault("IMU at 4 Hz", "insufficient_data", ("rate_too_low",), none)
    print(f"{'fault':32}{'status right':>14}{'kind and time':>15}   what else was said")
    for fault, rate in [*((f, RATE_HZ) for f in FAULTS), (slow, 4.0)]:
        results = [judged(fault, seed, rate) for seed in range(flights)]
        wrong = [said for status, kind, said in results if not (status and kind)]
        most = ", ".join(f"{said} ({wrong.count(said)})" for said in sorted(set(wrong), key=wrong.count)[::-1][:3])
        status, kind = (np.mean([r[i] for r in results]) for i in (0, 1))
        print(f"{fault.name:32}{status:>13.1%}{kind:>15.1%}   {most}")


if __name__ == "__main__":
    main()
