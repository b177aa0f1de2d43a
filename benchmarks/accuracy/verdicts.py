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
import numpy.typing as npt

from benchmarks.accuracy.parallel import Failed, each
from companion.app.sensors import imu_parts, load_imu_spec
from companion.comparison import ImuSpec
from companion.model import (
    STANDARD_GRAVITY,
    Array,
    AttitudeTrack,
    Flight,
    ImuTrack,
    Origin,
    PositionTrack,
    Vehicle,
)
from companion.strapdown import ImuModel, Motion, Sensor, motions, quaternion, simulate
from companion.verdict import assess
from tests.estimation.sensed import EPOCH, PLACE, barometer_of, compass_of, gps_of

RATE_HZ, SECONDS = 100.0, 80.0
Random = np.random.Generator


@dataclass(frozen=True)
class Fault:
    """What is done to a flight, and what has to be said of it."""

    name: str
    status: str
    kinds: tuple[str, ...]
    spoil: Callable[[Flight, ImuSpec, Random], tuple[Flight, float, float]]  # the flight, and when it is wrong
    lively: bool = False  # needs a vehicle that turns: a stuck axis of one that does not reads the truth
    fly: Callable[[Array, Random], Motion] | None = None  # a motion of its own


def motion(t: Array, rng: Random, *, lively: bool) -> Motion:
    """Some way to fly for a while; a lively one turns about every axis all the time."""
    if not lively and rng.uniform() < 0.5:
        return motions.circle(t, radius=rng.uniform(15, 80), speed=rng.uniform(3, 12), bank=rng.uniform(0.05, 0.5))
    return motions.coning(
        t,
        angle=rng.uniform(0.2 if lively else 0.05, 0.4),
        frequency=rng.uniform(0.2 if lively else 0.05, 0.5),
        amplitude=tuple(rng.uniform(1, 8, 3)),
        swing=tuple(rng.uniform(0.03, 0.15, 3)),
    )


def flight(rng: Random, fault: Fault, rate_hz: float = RATE_HZ) -> tuple[Flight, ImuSpec]:
    """A flight without fault, and the figures of its sensor."""
    imu_spec = load_imu_spec(str(rng.choice(imu_parts())))
    t = 20.0 + np.arange(round(SECONDS * rate_hz)) / rate_hz
    true = fault.fly(t, rng) if fault.fly else motion(t, rng, lively=fault.lively)
    model = ImuModel(
        gyro=_sensor(imu_spec.gyro.noise_density, imu_spec.gyro.residual_bias, imu_spec.gyro.scale, 1e-3, rng),
        accel=_sensor(
            imu_spec.accel.noise_density,
            imu_spec.accel.residual_bias,
            imu_spec.accel.scale,
            STANDARD_GRAVITY * 1e-3,
            rng,
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
        origin=Origin(*PLACE),
        epoch=EPOCH,
        gps=(gps_of(true, rng, PLACE),),
        compasses=(compass_of(true, rng, PLACE),),
        barometers=(barometer_of(true, rng),),
    )
    return built, imu_spec


def _sensor(noise: float, bias: float, scale: float, step: float, rng: Random) -> Sensor:
    return Sensor(
        noise_density=noise,
        bias=rng.normal(0, bias, 3),
        matrix=np.eye(3) + np.diag(rng.normal(0, scale, 3)),
        step=step,
    )


def none(f: Flight, imu_spec: ImuSpec, rng: Random) -> tuple[Flight, float, float]:
    del imu_spec, rng
    return f, f.start, f.start + f.duration


def gyro_bias(f: Flight, imu_spec: ImuSpec, rng: Random) -> tuple[Flight, float, float]:
    """17.5 mrad/s, twice what calibration leaves at most, about a random axis, from somewhere on."""
    del imu_spec
    begin = rng.uniform(25, 70)
    direction = rng.normal(size=3)
    bias = 0.0175 * direction / np.linalg.norm(direction)
    return _changed(f, gyro=lambda imu: imu.gyro + bias * (imu.t >= begin)[:, None]), begin, f.start + f.duration


def stuck_axis(f: Flight, imu_spec: ImuSpec, rng: Random) -> tuple[Flight, float, float]:
    """One gyro axis holds its reading for two seconds."""
    del imu_spec
    begin, axis = rng.uniform(25, 90), int(rng.integers(2))  # a coning motion turns evenly about its third axis

    def held(imu: ImuTrack) -> Array:
        readings = imu.gyro.copy()
        inside = (imu.t >= begin) & (imu.t < begin + 2)
        readings[inside, axis] = readings[np.argmax(inside), axis]
        return readings

    return _changed(f, gyro=held), begin, begin + 2


def clipping(f: Flight, imu_spec: ImuSpec, rng: Random) -> tuple[Flight, float, float]:
    """Shocks beyond the accelerometer's range for a tenth of a second."""
    begin, full = rng.uniform(25, 90), imu_spec.accel.full_scale

    def shaken(imu: ImuTrack) -> Array:
        shock = rng.normal(0, 3 * full, imu.accel.shape) * ((imu.t >= begin) & (imu.t < begin + 0.1))[:, None]
        return np.clip(imu.accel + shock, -full, full)

    return _changed(f, accel=shaken), begin, begin + 0.1


def gps_glitch(f: Flight, imu_spec: ImuSpec, rng: Random) -> tuple[Flight, float, float]:
    """The position is 10 m off for a while."""
    del imu_spec
    begin, angle = rng.uniform(25, 70), rng.uniform(0, 2 * np.pi)
    end = begin + rng.uniform(5, 20)
    assert f.position
    inside = ((f.position.t >= begin) & (f.position.t < end))[:, None]
    moved = f.position.position + inside * [10 * np.cos(angle), 10 * np.sin(angle), 0]
    return replace(f, position=replace(f.position, position=moved)), begin, end


def yaw_reset(f: Flight, imu_spec: ImuSpec, rng: Random) -> tuple[Flight, float, float]:
    """The heading steps by 15° and stays there."""
    del imu_spec
    begin = rng.uniform(30, 90)
    assert f.attitude
    q, after = f.attitude.q_ned_frd.copy(), f.attitude.t >= begin
    q[after] = quaternion.multiply(quaternion.exp(np.array([0, 0, np.radians(15)])), q[after])
    return replace(f, attitude=replace(f.attitude, q_ned_frd=q)), begin, begin


def orientation(f: Flight, imu_spec: ImuSpec, rng: Random) -> tuple[Flight, float, float]:
    """The board is turned by 90° about a random axis."""
    del imu_spec
    axis = int(rng.integers(3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[[i, j]] = np.eye(3)[[j, i]] * [[1], [-1]]
    spoilt = _changed(f, gyro=lambda imu: imu.gyro @ turn.T, accel=lambda imu: imu.accel @ turn.T)
    return spoilt, f.start, f.start + f.duration


def askew(f: Flight, imu_spec: ImuSpec, rng: Random) -> tuple[Flight, float, float]:
    """The board is turned by 45° about down, as AHRS_ORIENTATION 1 is."""
    del imu_spec, rng
    turn = quaternion.to_matrix(quaternion.exp(np.array([0, 0, np.radians(45)])))
    spoilt = _changed(f, gyro=lambda imu: imu.gyro @ turn.T, accel=lambda imu: imu.accel @ turn.T)
    return spoilt, f.start, f.start + f.duration


def clocks(f: Flight, imu_spec: ImuSpec, rng: Random) -> tuple[Flight, float, float]:
    """The IMU's clock runs 0.5 % fast, and so 0.4 s away by the end."""
    del imu_spec, rng
    imu = f.imus["RAW_IMU"]
    return replace(f, imus={"RAW_IMU": replace(imu, t=f.start + (imu.t - f.start) * 1.005)}), f.start, f.start + SECONDS


def attitude_drift(f: Flight, imu_spec: ImuSpec, rng: Random) -> tuple[Flight, float, float]:
    """The autopilot's attitude turns away at 1°/s about some axis of the world, and stays there."""
    del imu_spec
    begin, axis = rng.uniform(25, 70), rng.normal(size=3)
    assert f.attitude
    lasted = np.clip(f.attitude.t - begin, 0, 15)[:, None]
    return _turned(f, np.radians(1.0) * axis / np.linalg.norm(axis) * lasted), begin, begin + 15


def heading_drift(f: Flight, imu_spec: ImuSpec, rng: Random) -> tuple[Flight, float, float]:
    """The heading turns away at 1°/s."""
    del imu_spec
    begin = rng.uniform(25, 70)
    assert f.attitude
    lasted = np.clip(f.attitude.t - begin, 0, 15)[:, None]
    return _turned(f, np.radians(1.0) * np.array([0, 0, 1.0]) * lasted), begin, begin + 15


def heading_off(f: Flight, imu_spec: ImuSpec, rng: Random) -> tuple[Flight, float, float]:
    """The heading is 25° off throughout."""
    del imu_spec
    turn = np.radians(25) * rng.choice([-1, 1])
    return _turned(f, np.array([0, 0, turn])), f.start, f.start + f.duration


def position_creep(f: Flight, imu_spec: ImuSpec, rng: Random) -> tuple[Flight, float, float]:
    """The position moves by 1.5 m/s for 15 s, and the velocity does not know."""
    del imu_spec
    begin, angle = rng.uniform(25, 70), rng.uniform(0, 2 * np.pi)
    assert f.position
    lasted = np.clip(f.position.t - begin, 0, 15)[:, None]
    moved = f.position.position + 1.5 * lasted * [np.cos(angle), np.sin(angle), 0]
    return replace(f, position=replace(f.position, position=moved)), begin, begin + 15


def trim(f: Flight, imu_spec: ImuSpec, rng: Random) -> tuple[Flight, float, float]:
    """A board trim of 2 to 6° that the log does not name."""
    del imu_spec
    angle, about = np.radians(rng.uniform(2, 6)), rng.uniform(0, 2 * np.pi)
    turn = quaternion.to_matrix(quaternion.exp(angle * np.array([np.cos(about), np.sin(about), 0])))
    spoilt = _changed(f, gyro=lambda imu: imu.gyro @ turn.T, accel=lambda imu: imu.accel @ turn.T)
    return spoilt, f.start, f.start + f.duration


def lever_arm(f: Flight, imu_spec: ImuSpec, rng: Random) -> tuple[Flight, float, float]:
    """The IMU sits 0.4 m off the body's origin."""
    del imu_spec
    arm = rng.normal(size=3)
    arm *= 0.4 / np.linalg.norm(arm)

    def felt(imu: ImuTrack) -> Array:
        turning = np.gradient(f.imus["RAW_IMU"].gyro, imu.t, axis=0)
        smooth = np.stack([np.convolve(column, np.ones(9) / 9, "same") for column in turning.T], axis=1)
        return np.asarray(imu.accel + np.cross(smooth, arm) + np.cross(imu.gyro, np.cross(imu.gyro, arm)))

    return _changed(f, accel=felt), f.start, f.start + f.duration


def vibration(f: Flight, imu_spec: ImuSpec, rng: Random) -> tuple[Flight, float, float]:
    """Motors shake the IMU by 20 to 60 m/s² and 0.5 rad/s at 60 to 250 Hz: a 20 Hz filter leaves some, which folds."""
    del imu_spec
    t = f.imus["RAW_IMU"].t
    frequency = rng.uniform(60, 250)
    left = (20 / frequency) ** 2
    wander = np.cumsum(rng.normal(0, 1, len(t))) * 0.3
    phase = 2 * np.pi * (frequency * t + np.cumsum(wander) / RATE_HZ)
    shake = left * np.sin(phase[:, None] + rng.uniform(0, 2 * np.pi, 3))
    size = rng.uniform(20, 60)
    spoilt = _changed(f, gyro=lambda imu: imu.gyro + 0.5 * shake, accel=lambda imu: imu.accel + size * shake)
    return spoilt, f.start, f.start + f.duration


def radio(f: Flight, imu_spec: ImuSpec, rng: Random) -> tuple[Flight, float, float]:
    """A radio loses 30 % of the packets in bursts of 0.05 to 0.55 s."""
    del imu_spec

    def heard(t: Array) -> npt.NDArray[np.bool_]:
        return np.asarray(np.interp(t, times, lost) < 0.5)

    times = np.arange(f.start, f.start + f.duration + 1, 0.01)
    lost, at = np.zeros(len(times)), 0
    while at < len(times):
        good, bad = rng.exponential(0.7), rng.uniform(0.05, 0.55)
        at += round(good * 100)
        lost[at : at + round(bad * 100)] = 1
        at += round(bad * 100)
    imu, attitude, position = f.imus["RAW_IMU"], f.attitude, f.position
    assert attitude
    assert position
    i, a, p = heard(imu.t), heard(attitude.t), heard(position.t)
    spoilt = replace(
        f,
        imus={"RAW_IMU": replace(imu, t=imu.t[i], gyro=imu.gyro[i], accel=imu.accel[i])},
        attitude=replace(attitude, t=attitude.t[a], q_ned_frd=attitude.q_ned_frd[a], rates=attitude.rates[a]),
        position=replace(position, t=position.t[p], position=position.position[p], velocity=position.velocity[p]),
    )
    return spoilt, f.start, f.start + f.duration


def plane(t: Array, rng: Random) -> Motion:
    """Coordinated circles at constant speed."""
    radius, speed = rng.uniform(60, 200), rng.uniform(12, 28)
    bank = float(np.arctan(speed**2 / (radius * STANDARD_GRAVITY)))
    return motions.circle(t, radius=radius, speed=speed, bank=bank, heave=rng.uniform(0, 1), frequency=0.1)


def rover(t: Array, rng: Random) -> Motion:
    """Flat circles."""
    return motions.circle(t, radius=rng.uniform(4, 20), speed=rng.uniform(0.5, 4), bank=0.0, heave=0.02, frequency=1.0)


FAULTS = (
    Fault("none", "consistent", (), none),
    Fault("gyro bias of 17.5 mrad/s", "imu_suspect", ("gyro_bias",), gyro_bias),
    Fault("stuck gyro axis, 2 s", "imu_suspect", ("stuck_axis",), stuck_axis, lively=True),
    Fault("accelerometer clipping, 0.1 s", "imu_suspect", ("accel_clipping",), clipping),
    Fault("GPS glitch of 10 m", "autopilot_suspect", ("position_jump",), gps_glitch),
    Fault("yaw reset of 15°", "autopilot_suspect", ("heading_jump",), yaw_reset),
    Fault("board turned by 90°", "imu_suspect", ("axes_wrong",), orientation),
    Fault("board turned by 45°", "imu_suspect", ("axes_wrong",), askew, lively=True),
    Fault("clock 0.5 % fast", "insufficient_data", ("clocks_diverge",), clocks, lively=True),
    Fault("attitude drifts at 1°/s, 15 s", "autopilot_suspect", ("tilt_off", "heading_off"), attitude_drift),
    Fault("heading drifts at 1°/s, 15 s", "autopilot_suspect", ("heading_off",), heading_drift),
    Fault("heading 25° off", "autopilot_suspect", ("heading_off",), heading_off, lively=True),
    Fault("position creeps at 1.5 m/s, 15 s", "autopilot_suspect", ("position_off",), position_creep),
    Fault("board trim of 2 to 6°, not named", "consistent", ("mounting",), trim),
    Fault("IMU 0.4 m off the origin", "consistent", (), lever_arm),
    Fault("vibration", "consistent", (), vibration),
    Fault("radio loses 30 % in bursts", "insufficient_data", ("samples_missing",), radio),
    Fault("plane in coordinated circles", "consistent", (), none, fly=plane),
    Fault("rover in circles", "consistent", (), none, fly=rover),
)

ROWS = (
    *((fault, RATE_HZ) for fault in FAULTS),
    (Fault("IMU at 4 Hz", "insufficient_data", ("rate_too_low",), none), 4.0),
)
"""Every fault, and the rate of the IMU that flies it, Hz."""


def _turned(f: Flight, turn: Array) -> Flight:
    """The autopilot's attitude turned by rotation vectors in NED, its own rates as they were."""
    assert f.attitude
    q = quaternion.multiply(quaternion.exp(turn), f.attitude.q_ned_frd)
    return replace(f, attitude=replace(f.attitude, q_ned_frd=q))


def _changed(
    f: Flight, *, gyro: Callable[[ImuTrack], Array] | None = None, accel: Callable[[ImuTrack], Array] | None = None
) -> Flight:
    imu = f.imus["RAW_IMU"]
    new = replace(imu, gyro=gyro(imu) if gyro else imu.gyro, accel=accel(imu) if accel else imu.accel)
    return replace(f, imus={"RAW_IMU": new})


def judged(fault: Fault, seed: int, rate_hz: float = RATE_HZ, *, show: bool = False) -> tuple[bool, bool, str]:
    """Whether the status, and the kind with its interval, are right; and the status with its first finding."""
    rng = np.random.default_rng(seed)
    built, imu_spec = flight(rng, fault, rate_hz)
    built, begin, end = fault.spoil(built, imu_spec, rng)
    verdict = assess(built, imu_spec).verdict
    right = not fault.kinds or any(
        f.kind in fault.kinds and f.start_s <= end + 2 and f.end_s >= begin - 2 for f in verdict.findings
    )
    said = verdict.findings[0].kind if verdict.findings else ""
    if show and not (right and verdict.status == fault.status):
        print(f"seed {seed}, {imu_spec.name}, {begin:.1f} to {end:.1f} s: {verdict.summary}")
        for f in verdict.findings:
            print(f"    {f.severity} {f.kind} {f.start_s:.1f} to {f.end_s:.1f} s: {f.evidence}")
    return verdict.status == fault.status, right, f"{verdict.status} {said}"


_TOGETHER = 20  # flights in one process


def _some(case: tuple[str, range, bool]) -> list[tuple[bool, bool, str]]:
    """Some flights of a row: its name, their seeds, and whether what is judged wrongly is shown."""
    name, seeds, show = case
    fault, rate_hz = next(row for row in ROWS if row[0].name == name)
    return [judged(fault, seed, rate_hz, show=show) for seed in seeds]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("--only", default="", help="faults whose name has this in it")
    parser.add_argument("--show", action="store_true", help="the findings of each flight that is judged wrongly")
    parser.add_argument("--workers", type=int, help="processes, default: one for each processor")
    arguments = parser.parse_args()
    flights = arguments.flights
    print(f"{'fault':32}{'status right':>14}{'kind and time':>15}   what else was said")
    rows = [fault for fault, _ in ROWS if arguments.only in fault.name]
    parts = [range(first, min(first + _TOGETHER, flights)) for first in range(0, flights, _TOGETHER)]
    todo = [(fault.name, part, arguments.show) for fault in rows for part in parts]
    told: dict[str, list[tuple[bool, bool, str]]] = {fault.name: [] for fault in rows}
    for index, result in each(_some, todo, workers=arguments.workers, timeout=1200.0):
        name, seeds, _ = todo[index]
        results = told[name]
        results += [(False, False, result.reason)] * len(seeds) if isinstance(result, Failed) else result
        if len(results) < flights:
            continue
        wrong = [said for status, kind, said in results if not (status and kind)]
        most = ", ".join(f"{said} ({wrong.count(said)})" for said in sorted(set(wrong), key=wrong.count)[::-1][:3])
        status, kind = (np.mean([r[i] for r in results]) for i in (0, 1))
        print(f"{name:32}{status:>13.1%}{kind:>15.1%}   {most}", flush=True)


if __name__ == "__main__":
    main()
