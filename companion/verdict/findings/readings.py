"""Findings about readings that cannot be: the whole IMU frozen, or at the end of its range.

Also here: findings about the samples themselves: too slow, missing, at wrong times, by a clock of their own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from companion.comparison import Comparison, ImuSpec, down_in_body, ends_of, grouped, run_edges, turn_between, window
from companion.constants import check, harm, healthy, priors
from companion.model import Array, AttitudeTrack, BoolArray, Flight, ImuTrack, IntArray, counted, median
from companion.verdict.fault_interval import SENSOR_WORDS
from companion.verdict.finding import Cause, Finding, Severity


def reading_findings(
    track: ImuTrack, attitude: AttitudeTrack, imu: ImuSpec, armed: BoolArray | None = None
) -> Iterator[Finding]:
    """Readings that cannot be: frozen while the vehicle turns, at the end of the sensor's range.

    armed: (N,) whether the vehicle is, at the samples of the track; None where that is not known.
    """
    yield from frozen_findings(track, attitude, armed)
    for name, full, unit in (("gyro", imu.gyro.full_scale, "rad/s"), ("accel", imu.accel.full_scale, "m/s²")):
        readings, step = read_by(track, name)
        at = (np.abs(readings) >= 0.98 * full).any(axis=1) | _flat_tops(readings, name, step, track.rate_hz)
        total = int(at.sum())
        for group in grouped(track.t, np.flatnonzero(at)):
            (start, end), most = ends_of(track.t[group]), np.abs(readings[group]).max()
            many = counted(len(group), "sample")
            moment = len(group) < harm.CLIPPED_MOMENT_S * track.rate_hz and total < harm.CLIPPED_S * track.rate_hz
            evidence = f"{many} of the {SENSOR_WORDS[name]} at the end of its range, {most:.1f} {unit}"
            if moment:
                evidence += "; a shock does this too: a single event is not counted as a sensor fault"
            advice = "Damp the mounting, or set a larger range: a shock, vibration or a turn is more than it can read."
            severity: Severity = "warning" if moment else "error"
            cause = Cause(f"{name}_clipping", "imu", start, end, sensor=name)
            yield Finding(f"{name}_clipping", "imu", severity, start, end, evidence, advice, cause=cause)


def frozen_findings(track: ImuTrack, attitude: AttitudeTrack, armed: BoolArray | None = None) -> Iterator[Finding]:
    """Stretches in which no axis changes, of half a second or more, while the autopilot's attitude tilts.

    A vehicle at rest reads the same whole milli-units for ever, while the estimator may still correct its tilt. So
    where no noise shows in the readings, the attitude has to turn by many of their steps a second; and readings without
    steps, as a simulator's, are none then. The noise is that with the motors as they are: some show it only in flight.
    armed: as for `reading_findings`.
    """
    armed = np.zeros(len(track), np.bool_) if armed is None else armed
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
        during = window(attitude.t, start, end + 1e-9)
        if during.stop - during.start < 3:
            continue
        moved = float(np.abs(np.diff(down_in_body(attitude.q_ned_frd[during]), axis=0)).sum(axis=0).max())
        if moved > max(harm.MOVED_RAD, least_rate * (end - start)):
            same = f"every axis reads the same for {end - start:.1f} s"
            evidence = f"{same} while the autopilot's attitude moves by {np.degrees(moved):.0f}°"
            stopped = "The sensor or its bus has stopped while its messages go on: do not fly on it."
            yield Finding("frozen", "imu", "error", start, end, evidence, f"{stopped} Look at its bus and power.")


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
    if rate_hz < check.TOP_RATE_HZ:
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
    moment, end = round(check.TOP_S * rate_hz), len(column)
    fewest = max(check.TOP_SAMPLES, moment)
    begins, ends = run_edges(np.asarray(same))
    long = (ends + 2 - begins >= fewest) & (begins > 0)
    first, last = begins[long], ends[long] + 1
    if not len(first):
        return
    whole = np.append(column, 0.0)  # a run may go to the end of the track
    edges = np.column_stack((first, last + 1)).ravel()
    highest, lowest = np.maximum.reduceat(whole, edges)[::2], np.minimum.reduceat(whole, edges)[::2]
    most = np.maximum(np.abs(highest), np.abs(lowest))
    furthest = np.where(column[first] > 0.0, column.max(), -column.min())
    beside = np.maximum(1, np.minimum(moment + 1, (last + 1 - first) // 2))
    before, after = np.maximum(first - beside, 0), np.minimum(last + beside, end - 1)
    exceeded = furthest > (1.0 + check.TOP_EDGE) * most
    scatters = highest - lowest > check.TOP_SCATTER * check.FLAT_TOP * most
    reached = np.abs(column[first] - column[before]) > check.TOP_EDGE * most
    left = (np.abs(column[after] - column[last]) > check.TOP_EDGE * most) & (most > np.abs(column[after]))
    for i in np.flatnonzero(~exceeded & ~scatters & reached & (left | (last + 1 == end))):
        yield slice(int(first[i]), int(last[i]) + 1)


def read_by(track: ImuTrack, name: str) -> tuple[Array, float]:
    """What a gyro or an accelerometer reads (N, 3), and in which steps."""
    return (track.gyro, track.gyro_step) if name == "gyro" else (track.accel, track.accel_step)


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


def turns_back(change: Array, rate_hz: float) -> bool:
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


def rate_warning(flight: Flight, rate_hz: float) -> str | None:
    """What to say above the drift of an IMU whose samples are far apart; None where they are not."""
    if rate_hz >= harm.LOW_RATE_HZ:
        return None
    lost = "low: fast motion between samples is lost, which adds to the drift"
    if rate_hz < harm.USELESS_RATE_HZ:
        lost = "too low to integrate: motion between samples is lost"
    return f"{rate_hz:.{int(rate_hz < 10)}f} Hz is {lost}. {flight.how_to_record}."


def rate_findings(flight: Flight, comparison: Comparison, sampling_share: float) -> Iterator[Finding]:
    """The sample rate is too low for the motion: nothing else in the budget matters then."""
    track = comparison.track
    rate = track.rate_hz
    if rate < harm.USELESS_RATE_HZ or sampling_share > 0.5:
        evidence = f"{track.source} at {rate:.1f} Hz is too slow"
        if sampling_share > 0.05:
            evidence += f"; sampling is {100.0 * sampling_share:.0f} % of the expected attitude error"
        yield Finding("rate_too_low", "data", "warning", *ends_of(track.t), evidence, f"{flight.how_to_record}.")
    yield from _gap_findings(flight, comparison)


def _gap_findings(flight: Flight, comparison: Comparison) -> Iterator[Finding]:
    t = flight.imu(comparison.track.source).t  # with what is not judged
    gaps = np.flatnonzero(np.diff(t) > comparison.how.limits.longest_step(t))
    pauses = _paused(flight, t[gaps], t[gaps + 1])
    for paused, which in ((False, gaps[~pauses]), (True, gaps[pauses])):
        if not len(which):
            continue
        lengths = t[which + 1] - t[which]
        what, advice = counted(len(which), "gap"), "Check the link quality, or use the on-board log. "
        if paused:
            what, advice = counted(len(which), "pause") + " while disarmed", "Logging stops while disarmed. "
        elif flight.on_board:
            advice = "The logger could not keep up: check the SD card, or log fewer other messages. "
        severity: Severity = "warning" if not paused and lengths.sum() > 0.01 * (t[-1] - t[0]) else "info"
        begin, end = float(t[which[0]]), float(t[which[-1] + 1])
        in_all = f"{lengths.sum():.1f} s in all, the longest {lengths.max():.2f} s"
        evidence, advice = f"{comparison.track.source} has {what}, {in_all}", f"{advice}Windows over gaps are left out."
        yield Finding("samples_missing", "data", severity, begin, end, evidence, advice)


def _paused(flight: Flight, begin: Array, end: Array) -> BoolArray:
    """Which gaps (N,) of an on-board log are none of the logger's: the vehicle was not armed all the while.

    ArduPilot logs nothing then unless LOG_DISARMED says so, and begins with the next arming in the same file.
    """
    armed = flight.armed(begin, begin)
    if armed is None or not flight.on_board:
        return np.zeros(len(begin), np.bool_)
    changes = np.array([event.t for event in flight.events if event.kind in {"armed", "disarmed"}])
    return ~armed | (np.searchsorted(changes, end + check.ARMS_S, side="right") > np.searchsorted(changes, begin))


def stamp_findings(
    flight: Flight, comparison: Comparison, lags: Sequence[tuple[float, float, float]]
) -> Iterator[Finding]:
    """The times themselves are wrong: uneven beyond what a link does, or running away from the attitude's.

    lags: (begin s, end s, lag s) of the IMU behind the attitude, part by part of the flight.
    """
    track = comparison.track
    interval = np.diff(track.t)
    period = float(np.median(interval))
    within = interval[interval < check.GAP_PERIODS * period]
    off = np.abs(within - np.maximum(1.0, np.round(within / period)) * period)
    uneven = float(np.percentile(off, 90))
    if uneven > max(healthy.UNEVEN_PERIOD * period, healthy.UNEVEN_S):
        severity: Severity = "warning" if uneven > 2 * healthy.UNEVEN_PERIOD * period else "info"
        by = f"{uneven * 1e3:.0f} ms or more from multiples of {period * 1e3:.0f} ms"
        evidence = f"one interval in ten of {track.source} is off by {by}"
        advice = "The processor was too busy to sample evenly. Look at its load, and log less."
        if not flight.on_board:
            sent = "The autopilot timestamps on sending, not on sampling: a busy link or processor causes jitter."
            advice = f"{sent} Ask for fewer messages, or use the on-board log."
        yield Finding("samples_irregular", "data", severity, *ends_of(track.t), evidence, advice)
    if len(lags) < 2:
        return
    first, last = lags[0], lags[-1]
    moved = last[2] - first[2]
    if abs(moved) > harm.CLOCK_MOVED_S:
        severity = "error" if abs(moved) > harm.CLOCK_SPOILT_S else "warning"
        late = f"{first[2] * 1e3:.0f} ms behind the attitude at first and {last[2] * 1e3:.0f} ms at last"
        evidence = f"the IMU lags {late}: their clocks run at different rates"
        advice = "Both have to be stamped by one clock. Record the autopilot's own messages"
        advice += "." if flight.on_board else ", or use the on-board log."
        yield Finding("clocks_diverge", "data", severity, first[0], last[1], evidence, advice)


def lags(comparison: Comparison) -> list[tuple[float, float, float]]:
    """(begin s, end s, lag s) of each third of the flight that turns enough to tell, by the best match of the turns."""
    track, reference = comparison.track, comparison.reference
    if track.rate_hz < 1 / check.LAG_TURN_S or track.t[-1] - track.t[0] < check.LAG_PARTS * 4 * check.LAG_MAX_S:
        return []
    if (track.t[-1] - track.t[0]) / check.LAG_GRID_S > check.LAG_OVERSAMPLED * len(track):
        return []  # mostly gaps
    grid = np.arange(track.t[0] + check.LAG_TURN_S, track.t[-1] - check.LAG_TURN_S, check.LAG_GRID_S)
    half = check.LAG_TURN_S / 2
    ends = [np.clip(np.searchsorted(track.t, grid + one), 0, len(track) - 1) for one in (-half, half)]
    good = reference.attitude_known[ends[0]] & reference.attitude_known[ends[1]] & (ends[1] > ends[0])
    span = np.maximum(track.t[ends[1]] - track.t[ends[0]], 1e-9)[:, None]
    pairs = [[comparison.path.q[at] for at in ends], [reference.at(at).q_ned_frd for at in ends]]
    turned = [turn_between(*pair) / span for pair in pairs]
    by_part = []
    for part in np.array_split(np.arange(len(grid)), check.LAG_PARTS):
        lag = _best(turned[0][part], turned[1][part], np.asarray(good[part]))
        if lag is not None:
            by_part.append((float(grid[part[0]]), float(grid[part[-1]]), lag))
    return by_part


def _best(gyro: Array, attitude: Array, good: BoolArray) -> float | None:
    """The shift, s, that leaves the least between two rates (N, 3); None where none stands out."""
    most = round(check.LAG_MAX_S / check.LAG_GRID_S)
    inner = slice(most, len(gyro) - most)
    seen = attitude[inner] - attitude[inner].mean(axis=0)
    gyro = gyro - gyro[inner].mean(axis=0)  # constants fit any lag
    known = np.flatnonzero(good[inner])
    known = known[:: max(1, len(known) // check.LAG_MOMENTS)]
    power = median((seen[known] ** 2).sum(axis=1)) if len(known) else 0.0
    if power < check.LAG_MIN_RPS**2:
        return None
    shifted = (gyro[most + k + known] for k in range(-most, most + 1))
    left = np.array([median(((one - seen[known]) ** 2).sum(axis=1)) for one in shifted])
    k = int(np.argmin(left))
    shifts = check.LAG_ASIDE
    aside = left[max(0, k - shifts) : k + shifts + 1][[0, -1]].min()
    if not shifts <= k <= 2 * most - shifts or left[k] > check.LAG_SHARP * min(power, aside):
        return None
    below, at, above = left[k - 1 : k + 2]
    return float((k - most + 0.5 * (below - above) / max(below - 2 * at + above, 1e-12)) * check.LAG_GRID_S)
