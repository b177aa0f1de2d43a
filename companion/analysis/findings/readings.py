"""Findings about readings that cannot be: the whole IMU frozen, or at the end of its range."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from companion.analysis.fault_interval import SENSORS
from companion.analysis.finding import Cause, Finding, IntArray, run_edges
from companion.analysis.imu_spec import ImuSpec
from companion.analysis.reference import BoolArray
from companion.constants import check, harm, healthy, priors
from companion.model import Array, AttitudeTrack, ImuTrack, counted
from companion.strapdown import quaternion


def reading_findings(
    track: ImuTrack, attitude: AttitudeTrack, imu: ImuSpec, armed: BoolArray | None = None
) -> Iterator[Finding]:
    """Readings that cannot be: frozen while the vehicle turns, at the end of the sensor's range.

    armed: (N,) whether the vehicle is, at the samples of the track; None where that is not known.
    """
    yield from _frozen(track, attitude, np.zeros(len(track), np.bool_) if armed is None else armed)
    for name, readings, step, full, unit in (
        ("gyro", track.gyro, track.gyro_step, imu.gyro.full_scale, "rad/s"),
        ("accel", track.accel, track.accel_step, imu.accel.full_scale, "m/s²"),
    ):
        at = np.flatnonzero(
            (np.abs(readings) >= 0.98 * full).any(axis=1) | _flat_tops(readings, name, step, track.rate_hz)
        )
        if not len(at):
            continue
        groups = np.split(at, np.flatnonzero(np.diff(track.t[at]) > check.GROUPED_S) + 1)
        for group in groups:
            start, end, most = float(track.t[group[0]]), float(track.t[group[-1]]), np.abs(readings[group]).max()
            moment = len(group) < harm.CLIPPED_MOMENT_S * track.rate_hz and len(at) < harm.CLIPPED_S * track.rate_hz
            yield Finding(
                f"{name}_clipping",
                "imu",
                "warning" if moment else "error",
                start,
                end,
                f"{counted(len(group), 'sample')} of the {SENSORS[name]} at the end of its range, {most:.1f} {unit}"
                + ("; a shock does this too: a single event is not counted as a sensor fault" if moment else ""),
                "Damp the mounting, or set a larger range: a shock, vibration or a turn is more than it can read.",
                cause=Cause(f"{name}_clipping", "imu", start, end, sensor=name),
            )


def _frozen(track: ImuTrack, attitude: AttitudeTrack, armed: BoolArray) -> Iterator[Finding]:
    """Stretches in which no axis changes, of half a second or more, while the autopilot's attitude tilts.

    A vehicle at rest reads the same whole milli-units for ever, while the estimator may still correct its tilt. So
    where no noise shows in the readings, the attitude has to turn by many of their steps a second; and readings without
    steps, as a simulator's, are none then. The noise is that with the motors as they are: some show it only in flight.
    """
    change = np.abs(np.diff(track.gyro, axis=0)).sum(axis=1) + np.abs(np.diff(track.accel, axis=0)).sum(axis=1)
    first, last = run_edges(np.asarray(change == 0))
    lasted = track.t[last + 1] - track.t[first]
    long = np.flatnonzero(lasted >= healthy.FROZEN_S)
    elsewhere = beside(len(change), first[long], last[long])
    least = {}
    for state in np.unique(armed[first[long]]):
        left = change[elsewhere & (armed[:-1] == state)]
        noisy = never_repeats(np.asarray(left == 0), track.rate_hz)
        least[state] = 0.0 if noisy else check.MANY_STEPS * track.gyro_step or np.inf
    for i in long:
        least_rate = least[armed[first[i]]]
        start, end = float(track.t[first[i]]), float(track.t[last[i] + 1])
        during = slice(*np.searchsorted(attitude.t, [start, end + 1e-9]).tolist())
        if during.stop - during.start < 3:
            continue
        moved = float(np.abs(np.diff(heading_free(attitude.q_ned_frd[during]), axis=0)).sum(axis=0).max())
        if moved > max(harm.MOVED_RAD, least_rate * (end - start)):
            yield Finding(
                "frozen",
                "imu",
                "error",
                start,
                end,
                f"every axis reads the same for {end - start:.1f} s while the autopilot's attitude moves by "
                f"{np.degrees(moved):.0f}°",
                "The sensor or its bus has stopped while its messages go on: do not fly on it. Look at its "
                "bus and power.",
            )


def _flat_tops(readings: Array, name: str, step: float, rate_hz: float) -> BoolArray:
    """(N,) samples at a level that an axis reaches in a moment, keeps and leaves in a moment: the end of a range.

    Whatever the data sheet says of it, and of either sign; at the end of the record it need not leave it. step: of the
    readings, 0 for floats. No reading goes on beyond the end of a range: a level that the axis exceeds at another time
    is none. Nor is one that it comes to slowly, as a vehicle comes to the rate that it is told. An edge is at most half
    as long as the top: a round one, a parabola, falls by three times what it is flat to there, which is less than half
    of an edge.

    Nor, below what is strong, one that chance makes: of N readings, n neighbours in a row are alike N pⁿ times, where a
    share p of them is among the thousand that read the most outside of such tops (Laplace's rule of succession). And
    there a short one shows a range by a second that ends at the same level: one alone is a peak of the motion, which
    steps of the readings make flat.
    """
    flat = np.zeros(len(readings), np.bool_)
    if rate_hz < check.STUCK_RATE_HZ:  # a top between two samples is not seen to be flat
        return flat
    for column in readings.T:
        level = np.abs(column)
        alike = np.abs(np.diff(column)) <= check.FLAT_TOP * level[1:]
        tops = list(_tops(column, alike & (level[1:] > check.TOP_STEPS / check.TOP_EDGE * step), rate_hz))
        outside = np.ones(len(alike), np.bool_)
        for top in tops:
            outside[top.start : top.stop - 1] = False
        most = np.argsort(np.where(outside, level[1:], -1.0))[-min(check.TOP_OTHERS, int(outside.sum())) :]
        p = (1.0 + alike[most].sum()) / (2.0 + len(most))
        ends = np.array([level[top].max() for top in tops])
        for top, end in zip(tops, ends.tolist(), strict=True):
            unlikely = len(column) * p ** (top.stop - top.start - 1) < priors.FALSE_ALARM
            short = top.stop - top.start < harm.CLIPPED_S * rate_hz
            again = np.count_nonzero(np.abs(ends - end) <= check.FLAT_TOP * end) > 1
            if end > harm.TOP_LEVEL[name] or (unlikely and (again or not short)):
                flat[top] = True
    return flat


def _tops(column: Array, same: BoolArray, rate_hz: float) -> Iterator[slice]:
    """Where one axis (N,) has the form of a flat top. same: (N-1,) neighbours that are alike."""
    level, lowest, highest = np.abs(column), float(column.min()), float(column.max())
    moment = round(check.TOP_S * rate_hz)
    fewest = max(check.TOP_SAMPLES, moment)
    begins, ends = run_edges(np.asarray(same))
    long = (ends + 2 - begins >= fewest) & (begins > 0)
    for first, last in zip(begins[long].tolist(), ends[long].tolist(), strict=True):
        top, count = slice(first, last + 2), last + 2 - first
        most = level[top].max()
        exceeded = (highest if column[first] > 0.0 else -lowest) > (1.0 + check.TOP_EDGE) * most
        scatters = np.ptp(column[top]) > check.TOP_SCATTER * check.FLAT_TOP * most
        if exceeded or scatters:
            continue
        beside = max(1, min(moment + 1, count // 2))
        before, after = max(first - beside, 0), min(last + 1 + beside, len(column) - 1)
        reached = abs(column[first] - column[before]) > check.TOP_EDGE * most
        left = abs(column[after] - column[last + 1]) > check.TOP_EDGE * most and most > level[after]
        if reached and (left or top.stop == len(column)):
            yield top


def beside(count: int, first: IntArray, last: IntArray) -> BoolArray:
    """(count,) which changes lie outside of the runs from first to last."""
    beside = np.ones(count, np.bool_)
    for begin, end in zip(first, last, strict=True):
        beside[begin : end + 1] = False
    return beside


def by_second(change: Array, rate_hz: float) -> Array:
    """Changes from sample to sample (n,) as whole seconds (S, rate)."""
    block = max(1, round(rate_hz))
    return change[: len(change) // block * block].reshape(-1, block)


def never_repeats(same: BoolArray, rate_hz: float) -> bool:
    """Whether no second has many samples that are the one before, (n,): the noise is above the steps.

    To read the same for a second is then no chance, however little the vehicle moves.
    """
    seconds = by_second(same.astype(np.float64), rate_hz).mean(axis=1)
    return len(seconds) >= check.MIN_SECONDS and float(seconds.max()) < check.REPEATED_SELDOM


def goes_to_and_fro(change: Array, rate_hz: float) -> bool:
    """Whether changes (n,) turn back in the quietest third of all seconds, as those of noise do.

    A turn hides the noise in the others; of a vehicle that only turns, without noise, they turn back in none.
    """
    back = np.append(change[1:] * change[:-1] < 0.0, False).astype(np.float64)
    seconds = by_second(back, rate_hz).mean(axis=1)
    quiet = np.argsort(by_second(np.abs(change), rate_hz).mean(axis=1))[: len(seconds) // 3]
    return len(seconds) >= check.MIN_SECONDS and float(seconds[quiet].min()) > check.REPEATED_OFTEN


def swing(readings: Array) -> float:
    """Between what a fifth of the readings (n,) are below and a fifth above: a yaw reset is no turn."""
    low, high = np.percentile(readings, [20, 80])
    return float(high - low)


def evened(readings: Array, part: float) -> Array:
    """Means over a part of a stretch of readings (n,)."""
    span = max(1, round(part * len(readings)))
    return np.convolve(readings, np.full(span, 1.0 / span), "valid")


def heading_free(q: Array) -> Array:
    """Where the body's down points, as angles: what turns when the vehicle tilts, whatever the yaw does."""
    return np.asarray(quaternion.rotate(quaternion.conjugate(q), np.broadcast_to([0.0, 0.0, 1.0], (len(q), 3))))
