"""Which of the two is wrong, by evidence: what the best estimate had to explain, and where the autopilot leaves it.

The smoother (`companion.estimation`) lets everything that may go wrong compete for what the sensors do not agree on.
What it accepted becomes episodes: the gyro read 15 mrad/s too much from 116 to 166 s. The autopilot's own estimate,
which took no part in it, is then compared with the best estimate: where it is further off than both may be, it departs.
A departure that follows an episode is its consequence; one that follows nothing is the estimator's own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from companion.analysis.constant_faults import compass_fault_probability
from companion.analysis.episode import (
    SENSORS,
    Departure,
    Episode,
    cause_of,
    is_sized,
    likelihoods,
    own_odds,
    percent,
    probability_by_imu,
    probability_by_side,
    rival,
    said,
    size_told,
    turn_of_compass,
)
from companion.analysis.finding import Finding, Severity, Side
from companion.analysis.lasting_errors import ALL_THE_TIME
from companion.constants import check, num, priors
from companion.estimation import (
    BestEstimate,
    coning,
    harmful,
    hides_shaking,
    kind_of,
    times_of_change,
)
from companion.model import SensorInUse, words


def is_serious(episode: Episode) -> bool:
    """Whether an IMU's episode is a fault; a sensor's is one where it misled the autopilot, which this does not say."""
    kind = kind_of(episode.kind)
    least = harmful(kind, "step", episode.imu)
    return episode.witness != "imu" or (not kind.nuisance and episode.magnitude >= least)


def follows(departure: Departure, episode: Episode, best: BestEstimate) -> bool:
    """Whether a departure may be the consequence of an episode."""
    if departure.start < episode.start - check.NEAR_S - num.SIGMAS * episode.start_sigma:
        return False
    if episode.kind in _OF_HEIGHT:
        most = check.OVERSHOOT * episode.magnitude + num.SIGMAS * departure.sigma
        return departure.quantity == "height" and departure.size < most
    if episode.witness != "compass":
        return True
    if departure.quantity == "heading":
        turned, sigma = turn_of_compass(episode, best)
        return departure.size < check.OVERSHOOT * turned + num.SIGMAS * float(np.hypot(sigma, departure.sigma))
    return departure.quantity != "height"


def _in_use(episode: Episode, best: BestEstimate, in_use: SensorInUse | None) -> bool:
    """Whether the autopilot may have flown on the IMU whose fault it is."""
    if in_use is None:
        return episode.imu is None
    return in_use.uses(best.imu.instance if episode.imu is None else episode.imu, episode.start, episode.end)


def _which_imu(episode: Episode, best: BestEstimate) -> str:
    """Which other IMU it may be, where that is not sure; "" elsewhere."""
    shares = probability_by_imu(episode, best)
    if next(iter(shares.values()), 1.0) >= priors.ACCUSED:
        return ""
    return f" (which IMU is not known: {', '.join(f'IMU {k} {percent(p)}' for k, p in shares.items() if p > 0.01)})"


def _cause_among(departure: Departure, all_episodes: tuple[Episode, ...], best: BestEstimate) -> Episode | None:
    """The first episode that a departure may follow; of those that begin with it the likeliest."""
    may = [episode for episode in all_episodes if follows(departure, episode, best)]

    def begins(one: Episode) -> bool:
        return abs(departure.start - one.start) <= check.NEAR_S + num.SIGMAS * one.start_sigma

    return max(filter(begins, may), key=own_odds, default=may[0] if may else None)


def findings_of(
    all_episodes: tuple[Episode, ...],
    departed: tuple[Departure, ...],
    best: BestEstimate,
    jumps: Sequence[Finding] = (),
    in_use: SensorInUse | None = None,
) -> list[Finding]:
    """Episodes and departures as findings: causes as errors, the harmless as information if it is more than its σ.

    jumps: those of the autopilot's heading and position. in_use: the IMU that it flew on; another one misleads nobody.
    """
    may = tuple(e for e in all_episodes if e.witness != "imu" or _in_use(e, best, in_use))
    causes = [_cause_among(d, may, best) for d in departed]
    led_to = [[d for d, cause in zip(departed, causes, strict=True) if cause is one] for one in all_episodes]
    told = [_of_episode(one, led, best, in_use) for one, led in zip(all_episodes, led_to, strict=True)]
    out = [finding for finding in told if finding is not None]
    own = [d for d, cause in zip(departed, causes, strict=True) if cause is None]
    by_imu = min((d.start for d in own if d.as_the_imu), default=np.inf)
    return out + [_own(d, best, by_imu, _steps(d, jumps)) for d in own]


def _of_episode(
    episode: Episode, consequences: Sequence[Departure], best: BestEstimate, in_use: SensorInUse | None
) -> Finding | None:
    """A sensor's episode with the departures that follow it; None for what is harmless and hardly more than its σ."""
    harmed = bool(consequences)
    misleads = any(d.size >= check.CERTAIN_SIGMAS * d.sigma for d in consequences)
    severity: Severity = "warning" if harmed else "info"
    no_fault = likelihoods(episode).get("nobody", 0.0) >= priors.ACCUSED
    if misleads or (is_serious(episode) and (harmed or (episode.witness == "imu" and not no_fault))):
        severity = "error"
    if severity == "info" and not is_sized(episode, best):
        return None
    from_start = episode.start - num.ONSET_SIGMAS * episode.start_sigma <= times_of_change(best.t)[0]
    if from_start and episode.kind == "compass_turn" and not no_fault and not harmed:
        return _turned(episode, best)
    side: Side = "imu" if episode.witness == "imu" else "autopilot" if harmed else "data"
    why, would_tell = (_HARDLY_OFF, _ANOTHER) if severity == "warning" else ("", "")
    if severity == "error":
        why, would_tell = _why_undecided(episode, best)
        if from_start and (sure := _since_start(episode, best)) < priors.ACCUSED:
            why, would_tell = f"{ALL_THE_TIME} (a fault: {percent(sure)})" if sure else ALL_THE_TIME, ""
    undecided = bool(why) and (harmed or severity != "error" or not from_start)
    headline = said_of = said(episode, best)
    misled: tuple[str, ...] = ()
    if severity == "error" and episode.witness == "imu":
        said_of = headline = f"{headline}{_which_imu(episode, best)}"
        if not _in_use(episode, best, in_use):
            said_of += "; the autopilot flew on another IMU"
    if harmed:
        worst = {d.quantity: d for d in sorted(consequences, key=lambda d: d.size)}
        misled = tuple(str(d) for d in worst.values())
        said_of += f"; the autopilot {'would have been' if why else 'was'} misled by it: " + ", ".join(misled)
    if why:
        side, severity, headline = "data", "warning", ""
        said_of = f"{'perhaps ' if would_tell else ''}{said_of}; {why}"
    elif no_fault and not harmed:
        said_of += f" (no fault: {percent(likelihoods(episode)['nobody'])})"
    elif (next_best := rival(episode)) is not None:
        sure, (kind, share) = likelihoods(episode)[episode.witness], next_best
        said_of += f" (probability {percent(sure)}; next: {words(kind)}, {percent(share)})"
    end = min(episode.end, float(best.t[-1]))
    cause = None if why else cause_of(episode, best, side, misled)
    advice = would_tell or kind_of(episode.kind).advice
    return Finding(
        episode.kind, side, severity, episode.start, end, said_of, advice, headline, cause, undecided=undecided
    )


def _since_start(episode: Episode, best: BestEstimate) -> float:
    """The probability that what was off since the start is a fault, where it is known what a calibration leaves."""
    size, sigma, unit = size_told(episode, best)
    return compass_fault_probability(size, sigma) if episode.witness == "compass" and unit == "µT" else 0.0


def _turned(episode: Episode, best: BestEstimate) -> Finding:
    """A compass that is turned against the IMU since the start of the log: or the IMU, and the board with it."""
    size, sigma, _ = size_told(episode, best)
    what = f"compass and IMU are turned against each other by {np.degrees(size):.0f} ± {np.degrees(sigma):.0f}°"
    return Finding(
        episode.kind,
        "data",
        "warning",
        float(best.t[0]),
        float(best.t[-1]),
        f"{what} since the start of the log; which of them sits so, or is set so, cannot be told",
        "Compare the orientation settings with the vehicle: COMPASS_ORIENT and AHRS_ORIENTATION, or CAL_MAG0_ROT and "
        "SENS_BOARD_ROT.",
        undecided=True,
    )


_OF_HEIGHT = ("gps_height", "barometer")  # kinds that mislead nothing else
_HARDLY_OFF = "that close to what both may be off by, it cannot be told which of them is wrong"


def _may_be_coning(episode: Episode, size: float, best: BestEstimate) -> bool:
    """Whether a gyro reads no more too much than its shaking adds up to, of which a low-pass may hide any part."""
    return (
        episode.kind == "gyro_bias"
        and episode.imu is None
        and hides_shaking(best.imu)
        and size < float(np.linalg.norm(coning(best.imu, episode.start, episode.end)))
    )


_ANOTHER = "A second sensor of the same kind in the log would tell, another IMU before all."
_CUTOFF = "The cutoff of the gyro's low-pass, a parameter of the vehicle, in the log would tell."


def _creeps_in_order(kind: str, size: float, sigma: float) -> bool:
    """Whether what goes off slowly may go no further than that of a sensor in order."""
    return size < kind_of(kind).least_slow + num.SIGMAS * sigma


def _why_undecided(episode: Episode, best: BestEstimate) -> tuple[str, str]:
    """Why an episode that looks like a fault accuses nobody, empty where it does; and what would tell."""
    size, _, _ = size_told(episode, best)
    reasons = (
        (kind_of(episode.kind).nuisance,
         "a shock, strong vibration or lost samples do this too: no sensor is blamed for a single moment", ""),
        (_may_be_coning(episode, size, best),
         "the gyro is shaken so much that what its low-pass hides of the shaking may add up to it", _CUTOFF),
        (best.contradicted and episode.witness != "imu", _CONTRADICTED, _FASTER),
        _undecided(episode),
    )  # fmt: skip
    return next(((why, tells) for applies, why, tells in reasons if applies), ("", ""))


def _undecided(episode: Episode) -> tuple[bool, str, str]:
    """Whether the probability that the sensor's side is at fault is too small to accuse it, and what else it may be."""
    by_side, own = probability_by_side(episode), _side(episode.kind)
    other = max((side for side in by_side if side != own), key=lambda side: by_side[side])
    likeliest = next((one.kind for one in episode.rivals if _side(one.kind) == other), "")
    name = "no fault" if other == "nobody" else words(likeliest)
    return (
        by_side[own] < priors.ACCUSED,
        f"cannot tell {words(episode.kind)} from {name} ({percent(by_side[own])} / {percent(by_side[other])})",
        _ANOTHER,
    )


def _side(kind: str) -> str:
    return "imu" if kind_of(kind).side == "imu" else "aiding"


_WITNESS = "GPS while the vehicle moves, or a second IMU, in the log would tell."
_CONTRADICTED = (
    "the IMU fits the other sensors only with far more noise than it shows: it cannot be told which of them is wrong"
)
_FASTER = "An IMU that is better damped, logged faster than it shakes, or a second one would tell."
_RECEIVER = "A second GPS receiver in the log would tell."


_MEASURED = ("position", "height")  # by GPS and barometer, whatever a gyro, an accelerometer or a compass reads


def _why_unsure(departure: Departure, best: BestEstimate, by_imu: float) -> tuple[str, str]:
    """Why a departure does not accuse the autopilot, empty where it does; and what would tell."""
    faults = (one.kind for one in best.further if one.fault_log_odds > priors.CANDIDATE)
    likely = (sensor for kind in faults if (sensor := SENSORS.get(kind.split("_")[0])))
    sensor = None if departure.quantity in _MEASURED else next(likely, None)
    slowly_off = departure.quantity == "position" and not departure.sudden
    reasons = (
        ("gps_position" not in best.residuals, "without GPS it cannot be told which of them is wrong", _WITNESS),
        (slowly_off and _creeps_in_order("gps_position", departure.size, departure.sigma),
         "a GPS in order creeps as far: it cannot be told which of them is wrong", _RECEIVER),
        (best.contradicted, _CONTRADICTED, _FASTER),
        (departure.start >= by_imu, "the IMU moved as the autopilot says: it cannot be told which of them is wrong",
         _ANOTHER),
        (sensor is not None,
         f"a fault of the {sensor} explains it nearly as well: it cannot be told which of them is wrong", _ANOTHER),
        (departure.probability < priors.ACCUSED,
         f"{_HARDLY_OFF} (an error of the estimator: {percent(departure.probability)})", _ANOTHER),
    )  # fmt: skip
    return next(((why, tells) for applies, why, tells in reasons if applies), ("", ""))


_STEPS = {"heading": "heading_jump", "position": "position_jump"}


def _steps(departure: Departure, jumps: Sequence[Finding]) -> bool:
    """Whether a departure begins with a jump of the autopilot's own: it is its own then, however uncertain its size.

    Of a position only where it is itself a step: between two lanes an estimate may jump there and back.
    """
    if departure.quantity == "position" and not departure.sudden:
        return False
    own = [one for one in jumps if one.kind == _STEPS.get(departure.quantity) and one.severity == "error"]
    return any(-check.NOTICED_S < one.start_s - departure.start < check.NEAR_S for one in own)


def _own(departure: Departure, best: BestEstimate, by_imu: float, steps: bool) -> Finding:
    """A departure that nothing explains: the sensors agree with one another, and the estimate does not with them.

    by_imu: s, when the first one began in which the IMU sides with the autopilot. steps: whether it begins with a jump.

    But for these, without GPS, where a fault of a sensor explains it nearly as well, or where it is not far beyond what
    both may be off by, it is said and accuses nobody.
    """
    led = best.contradicted or departure.start >= by_imu  # an estimator jumps too to be rid of what an IMU led it to
    why, would_tell = ("", "") if steps and not led else _why_unsure(departure, best, by_imu)
    unsure, cause = bool(why), departure.cause
    if steps and not unsure:  # whose size is uncertain, but not that it is one
        cause = replace(cause, probability=None, side_probability=None)
    words = f"its estimate is off by {departure} against the best estimate of the sensors, which agree with each other"
    if unsure:
        words = f"autopilot and IMU differ by {departure}; {why}"
    return Finding(
        f"{departure.quantity}_off",
        "data" if unsure else "autopilot",
        "warning" if unsure else "error",
        departure.start,
        departure.end,
        words,
        would_tell if unsure else
        "Look at the estimator's innovations and at its settings; compare with another core or another estimator.",
        headline="" if unsure else f"it is off by {departure} from what all sensors together say, "
        f"from {departure.start:.1f} to {departure.end:.1f} s",
        cause=cause if not unsure or why.startswith(_HARDLY_OFF) else None,
        undecided=unsure,
    )  # fmt: skip
