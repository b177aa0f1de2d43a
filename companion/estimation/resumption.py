"""Where the iteration begins on a link: with what was estimated a moment ago, carried on to what has arrived since."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from companion.estimation.iteration import Start
from companion.estimation.model import BestEstimate, corrected
from companion.estimation.setup import Setup
from companion.model import interpolated, nearest
from companion.strapdown import preintegrate


def resuming(starts: Iterable[Start], setup: Setup, before: BestEstimate) -> Iterator[Start]:
    """Where the iteration may begin: at an estimate whose flight goes on, and then where it would without it."""
    others = iter(starts)
    first = next(others)
    resumed = _resumed(setup, first, before)
    if resumed is not None:
        yield resumed
    yield first
    yield from others


def _resumed(setup: Setup, first: Start, before: BestEstimate) -> Start | None:
    """A start with attitudes, biases, constants and noise of an estimate; velocities and positions follow in one step.

    None where that estimate is of another IMU or another time, or had something to explain.
    """
    track, t = setup.imu, before.t
    seen = np.flatnonzero((t >= track.t[0]) & (t <= track.t[-1]))
    if before.imu.source != track.source or not len(seen) or before.explained or before.contradicted:
        return None
    k = seen[np.clip(np.searchsorted(t[seen], setup.t, side="right") - 1, 0, len(seen) - 1)]
    own, still = before.states, np.zeros((len(k), 3))
    path = preintegrate(corrected(track, before))
    q, _, _ = path.carry(nearest(track.t, t[k]), setup.index, own.q_ned_frd[k], still, still)
    holes = np.append(0, np.cumsum(setup.broken))
    carried = holes <= holes[np.searchsorted(setup.t, t[seen[-1]], side="right") - 1]  # without one since its end
    q = np.where(carried[:, None], q, first.states.q_ned_frd)
    gyro, accel = (interpolated(setup.t, t, bias) for bias in (own.gyro_bias, own.accel_bias))
    states = replace(first.states, q_ned_frd=q, gyro_bias=gyro, accel_bias=accel, constants=own.constants)
    return Start(states, before.noise, {**first.scale, **before.measurement_scale}, near=True)
