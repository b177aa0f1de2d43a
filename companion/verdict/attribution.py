"""Which of the two is wrong, by evidence: what the best estimate had to explain, and where the autopilot leaves it.

The smoother (`companion.estimation`) lets everything that may go wrong compete for what the sensors do not agree on.
What it accepted becomes fault intervals: the gyro read 15 mrad/s too much from 116 to 166 s. The autopilot's estimate,
which took no part in it, is then compared with it: where it is further off than both may be, it deviates.
A deviation that follows a fault interval is its consequence; one that follows nothing is the estimator's own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from companion.comparison import ends_of
from companion.constants import check, harm, healthy, num, priors
from companion.estimation import HEIGHTS, BestEstimate, harmful, hypothesis_of, probabilities, times_of_change
from companion.model import SensorInUse, words
from companion.verdict.constant_faults import ALL_THE_TIME, lone_fault_probability
from companion.verdict.fault_interval import (
    SENSOR_WORDS,
    EstimatorDeviation,
    FaultInterval,
    cause_of,
    described,
    fault_intervals,
    imu_at,
    is_sized,
    of_one_kind,
    own_odds,
    percent,
    probability_by_imu,
    probability_imu_or_aiding,
    reported_size,
    rival,
    turn_of_compass,
)
from companion.verdict.finding import Finding, Severity, Side


def may_be_fault(interval: FaultInterval) -> bool:
    """Whether an IMU's error is a fault; a sensor's is one where it misled the autopilot, which this does not say."""
    kind = hypothesis_of(interval.kind)
    least = harmful(kind, "step", interval.imu)
    return interval.device != "imu" or (not kind.nuisance and interval.magnitude >= least)


def follows(deviation: EstimatorDeviation, interval: FaultInterval, best: BestEstimate) -> bool:
    """Whether a deviation may be the consequence of an interval, and not of what was over long before it."""
    if deviation.start < interval.start - check.NEAR_S - num.SIGMAS * interval.start_sigma:
        return False
    if deviation.start > interval.end + healthy.EKF_RECOVERS_S:
        return False
    if interval.kind in HEIGHTS:
        most = check.OVERSHOOT * interval.magnitude + num.SIGMAS * deviation.sigma
        return deviation.quantity == "height" and deviation.size < most
    if interval.device != "compass":
        return True
    if deviation.quantity == "heading":
        turned, sigma = turn_of_compass(interval, best)
        return deviation.size < check.OVERSHOOT * turned + num.SIGMAS * float(np.hypot(sigma, deviation.sigma))
    return deviation.quantity != "height"


def _in_use(interval: FaultInterval, best: BestEstimate, in_use: SensorInUse | None) -> bool:
    """Whether the autopilot may have flown on the IMU whose fault it is."""
    if in_use is None:
        return interval.imu is None
    return in_use.uses(imu_at(interval, best, interval.imu), interval.start, interval.end)


def _which_imu(interval: FaultInterval, best: BestEstimate) -> str:
    """Which other IMU it may be, where that is not sure; "" elsewhere."""
    shares = probability_by_imu(interval, best)
    if next(iter(shares.values()), 1.0) >= priors.ACCUSED:
        return ""
    return f" (which IMU is not known: {', '.join(f'IMU {k} {percent(p)}' for k, p in shares.items() if p > 0.01)})"


def _cause_among(
    deviation: EstimatorDeviation, all_intervals: tuple[FaultInterval, ...], best: BestEstimate
) -> FaultInterval | None:
    """The first interval that a deviation may follow; of those that begin with it the likeliest."""
    may = [interval for interval in all_intervals if follows(deviation, interval, best)]

    def begins(one: FaultInterval) -> bool:
        return abs(deviation.start - one.start) <= check.NEAR_S + num.SIGMAS * one.start_sigma

    return max(filter(begins, may), key=own_odds, default=may[0] if may else None)


def findings_of(
    all_intervals: tuple[FaultInterval, ...],
    deviations: tuple[EstimatorDeviation, ...],
    best: BestEstimate,
    in_use: SensorInUse | None = None,
) -> list[Finding]:
    """Fault intervals and deviations as findings: causes as errors, faults that misled nobody as warnings.

    The harmless as information, if beyond its σ.

    in_use: the IMU that it flew on; another one misleads nobody.
    """
    may = tuple(e for e in all_intervals if e.device != "imu" or _in_use(e, best, in_use))
    caused = [(d, _cause_among(d, may, best)) for d in deviations]

    def led_to(one: FaultInterval) -> list[EstimatorDeviation]:
        return [d for d, cause in caused if cause is one and d.probability_after(one.start) > priors.PROBABLY_HARMFUL]

    by_interval = (_of_interval(one, led_to(one), best, in_use) for one in all_intervals)
    own = [d for d, cause in caused if cause is None and d.may_be_error]
    imu_agrees_from = min((d.start for d in own if d.imu_confirms), default=np.inf)
    return [*filter(None, by_interval), *(_own(d, best, imu_agrees_from) for d in own)]


def _of_interval(
    interval: FaultInterval, consequences: Sequence[EstimatorDeviation], best: BestEstimate, in_use: SensorInUse | None
) -> Finding | None:
    """A sensor's interval with the deviations that follow it; None for what is harmless and hardly more than its σ."""
    harmed = bool(consequences)
    misleads = any(d.probability_after(interval.start) >= priors.ACCUSED for d in consequences)
    severity: Severity = "warning" if harmed else "info"
    nobody = probabilities(interval.rivals)["nobody"]
    no_fault = nobody >= priors.ACCUSED
    if misleads or (may_be_fault(interval) and (harmed or (interval.device == "imu" and not no_fault))):
        severity = "error"
    if severity == "info" and not is_sized(interval, best):
        return None
    from_start = _is_from_start(interval, best)
    if from_start and interval.kind == "compass_turn" and not no_fault and not harmed:
        return _turned(interval, best)
    side: Side = "imu" if interval.device == "imu" else "autopilot" if harmed else "data"
    own_doubt = _doubt_of_interval(interval, best)
    doubt = own_doubt if severity == "error" else _doubt_below_error(severity, interval, best)
    if severity == "error" and from_start and (sure := _since_start(interval, best)) < priors.ACCUSED:
        doubt = Doubt(f"{ALL_THE_TIME} (a fault: {percent(sure)})" if sure else ALL_THE_TIME)
    misled_nobody = severity == "info" and interval.device != "imu" and not from_start
    severity = "warning" if misled_nobody and own_doubt is None else severity
    undecided = doubt is not None and (harmed or severity != "error" or not from_start)
    headline = evidence = described(interval, best)
    misled: tuple[str, ...] = ()
    if severity == "error" and interval.device == "imu":
        evidence = headline = f"{headline}{_which_imu(interval, best)}"
        if not _in_use(interval, best, in_use):
            evidence += "; the autopilot flew on another IMU"
    if harmed:
        worst = {d.quantity: d for d in sorted(consequences, key=lambda d: d.size)}
        misled = tuple(str(d) for d in worst.values())
        followed = "was" if doubt is None else "would have been"
        evidence += f"; the autopilot {followed} misled by it: {', '.join(misled)}"
    shown_kind = interval.kind
    if doubt is not None and doubt.rival == "cause" and no_fault and harmed:
        shown_kind = f"{consequences[0].quantity}_off"
        side, severity, headline = "data", "warning", ""
        off = f"the autopilot is off by {', '.join(misled)}, and no sensor's fault is known for it"
        evidence = f"{off}: {described(interval, best)} is one with {percent(1.0 - nobody)}"
    elif doubt is not None:
        side, severity, headline = "data", "warning", ""
        evidence = f"{'perhaps ' if doubt.would_tell else ''}{evidence}; {doubt.why}"
    elif no_fault and not harmed:
        evidence += f" (no fault: {percent(nobody)})"
    elif (next_best := rival(interval)) is not None:
        sure, (kind, share) = probabilities(interval.rivals)[interval.device], next_best
        evidence += f" (probability {percent(sure)}; runner-up: {words(kind)}, {percent(share)})"
    start, end = interval.start, min(interval.end, float(best.t[-1]))
    cause = cause_of(interval, best, side, misled) if doubt is None else None
    advice = (doubt and doubt.would_tell) or hypothesis_of(interval.kind).advice
    return Finding(shown_kind, side, severity, start, end, evidence, advice, headline, cause, undecided=undecided)


def _doubt_below_error(severity: Severity, interval: FaultInterval, best: BestEstimate) -> Doubt | None:
    """Why what is no error may be one: close to what harms, or no fault only because readings are too rare to tell."""
    if severity == "warning":
        return Doubt(_HARDLY_OFF, _ANOTHER)
    kind, slow = hypothesis_of(interval.kind), best.imu.rate_hz < harm.USELESS_RATE_HZ
    if kind.nuisance:  # no fault: but one may stand in its place
        shares = probabilities(interval.rivals)
        return _what_else(interval, "that", "nobody", shares, lambda name: hypothesis_of(name).device)
    if interval.device != "imu" or not slow:
        return None
    if interval.magnitude - num.Z_95 * interval.sigma < harmful(kind, "step", interval.imu):
        return None
    return Doubt(f"vibration that is sampled at {best.imu.rate_hz:.1f} Hz may read so as well", _FASTER)


def fault_probability(best: BestEstimate, constant: float = 0.0, until: float = np.inf) -> dict[str, float]:
    """Side → probability that a harmful fault of it is the first of the flight; "nobody" that there is none.

    By the readings of IMU, GPS, compass and barometer alone: what the autopilot made of them does not count.
    constant: that an IMU was wrong from the beginning. until: s, from when on nothing is judged.
    """
    intervals = fault_intervals(best)
    told = {(part.kind, part.imu, part.onset) for one in intervals for part in one.parts}
    small = (one for one in of_one_kind(best).explained if (one.kind, one.imu, one.onset) not in told)
    parts = [(one.start, _fault_shares(one, best)) for one in intervals if one.rivals]
    parts += [(one.onset, probabilities(one.rivals)) for one in small if one.rivals]
    first, none = {**dict.fromkeys(probabilities(()), 0.0), "imu": constant}, 1.0 - constant
    in_time = (shares for begin, shares in sorted(parts, key=lambda one: one[0]) if begin < until)
    for shares in (*in_time, probabilities(best.further)):
        for side, share in shares.items():
            first[side] += none * share
        none *= shares["nobody"]
    return {side: min(share, 1.0) for side, share in (first | {"nobody": none}).items()}


def _fault_shares(one: FaultInterval, best: BestEstimate) -> dict[str, float]:
    """Side → probability that what was off is a harmful fault of it, and no usual calibration since the start."""
    shares, device = probabilities(one.rivals), one.device
    sure = _since_start(one, best) if _is_from_start(one, best) else 0.0
    if not sure:
        return shares
    return shares | {device: shares[device] * sure, "nobody": shares["nobody"] + shares[device] * (1.0 - sure)}


def _is_from_start(interval: FaultInterval, best: BestEstimate) -> bool:
    """Whether it may have been there from the beginning on: of an IMU what grows is none of calibration or mounting."""
    lasting = not (interval.slow and interval.device == "imu")
    return lasting and interval.start - num.ONSET_SIGMAS * interval.start_sigma <= times_of_change(best.t)[0]


def _since_start(interval: FaultInterval, best: BestEstimate) -> float:
    """The probability that what was off since the start is a fault, where it is known what a calibration leaves."""
    if interval.kind in ("gyro_scale", "accel_scale"):
        return lone_fault_probability("scale", interval.size, interval.sigma)
    size, sigma, unit = reported_size(interval, best)
    is_field = interval.device == "compass" and unit == "µT"
    return lone_fault_probability("compass", np.array([size]), sigma) if is_field else 0.0


def _turned(interval: FaultInterval, best: BestEstimate) -> Finding:
    """A compass that is turned against the IMU since the start of the log: or the IMU, and the board with it."""
    size, sigma, _ = reported_size(interval, best)
    what = f"compass and IMU are turned against each other by {np.degrees(size):.0f} ± {np.degrees(sigma):.0f}°"
    evidence = f"{what} since the start of the log; which of them sits so, or is set so, cannot be told"
    settings = "COMPASS_ORIENT and AHRS_ORIENTATION, or CAL_MAG0_ROT and SENS_BOARD_ROT"
    advice = f"Compare the orientation settings with the vehicle: {settings}."
    return Finding(interval.kind, "data", "warning", *ends_of(best.t), evidence, advice, undecided=True)


_HARDLY_OFF = "that close to what both may be off by, it cannot be told which of them is wrong"
_ANOTHER = "A second sensor of the same kind in the log would tell, another IMU before all."


@dataclass(frozen=True, slots=True)
class Doubt:
    """Why something that is off accuses nobody."""

    why: str
    would_tell: str = ""  # what in a log would; "" where nothing does
    rival: Literal["", "cause", "IMU", "chance"] = ""  # what else it may be, where that has a probability


def _doubt_of_interval(interval: FaultInterval, best: BestEstimate) -> Doubt | None:
    """Why an interval that looks like a fault accuses nobody; None where it does."""
    if hypothesis_of(interval.kind).nuisance:
        return Doubt("a shock, strong vibration or lost samples do this too: no sensor is blamed for a single moment")
    if not best.converged:
        return _NOT_CONVERGED
    if best.contradicted:
        return _CONTRADICTED
    name, shares = words(interval.kind), probability_imu_or_aiding(interval)
    return _what_else(interval, name, _imu_or_aiding(interval.kind), shares, _imu_or_aiding)


def _what_else(
    interval: FaultInterval, name: str, own: str, shares: Mapping[str, float], side_of: Callable[[str], str]
) -> Doubt | None:
    """What else it may be, where the probability of its own side is too small to accuse that, or nobody.

    name: of the interval. shares: side → its probability. side_of: the side of a kind.
    """
    if shares[own] >= priors.ACCUSED:
        return None
    other = max((side for side in shares if side != own), key=lambda side: shares[side])
    faults = (one.kind for one in interval.rivals if not hypothesis_of(one.kind).nuisance)
    likeliest = next((kind for kind in faults if side_of(kind) == other), "")
    against = "no fault" if other == "nobody" else words(likeliest)
    why = f"cannot tell {name} from {against} ({percent(shares[own])} / {percent(shares[other])})"
    return Doubt(why, _ANOTHER, "cause")


def _imu_or_aiding(kind: str) -> str:
    return "imu" if hypothesis_of(kind).device == "imu" else "aiding"


_WITNESS = "GPS while the vehicle moves, or a second IMU, in the log would tell."
_FASTER = "An IMU that is better damped, logged faster than it shakes, or a second one would tell."
_NOISY = "the IMU fits the other sensors only with far more noise than it shows"
_CONTRADICTED = Doubt(f"{_NOISY}: it cannot be told which of them is wrong", _FASTER)
_UNFITTED = "the best estimate has not converged: no trajectory was found that fits the sensors best"
_NOT_CONVERGED = Doubt(_UNFITTED, _ANOTHER)


_MEASURED = ("position", "height")  # by GPS and barometer, whatever a gyro, an accelerometer or a compass reads


def _doubts(deviation: EstimatorDeviation, best: BestEstimate, imu_agrees_from: float) -> Iterator[Doubt]:
    """Why a deviation does not accuse the autopilot, the weightiest first; none where it does."""
    either, by_gyro = "it cannot be told which of the two is wrong", deviation.quantity not in _MEASURED
    if not best.converged:
        yield _NOT_CONVERGED
    if "gps_position" not in best.residuals:
        yield Doubt(f"without GPS {either}", _WITNESS, "IMU")
    if best.contradicted:
        yield _CONTRADICTED
    if best.noise.gyro_wanders and by_gyro:
        wanders = 1e3 * best.noise.gyro_walk * np.sqrt(60.0)
        yield Doubt(f"the gyro's bias wanders by {wanders:.1f} mrad/s in a minute (1σ): {either}", _FASTER, "IMU")
    if deviation.start >= imu_agrees_from:
        yield Doubt(f"the IMU moved as the autopilot says: {either}", _ANOTHER, "IMU")
    faults = (one.kind.split("_")[0] for one in best.further if one.fault_log_odds > priors.CANDIDATE)
    if by_gyro and (sensor := next((SENSOR_WORDS[one] for one in faults if one in SENSOR_WORDS), "")):
        why = f"a fault of the {sensor} explains it nearly as well: it cannot be told which of them is wrong"
        yield Doubt(why, _ANOTHER)
    if deviation.probability < priors.ACCUSED:
        why = f"{_HARDLY_OFF} (an error of the estimator: {percent(deviation.probability)})"
        yield Doubt(why, _ANOTHER, "chance")


def _own(deviation: EstimatorDeviation, best: BestEstimate, imu_agrees_from: float) -> Finding:
    """A deviation that nothing explains: the sensors agree with one another, and the estimate does not with them.

    imu_agrees_from: s, the beginning of the first deviation in which the IMU moved as the autopilot says.

    Without GPS, where a fault of a sensor explains it nearly as well, or where it is not far beyond what
    both may be off by, it is said and accuses nobody.
    """
    doubt = next(_doubts(deviation, best, imu_agrees_from), None)
    own, start, end = deviation.cause, deviation.start, deviation.end
    if doubt is not None:
        evidence, cause = f"autopilot and IMU differ by {deviation}; {doubt.why}", own if doubt.rival else None
        if doubt.rival == "IMU":
            sure, rival = deviation.or_imu
            cause = replace(own, probability=sure, side_probability=sure, rival="gyro_bias", rival_probability=rival)
        advice = doubt.would_tell
        return Finding(own.kind, "data", "warning", start, end, evidence, advice, cause=cause, undecided=True)
    against = "the best estimate of the sensors, which agree with each other"
    evidence = f"its estimate is off by {deviation} against {against}"
    advice = "Look at the estimator's innovations and at its settings; compare with another core or another estimator."
    headline = f"it is off by {deviation} from what all sensors together say, from {start:.1f} to {end:.1f} s"
    return Finding(own.kind, "autopilot", "error", start, end, evidence, advice, headline, own)
