"""The EKF's estimate (ekf.py) in place of the recorded one, or the recorded one moved by what a fault does to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.accuracy.cutting import at, attitude_at
from benchmarks.accuracy.ekf import ACCEL, GYRO, Estimate
from companion.model import AttitudeTrack, BiasTrack, Flight, PositionTrack
from companion.strapdown import preintegrate, quaternion


def replaced(flight: Flight, estimate: Estimate) -> Flight:
    """The flight with the filter's estimate in place of the recorded one, at the recorded times.

    Between its epochs the estimate follows the IMU less its biases, as the rates do. What the recorded estimator said
    of itself (variances, innovations, other cores' biases, resets) goes with it.
    """
    imu = flight.imu()
    attitude, position = flight.require_attitude(), flight.position
    assert position is not None
    begin, end = int(estimate.index[0]), int(estimate.index[-1])
    samples = np.arange(begin, end + 1)
    epoch = np.searchsorted(estimate.index, samples, side="right") - 1
    own = imu[begin : end + 1]
    corrected = replace(own, gyro=own.gyro - estimate.gyro_bias[epoch], accel=own.accel - estimate.accel_bias[epoch])
    path = preintegrate(corrected)
    q, v, p = path.carry(
        estimate.index[epoch] - begin,
        samples - begin,
        estimate.q_ned_frd[epoch],
        estimate.velocity[epoch],
        estimate.position[epoch],
    )
    q = quaternion.continuous_sign(q)
    ta, tp = (track.t[(track.t >= own.t[0]) & (track.t <= own.t[-1])] for track in (attitude, position))
    sigma = np.sqrt(np.diagonal(estimate.covariance, axis1=1, axis2=2))
    return replace(
        flight,
        attitude=AttitudeTrack(ta, attitude_at(ta, own.t, q), at(ta, own.t, corrected.gyro), attitude.source),
        position=PositionTrack(tp, at(tp, own.t, p), at(tp, own.t, v), position.source),
        biases=(
            BiasTrack(
                estimate.t,
                estimate.gyro_bias,
                estimate.accel_bias,
                sigma[:, GYRO],
                sigma[:, ACCEL],
                "EKF",
                0,
                imu.instance,
            ),
        ),
        resets=estimate.resets,
        series={n: s for n, s in flight.series.items() if n.split(":")[0] not in {"variance", "estimator"}},
    )


def shifted(wrong: Flight, flight: Flight, healthy: Flight, faulty: Flight) -> Flight:
    """The recorded estimate of `flight`, moved by what a fault does to the filter: from `healthy` to `faulty`.

    For IMUs that were logged too slowly to run a filter as good as the one on board. All at the recorded times.
    wrong: the flight with the fault and the recorded estimate.
    """
    attitude, position = flight.attitude, flight.position
    before, after, there, here = healthy.attitude, faulty.attitude, healthy.position, faulty.position
    assert attitude and position and before and after and there and here  # noqa: PT018
    first, last = (np.searchsorted(attitude.t, edge) for edge in (after.t[0], after.t[-1]))
    own = slice(int(first), int(last) + 1)
    turn = quaternion.multiply(after.q_ned_frd, quaternion.conjugate(before.q_ned_frd))
    q = quaternion.continuous_sign(quaternion.multiply(turn, attitude.q_ned_frd[own]))
    rates = attitude.rates[own] + after.rates - before.rates
    first, last = (np.searchsorted(position.t, edge) for edge in (here.t[0], here.t[-1]))
    along = slice(int(first), int(last) + 1)
    believed, known = faulty.biases[0], healthy.biases[0]
    recorded = next((b for b in flight.biases if b.imu_instance == known.imu_instance), None)
    extra = [np.zeros_like(known.gyro), np.zeros_like(known.accel)]
    if recorded is not None:
        extra = [at(believed.t, recorded.t, column) for column in (recorded.gyro, recorded.accel)]
        extra = [
            e - at(believed.t, known.t, column) for e, column in zip(extra, (known.gyro, known.accel), strict=True)
        ]
    return replace(
        faulty,
        imus=wrong.imus,
        attitude=AttitudeTrack(after.t, q, rates, attitude.source),
        position=PositionTrack(
            here.t,
            position.position[along] + here.position - there.position,
            position.velocity[along] + here.velocity - there.velocity,
            position.source,
        ),
        biases=(replace(believed, gyro=believed.gyro + extra[0], accel=believed.accel + extra[1]),),
    )
