"""An accelerometer that reads another gravity at rest after a flight than before it.

In flight without GPS nothing tells an error of it from a motion. At rest gravity alone does: its length stays.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from companion.comparison import length, phases, window
from companion.constants import check, healthy, num, priors
from companion.estimation import BestEstimate, at_rest, change_probability, hypothesis_of
from companion.model import Array, Flight, ImuTrack
from companion.verdict.fault_interval import percent
from companion.verdict.finding import Cause, Finding

_KIND = hypothesis_of("accel_bias")


def changed_at_rest(flight: Flight, best: BestEstimate | None, faults: Sequence[Finding]) -> Iterator[Finding]:
    """Every IMU whose accelerometer changed over a flight between two rests, where the best estimate had no GPS.

    faults: of `reading_faults`; what is stuck or cut off reads no gravity.
    """
    if any(f.severity == "error" for f in faults) or (best is not None and "gps_position" in best.residuals):
        return
    flown = [part for part in phases(flight) if part.kind == "flight"]
    grounded = [-np.inf, *(edge for part in flown for edge in (part.start, part.end)), np.inf]
    for track in flight.each_imu(num.REST_READ_MIN_SAMPLES):
        t = np.arange(track.t[0], track.t[-1], check.REST_BLOCK_S)
        still = t[at_rest(flight, track, t)[2]]
        rests = [window(still, begin, end) for begin, end in zip(grounded[::2], grounded[1::2], strict=True)]
        most = round(num.REST_READ_MAX_S / check.REST_BLOCK_S)
        for part, before, after in zip(flown, rests, rests[1:], strict=False):
            read = [_gravity(track, still[before][-most:]), _gravity(track, still[after][:most])]
            if len(read[0]) * check.REST_BLOCK_S >= check.REST_MIN_S <= len(read[1]) * check.REST_BLOCK_S:
                yield from _changed(track, part.start, part.end, *read)


def _gravity(track: ImuTrack, t: Array) -> Array:
    """(M, 3) the mean specific force about times (M,), m/s², FRD."""
    begin, end = (np.searchsorted(track.t, t + apart * check.REST_BLOCK_S) for apart in (-0.5, 0.5))
    each = (track.accel[first:last] for first, last in zip(begin, end, strict=True) if last > first)
    return np.array([own.mean(axis=0) for own in each]).reshape(-1, 3)


def _changed(track: ImuTrack, begin: float, end: float, before: Array, after: Array) -> Iterator[Finding]:
    """That it reads another gravity after a flight (M, 3) than before it (N, 3), m/s²; nothing where it hardly does.

    Where it lies otherwise, as much of the usual bias of each axis counts as the axes have turned.
    """
    lengths, (first, last) = (length(before), length(after)), (np.median(one, axis=0) for one in (before, after))
    was, reads = (float(np.median(one)) for one in lengths)
    turned = healthy.USUAL_BIAS["accel"] * float(np.linalg.norm(last / reads - first / was))
    spread = np.array([*(one.std() for one in lengths), turned, 0.5 * track.accel_step, check.REST_GRAVITY_SIGMA])
    size, sigma = abs(reads - was), float(np.linalg.norm(spread))
    sure = change_probability(_KIND.name, size, sigma, (begin, end))
    if sure <= 1.0 - priors.ACCUSED:
        return
    whose = f"the accelerometer of IMU {track.instance} ({track.source})"
    words = f"{whose} reads {reads:.2f} m/s² at rest after the flight, and read {was:.2f} ± {sigma:.2f} before it"
    evidence, span = f"{words} (probability of a fault {percent(sure)})", (begin, float(track.t[-1]))
    if sure < priors.ACCUSED:
        yield Finding(_KIND.name, "data", "warning", *span, evidence, _KIND.advice, undecided=True)
        return
    cause = Cause(_KIND.name, "imu", begin, sensor="accel", size=size, sigma=sigma, unit=_KIND.unit, probability=sure)
    cause = replace(cause, side_probability=sure, imu=track.instance)
    yield Finding(_KIND.name, "imu", "error", *span, evidence, _KIND.advice, words, cause)
