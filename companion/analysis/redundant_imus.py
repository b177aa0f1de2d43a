"""Every IMU of a flight through the same windows, and IMU against IMU: which of two changed in flight.

Two IMUs of one vehicle feel the same motion but for the distance between them. The difference of their readings over
seconds is the difference of their errors: one that changes at once belongs to one of them, whatever the vehicle does
and however slowly one of them was logged. Which one, says the best estimate that was made with one of the two: where it
had to explain nothing and would have shown a change of this size, it is the other. A difference that stands from the
beginning says what the other's bias is: the estimate knows that of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from companion.analysis.budget import ATTITUDE, POSITION, budget, chi_square_95, nees, stacked
from companion.analysis.comparison import Comparison, windows
from companion.analysis.drift import DriftRow, drift_of
from companion.analysis.episode import BIAS_UNITS, SENSORS, SIGMAS
from companion.analysis.finding import Cause, Finding, digits
from companion.analysis.imu_spec import USUAL_BIAS, ImuSpec, ReferenceSpec
from companion.analysis.phases import phases
from companion.estimation import BestEstimate, Explained, kind_of
from companion.model import Array, Flight, ImuTrack, interpolated

_HORIZON_S = 5.0


@dataclass(frozen=True, slots=True, eq=False)
class RedundantImu:
    """One IMU of several."""

    imu: str
    instance: int
    rate_hz: float
    drift: DriftRow  # after 5 s
    inside: Mapping[str, float]  # attitude, position → share of windows inside the 95 % bound; empty without windows


def each_imu(
    flight: Flight,
    compare_imu: Callable[[str], Comparison],
    imu_spec_of: Callable[[str], ImuSpec],
    autopilot: ReferenceSpec,
) -> tuple[RedundantImu, ...]:
    """Every IMU of the flight with two samples or more, each by its own part's figures."""
    return tuple(
        _redundant(compare_imu(name), imu_spec_of(name), autopilot)
        for name, track in flight.imus.items()
        if len(track) > 1
    )


def _redundant(comparison: Comparison, figures: ImuSpec, autopilot: ReferenceSpec) -> RedundantImu:
    chosen = windows(comparison, _HORIZON_S)
    inside: dict[str, float] = {}
    if len(chosen.start):
        total = budget(comparison, chosen, figures, autopilot).total
        error = stacked(comparison, chosen)
        blocks = {"attitude": ATTITUDE, "position": POSITION} if comparison.has_position else {"attitude": ATTITUDE}
        inside = {
            name: float(np.mean(nees(error[:, b], total[:, b, b]) < chi_square_95(3))) for name, b in blocks.items()
        }
    row = drift_of(comparison, (_HORIZON_S,)).rows[0]
    track = comparison.track
    return RedundantImu(track.source, track.instance, track.rate_hz, row, inside)


_BLOCK_S = 2.0  # over which differences are averaged
_FEWEST_READINGS, _FEWEST_BLOCKS = 3, 12
_LEAST: Mapping[str, float] = {"gyro": 8e-3, "accel": 0.4}
"""rad/s, m/s²: two healthy IMUs part by less in a flight, also where vibration shifts one of them."""

_TRIED = 64  # times at which a step is looked for at first
_UNHEARD_S = 10.0  # after which one of them may have been calibrated anew
_CERTAIN = 8.0  # σ of the difference
_AT_ONCE_S = 5.0  # within which two changes are taken for one
_ABRUPT = 4.0  # times less is left of the difference's changes when one step is taken out


@dataclass(frozen=True, slots=True)
class Parting:
    """A change of the difference between two IMUs."""

    sensor: str  # "gyro", "accel"
    axis: str  # that it is greatest on
    onset: float  # s, boot clock
    onset_sigma: float
    size: Array  # (3,) rad/s or m/s² of the second less the first, after less before
    sigma: float  # of its length


Differences = Mapping[str, tuple[Array, Array]]
"""Of each sensor: times (B,) s and what the second IMU reads more than the first (B, 3), median over some seconds."""


def differences(first: ImuTrack, second: ImuTrack, spans: Sequence[tuple[float, float]]) -> Differences:
    """What two IMUs differ by within spans of boot time (s)."""
    return {sensor: _blocks(first, second, sensor, spans) for sensor in BIAS_UNITS}


def partings(between: Differences) -> Iterator[Parting]:
    """Steps of the differences: at most one of each sensor."""
    for sensor, (t, off) in between.items():
        parting = _parting(sensor, t, off)
        if parting is not None:
            yield parting


def _blocks(
    first: ImuTrack, second: ImuTrack, sensor: str, spans: Sequence[tuple[float, float]]
) -> tuple[Array, Array]:
    """Times (B,) s and median differences (B, 3), second less first, of blocks with enough readings of both."""
    slow, fast, sign = (first, second, -1.0) if first.rate_hz < second.rate_hz else (second, first, 1.0)
    inside = np.zeros(len(slow), np.bool_)
    for start, end in spans:
        inside |= (slow.t >= start) & (slow.t <= end)
    inside &= (slow.t >= fast.t[0]) & (slow.t <= fast.t[-1])
    i = np.clip(np.searchsorted(fast.t, slow.t), 1, len(fast) - 1)
    inside &= fast.t[i] - fast.t[i - 1] < 3.0 / fast.rate_hz
    t, readings = slow.t[inside], getattr(slow, sensor)[inside]
    other = interpolated(t, fast.t, getattr(fast, sensor))
    off = sign * (readings - other)
    width = max(_BLOCK_S, _FEWEST_READINGS / slow.rate_hz)
    block = np.floor(t / width).astype(np.int64)
    names, begin, count = np.unique(block, return_index=True, return_counts=True)
    whole = count >= _FEWEST_READINGS
    parts = [np.median(off[b : b + n], axis=0) for b, n in zip(begin[whole], count[whole], strict=True)]
    return np.asarray((names[whole] + 0.5) * width, np.float64), np.asarray(parts, np.float64).reshape(-1, 3)


def _best_of(off: Array, at: npt.NDArray[np.int64]) -> int:
    """Before which of the blocks `at` the differences (B, 3) step: where their two medians leave least of them."""
    left = [sum(float(np.abs(part - np.median(part, axis=0)).sum()) for part in (off[:k], off[k:])) for k in at]
    return int(at[int(np.argmin(left))])


def _parting(sensor: str, t: Array, off: Array) -> Parting | None:
    """The one step that explains the differences (B, 3) at times (B,), if it is large, certain and abrupt."""
    if len(t) < _FEWEST_BLOCKS:
        return None
    at = np.arange(_FEWEST_READINGS, len(t) - _FEWEST_READINGS + 1)
    apart = max(1, len(at) // _TRIED)  # a long flight is looked through in steps, and closely about the best of them
    k = _best_of(off, at[::apart])
    k = _best_of(off, at[np.abs(at - k) < apart])
    before, after = np.median(off[:k], axis=0), np.median(off[k:], axis=0)
    if t[k] - t[k - 1] > _UNHEARD_S:
        return None
    size = after - before
    # what the differences scatter by beside the step, slow changes included
    rest = np.concatenate((off[:k] - before, off[k:] - after))
    scatter = 1.4826 * np.median(np.abs(rest), axis=0)
    sigma = float(np.sqrt((scatter**2).sum() * (1.0 / k + 1.0 / (len(t) - k))))
    length = float(np.linalg.norm(size))
    if length < max(_LEAST[sensor], _CERTAIN * sigma) or length < _ABRUPT * float(np.linalg.norm(scatter)):
        return None
    return Parting(
        sensor,
        "xyz"[int(np.argmax(np.abs(size)))],
        float(0.5 * (t[k - 1] + t[k])),
        float((t[k] - t[k - 1]) / np.sqrt(12.0)),
        size,
        sigma,
    )


def parting_findings(flight: Flight, used: ImuTrack, best: BestEstimate) -> list[Finding]:
    """What another IMU of the flight did, or reads all the time, that the best estimate's own does not.

    Where its own has an error of another time, what both read all the time tells nothing of the other.
    """
    own = tuple(e for e in best.explained if kind_of(e.kind).side == "imu")
    spans = [(p.start, p.end) for p in phases(flight) if p.kind == "flight"]
    findings: list[Finding] = []
    for track in _others(flight, used):
        between = differences(used, track, spans)
        parted = list(partings(between))
        findings += [
            _finding(flight, used, track, one, known=_would_show(best, one, one.onset), alone=not own)
            for one in parted
            if _would_show(best, one, 0.5 * float(best.t[0] + best.t[-1]))
            and not any(_may_be(one, error) for error in own)
        ]
        if own:
            continue
        steady = ((sensor, off) for sensor, (_, off) in between.items() if all(one.sensor != sensor for one in parted))
        findings += [f for sensor, off in steady if (f := _biased(used, track, sensor, off, best))]
    return findings


def _biased(used: ImuTrack, track: ImuTrack, sensor: str, off: Array, best: BestEstimate) -> Finding | None:
    """Another IMU whose bias is larger than real parts have in flight, all the time; off: of `Differences`."""
    if len(off) < _FEWEST_BLOCKS:
        return None
    bias = np.median(getattr(best.states, f"{sensor}_bias"), axis=0) + np.median(off, axis=0)
    sigma = np.median(getattr(best, f"{sensor}_bias_sigma"), axis=0)  # that of the difference is far less
    if not (np.abs(bias) > USUAL_BIAS[sensor] + sigma).any():
        return None
    unit, scale, decimals = BIAS_UNITS[sensor]
    return Finding(
        "imus_disagree",
        "imu",
        "warning",
        float(track.t[0]),
        float(track.t[-1]),
        f"{track.source} (IMU {track.instance}): {SENSORS[sensor]} bias ({digits(scale * bias, decimals)}) ± "
        f"{float(sigma.max()) * scale:.{decimals}f} {unit} all the time; {used.source} (IMU {used.instance}), "
        "which was judged, agrees with all other sensors",
        f"Calibrate IMU {track.instance} at rest: the autopilot may switch to it.",
    )


def _others(flight: Flight, used: ImuTrack) -> list[ImuTrack]:
    """One track of every other IMU, the fastest that it has."""
    tracks: dict[int, ImuTrack] = {}
    for track in flight.imus.values():
        if track.instance != used.instance and len(track) > 1:
            known = tracks.get(track.instance)
            if known is None or track.rate_hz > known.rate_hz:
                tracks[track.instance] = track
    return list(tracks.values())


def _would_show(best: BestEstimate, one: Parting, onset: float) -> bool:
    """Whether the best estimate would show such a change of its own IMU, if it began then.

    What shows from the middle of the flight on shows later only if it is larger: a rate that is told by angles with
    white noise is told to the power 3/2 of the time.
    """
    half, left = 0.5 * float(best.t[-1] - best.t[0]), float(best.t[-1]) - onset
    least = best.detectable.get(f"{one.sensor}_bias", np.inf) * max(half / max(left, 1e-3), 1.0) ** 1.5
    return bool(least < float(np.linalg.norm(one.size)))


def _may_be(one: Parting, own: Explained) -> bool:
    """Whether a parting may be an error of the estimate's own IMU: one begins or ends then, of whichever sensor."""
    apart = min(abs(one.onset - own.onset), abs(one.onset - own.end))
    return apart < max(SIGMAS * float(np.hypot(one.onset_sigma, own.onset_sigma)), _AT_ONCE_S)


def _finding(flight: Flight, used: ImuTrack, track: ImuTrack, one: Parting, *, known: bool, alone: bool) -> Finding:
    """known: whether it is known which of the two it is. alone: whether the one that is judged shows no error ever."""
    kind, (unit, scale, decimals) = kind_of(f"{one.sensor}_bias"), BIAS_UNITS[one.sensor]
    in_use = flight.imu_in_use
    flown = set() if in_use is None else {int(instance) for instance in in_use.instance}
    words = (
        f"{track.source} (IMU {track.instance}): {SENSORS[one.sensor]} reads ({digits(scale * one.size, decimals)}) ± "
        f"{one.sigma * scale:.{decimals}f} {unit} more than {used.source} (IMU {used.instance}) "
        f"from {one.onset:.1f} ± {one.onset_sigma:.1f} s to the end"
    )
    advice = f"Calibrate IMU {track.instance}; if it steps again, disable it: the autopilot may switch to it."
    agrees = ", which agrees with all other sensors" if alone else ", which shows no change then"
    words += agrees if known else ": too short a time to tell which of them is wrong"
    if known and flown == {used.instance}:
        words += f"; the autopilot flew on IMU {used.instance}: its estimate is right"
    return Finding(
        kind.name,
        "imu",
        "error",
        one.onset,
        float(track.t[-1]),
        words,
        advice if known else "",
        words,
        Cause(
            kind.name,
            "imu",
            one.onset,
            onset_sigma_s=one.onset_sigma,
            sensor=one.sensor,
            axis=one.axis if abs(one.size["xyz".index(one.axis)]) > 0.9 * float(np.linalg.norm(one.size)) else "",
            size=float(np.linalg.norm(one.size)),
            sigma=one.sigma,
            unit=kind.unit,
        ),
    )
