"""How often calibration is right on simulated flights: `python benchmarks/accuracy/calibration.py`.

Random motion, a random sensor of config/imu whose biases, scale and misalignment are drawn from its figures, a random
lever arm, lag and board trim; half of the flights in whole milli-units, as RAW_IMU sends them. The autopilot has a tilt
and a heading error that last, and noise; GPS, compass and barometer have their own, for the best estimate. Right is an
observable figure within three of its standard errors.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from benchmarks.accuracy.parallel import Failed, each
from companion.app.sensors import imu_parts, load_imu_spec
from companion.comparison import PARTS, Correction, ImuSpec, ReferenceSpec, calibrate, compare, known_from
from companion.estimation import smooth
from companion.model import STANDARD_GRAVITY, Array, AttitudeTrack, Flight, ImuTrack, Origin, PositionTrack, Vehicle
from companion.strapdown import ImuModel, Motion, Sensor, motions, quaternion, simulate
from tests.estimation.sensed import EPOCH, PLACE, barometer_of, compass_of, gps_of

RATE_HZ, SECONDS = 100.0, 120.0
Random = np.random.Generator
AUTOPILOT = ReferenceSpec()


def motion(rng: Random) -> Motion:
    """A hover, a circle or a lively flight."""
    t = 20.0 + np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    kind = rng.integers(3)
    if kind == 0:
        return motions.rest(t)
    if kind == 1:
        return motions.circle(t, radius=rng.uniform(15, 80), speed=rng.uniform(3, 12), bank=rng.uniform(0.05, 0.5))
    return motions.coning(
        t,
        angle=rng.uniform(0.2, 0.6),
        frequency=rng.uniform(0.1, 0.5),
        amplitude=tuple(rng.uniform(1, 8, 3)),
        swing=tuple(rng.uniform(0.03, 0.15, 3)),
    )


def drawn(rng: Random, imu_spec: ImuSpec) -> Correction:
    """What is wrong with an IMU, as the correction that would put it right."""
    return Correction(
        gyro_bias=rng.normal(0, imu_spec.gyro.residual_bias, 3),
        accel_bias=rng.normal(0, imu_spec.accel.residual_bias, 3),
        mounting=rng.normal(0, 0.01, 3),
        time_offset=float(rng.uniform(0.0, 0.015)),
        gyro_scale=rng.normal(0, imu_spec.gyro.scale, 3),
        accel_scale=rng.normal(0, imu_spec.accel.scale, 3),
        gyro_misalignment=rng.normal(0, 0.5 * AUTOPILOT.misalignment, 6),
        accel_misalignment=rng.normal(0, 0.5 * AUTOPILOT.misalignment, 3),
        lever_arm=rng.normal(0, 0.1, 3),
    )


def flight(rng: Random) -> tuple[Flight, ImuSpec, Correction]:
    """A flight, the figures of its sensor, and the truth."""
    imu_spec = load_imu_spec(str(rng.choice(imu_parts())))
    wrong, true = drawn(rng, imu_spec), motion(rng)
    angular = np.gradient(true.gyro, true.t, axis=0, edge_order=2)
    felt = true.accel + np.cross(angular, wrong.lever_arm)
    felt += np.cross(true.gyro, np.cross(true.gyro, wrong.lever_arm))
    # the matrices that undo the errors, as columns: what the three axes become, biases aside
    axes = ImuTrack(np.arange(3.0), np.eye(3), np.eye(3))
    put_right = replace(wrong, gyro_bias=np.zeros(3), accel_bias=np.zeros(3), lever_arm=np.zeros(3)).apply(axes)
    coarse = bool(rng.integers(2))
    sensors = [
        Sensor(
            noise_density=figure.noise_density,
            bias=bias,
            matrix=np.asarray(np.linalg.inv(matrix.T), np.float64),
            step=step if coarse else 0.0,
        )
        for figure, bias, matrix, step in (
            (imu_spec.gyro, wrong.gyro_bias, put_right.gyro, 1e-3),
            (imu_spec.accel, wrong.accel_bias, put_right.accel, STANDARD_GRAVITY * 1e-3),
        )
    ]
    imu = simulate(ImuTrack(true.t + wrong.time_offset, true.gyro, felt), ImuModel(*sensors), rng)
    part = slice(None, None, 2)
    t, n = true.t[part], len(true.t[part])
    lean = quaternion.exp(rng.normal(0, [AUTOPILOT.tilt, AUTOPILOT.tilt, AUTOPILOT.heading]))
    shaking = quaternion.exp(rng.normal(0, 0.3 * AUTOPILOT.attitude_noise, (n, 3)))
    q = quaternion.multiply(quaternion.multiply(shaking, lean), true.q_ned_frd[part])
    place, speed = (rng.normal(0, 0.3 * sigma, (n, 3)) for sigma in (AUTOPILOT.position, AUTOPILOT.velocity))
    built = Flight(
        Vehicle(1, 1, "ARDUPILOTMEGA", "QUADROTOR"),
        boot=1,
        start=float(t[0]),
        duration=float(t[-1] - t[0]),
        imus={"RAW_IMU": replace(imu, source="RAW_IMU")},
        attitude=AttitudeTrack(t, quaternion.continuous_sign(q), true.gyro[part], "ATTITUDE"),
        position=PositionTrack(t, true.position[part] + place, true.velocity[part] + speed, "LOCAL_POSITION_NED"),
        origin=Origin(*PLACE),
        epoch=EPOCH,
        gps=(gps_of(true, rng, PLACE),),
        compasses=(compass_of(true, rng, PLACE),),
        barometers=(barometer_of(true, rng),),
    )
    return built, imu_spec, wrong


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("--workers", type=int, help="processes, default: one for each processor")
    arguments = parser.parse_args()
    print("By the windows and the best estimate:")
    every = each(judged, range(arguments.flights), workers=arguments.workers)
    results = [one for _, one in every if not isinstance(one, Failed)]
    _table([both for both, _ in results])
    print("By the windows alone:")
    _table([alone for _, alone in results])
    if failed := arguments.flights - len(results):
        print(f"{failed} flights failed")


def judged(seed: int) -> tuple[tuple[Array, tuple[bool, ...]], tuple[Array, tuple[bool, ...]]]:
    """Errors of the figures in standard errors, and which are told: with the best estimate, and without."""
    built, imu_spec, wrong = flight(np.random.default_rng(seed))
    own = compare(built)
    known = known_from(smooth(built).errors, imu_spec, own.track)
    found = [calibrate(own, imu_spec, AUTOPILOT, known=one) for one in (known, None)]
    both, alone = (((one.values - wrong.values) / one.sigma, one.observable) for one in found if one)
    return both, alone


def _table(rows: list[tuple[Array, tuple[bool, ...]]]) -> None:
    z, told = (np.array(column) for column in zip(*rows, strict=True))
    print(f"{'':22}{'observable':>12}{'within 3 σ':>12}{'rms, σ':>9}{'worst, σ':>10}")
    for part, place in PARTS.items():
        some = np.abs(z[:, place][told[:, place]])
        share = told[:, place].mean()
        row = f"{(some < 3).mean():>11.1%}{np.sqrt((some**2).mean()):>9.2f}{some.max():>10.1f}" if len(some) else ""
        print(f"{part:22}{share:>11.0%} {row}")


if __name__ == "__main__":
    main()
