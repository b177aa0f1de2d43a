"""Which of the two is wrong, by evidence: what the best estimate had to explain, and where the autopilot leaves it.

The smoother (`companion.estimation`) lets everything that may go wrong compete for what the sensors do not agree on.
What it accepted becomes episodes: the gyro read 15 mrad/s too much from 116 to 166 s. The autopilot's own estimate,
which took no part in it, is then compared with the best estimate: where it is further off than both may be, it departs.
A departure that follows an episode is its consequence; one that follows nothing is the estimator's own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from companion.analysis.episode import (
    CLOSE,
    FAR,
    SENSORS,
    SIGMAS,
    Departure,
    Episode,
    axis_of,
    cause_of,
    gain_of,
    is_sized,
    rival_of_another,
    rivals,
    said,
    size_told,
)
from companion.analysis.finding import Finding, Severity, Side
from companion.analysis.lasting_errors import ALL_THE_TIME
from companion.estimation import (
    BestEstimate,
    between_samples,
    coning,
    hides_shaking,
    kind_of,
    times_of_change,
)
from companion.model import SensorInUse, longest_step, words

_OVERSHOOTS = 2.0  # times what misled it: a height that is off by more has another cause
_WITHIN_S = 5.0  # before an episode's onset a departure may seem to begin: steps are blurred
_SURELY = 2.0  # σ of its onset, by which an episode began in flight: a scale shows from where the vehicle moves on
_CERTAIN = 4.0  # σ of both together, from which on a departure is the autopilot's alone


def is_serious(episode: Episode) -> bool:
    """Whether an IMU's episode is a fault; a witness' is one where it misled the autopilot, which this does not say."""
    return episode.witness != "imu" or episode.magnitude >= kind_of(episode.kind).serious


def follows(departure: Departure, episode: Episode) -> bool:
    """Whether a departure may be the consequence of an episode."""
    if departure.start < episode.start - _WITHIN_S - SIGMAS * episode.start_sigma:
        return False
    if episode.kind in _OF_HEIGHT:
        most = _OVERSHOOTS * episode.magnitude + SIGMAS * departure.sigma
        return departure.quantity == "height" and departure.size < most
    return kind_of(episode.kind).side != "compass" or departure.quantity != "height"


def _cause_among(departure: Departure, all_episodes: tuple[Episode, ...]) -> Episode | None:
    """The first episode that a departure may follow; or one that begins with it and explains as much, or far more."""
    may = [episode for episode in all_episodes if follows(departure, episode)]
    if not may:
        return None
    first = may[0]

    def fits(one: Episode) -> bool:
        begins = abs(departure.start - one.start) <= _WITHIN_S + SIGMAS * one.start_sigma
        return one.gain > (1.0 if begins else _FAR_MORE) * first.gain

    return max(filter(fits, may), key=lambda one: one.gain, default=first)


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
    out: list[Finding] = []
    imu = best.imu.instance
    may = tuple(e for e in all_episodes if e.witness != "imu" or in_use is None or in_use.uses(imu, e.start, e.end))
    causes = [_cause_among(d, may) for d in departed]
    for episode in all_episodes:
        consequences = [d for d, cause in zip(departed, causes, strict=True) if cause is episode]
        harmed = bool(consequences)
        misleads = any(d.size >= _CERTAIN * d.sigma for d in consequences)
        severity: Severity = "warning" if harmed else "info"
        if misleads or (is_serious(episode) and (harmed or episode.witness == "imu")):
            severity = "error"
        if severity == "info" and not is_sized(episode, best):
            continue
        side: Side = "imu" if episode.witness == "imu" else "autopilot" if harmed else "data"
        why, would_tell = (_HARDLY_OFF, _ANOTHER) if severity == "warning" else ("", "")
        if severity == "error":
            why, would_tell = _why_undecided(episode, best, all_episodes)
        constant = severity == "error" and episode.start - _SURELY * episode.start_sigma <= times_of_change(best.t)[0]
        if constant:
            why, would_tell = ALL_THE_TIME, ""
        headline = words = said(episode, best)
        misled: tuple[str, ...] = ()
        if harmed:
            worst = {d.quantity: d for d in sorted(consequences, key=lambda d: d.size)}
            misled = tuple(str(d) for d in worst.values())
            words += f"; the autopilot {'would have been' if why else 'was'} misled by it: " + ", ".join(misled)
        if rival := rivals(episode):
            words += f" ({rival})"
        if why:
            side, severity, headline = "data", "warning", ""
            words = f"{'perhaps ' if would_tell else ''}{words}; {why}"
        end = min(episode.end, float(best.t[-1]))
        cause = None if why else cause_of(episode, best, side, misled)
        advice = would_tell or kind_of(episode.kind).advice
        out.append(Finding(episode.kind, side, severity, episode.start, end, words, advice, headline, cause,
                           bool(why) and (harmed or not constant)))  # fmt: skip
    own = [d for d, cause in zip(departed, causes, strict=True) if cause is None]
    by_imu = min((d.start for d in own if d.as_the_imu), default=np.inf)
    return out + [_own(d, best, by_imu, _steps(d, jumps)) for d in own]


_OF_HEIGHT = ("gps_height", "barometer")  # kinds that mislead nothing else
_TOGETHER_S, _HALF, _FAR_MORE = 2.0, 0.5, 20.0  # s; of the evidence; times the evidence
_AGAINST_ITSELF = ("gps_position", "gps_velocity")  # kinds that the GPS shows without an IMU
_FEWEST = 8  # samples
_BY_THE_IMU_ALONE, _BURSTS = ("gps_motion",), 3  # kinds that no other witness speaks against
_HARDLY_OFF = "that close to what both may be off by, it cannot be told which of them is wrong"
_CONTRADICTED = (
    "the IMU fits the other sensors only with far more noise than it shows: it cannot be told which of them is wrong"
)


def _is_left_of(episode: Episode, others: tuple[Episode, ...]) -> str | None:
    """The kind of an episode of another sensor of which this may be what it leaves; None where there is none.

    Two sensors that fail together are far less likely than one whose explanation leaves something: so what begins with
    this one and explains half as much, or more, is in doubt with it. What explains far more may leave something at any
    time of the flight; but a height leaves nothing to the other axes.
    """
    for other in others:
        apart = max(_TOGETHER_S, SIGMAS * float(np.hypot(episode.start_sigma, other.start_sigma)))
        together = abs(other.start - episode.start) < apart and other.gain > _HALF * episode.gain
        far_more = other.kind not in _OF_HEIGHT and other.gain > _FAR_MORE * episode.gain
        if other.witness != episode.witness and (together or far_more):
            return other.kind
    return None


def _while_shaken(episode: Episode, others: tuple[Episode, ...]) -> bool:
    """Whether what an IMU reads wrongly is there only while it scatters more: folded down, shaking reads like it."""
    apart = max(_TOGETHER_S, SIGMAS * episode.start_sigma)
    return episode.witness == "imu" and any(
        other.kind.endswith("_unrest") and other.start - apart < episode.start and episode.end <= other.end + apart
        for other in others
    )


def _may_be_coning(episode: Episode, size: float, best: BestEstimate) -> bool:
    """Whether a gyro reads no more too much than its shaking adds up to, of which a low-pass may hide any part."""
    return (
        episode.kind == "gyro_bias"
        and hides_shaking(best.imu)
        and size < float(np.linalg.norm(coning(best.imu, episode.start, episode.end)))
    )


def _may_be_folded(episode: Episode, best: BestEstimate) -> bool:
    """Whether what an IMU reads wrongly is no more than what scatters between its samples while it is there adds up to.

    As where a launch or a violent manoeuvre shakes it, which its samples fold down: as white noise of that size would.
    """
    sensor, _, what = episode.kind.partition("_")
    part = best.imu[slice(*np.searchsorted(best.imu.t, (episode.start, episode.end)).tolist())]
    if what not in ("bias", "scale") or len(part) < _FEWEST:
        return False
    read = getattr(part, sensor)
    variance = np.maximum(between_samples(read) ** 2, 1e-300)
    scaled = np.maximum((read**2).mean(axis=0) - variance, 0.0) if what == "scale" else np.ones(3)
    return float((episode.size**2 * scaled / variance).sum()) * len(part) < SIGMAS**2


def _may_be_a_shock(episode: Episode, others: tuple[Episode, ...]) -> bool:
    """Whether a moment that the IMU missed explains it nearly as well, or what it begins with.

    After a second or two a launch or a touchdown that was sampled too slowly looks like a fault that has come to stay.
    How seldom such a moment is does not count against it: at those times it is not.
    """

    def shock(one: Episode) -> bool:
        sensor, _, what = one.kind.partition("_")
        if what not in ("bias", "scale"):
            return False
        missed = kind_of(f"{sensor}_shock")
        return one.gain - gain_of(one, missed.name) - missed.rarity < 2.0 * FAR

    apart = _TOGETHER_S + SIGMAS * episode.start_sigma
    begun = (one for one in others if one.kind.split("_")[0] == episode.kind.split("_")[0])
    return any(shock(one) for one in begun if -apart < episode.start - one.start < apart + SIGMAS * one.start_sigma)


def _began_unheard(episode: Episode, best: BestEstimate) -> bool:
    """Whether a motion that an IMU should have felt may have begun while it was not heard."""
    t, sure = best.imu.t, SIGMAS * episode.start_sigma
    gap = np.diff(t) > longest_step(best.imu.t)
    begun = (t[:-1] < episode.start + sure) & (t[1:] > episode.start - sure)
    return episode.kind in _BY_THE_IMU_ALONE and bool((gap & begun).any())


_ANOTHER = "A second sensor of the same kind in the log would tell, another IMU before all."
_FASTER = "An IMU that is better damped, logged faster than it shakes, or a second one would tell."
_WHOLE = "A log without gaps, as the one on board may be, would tell."
_CUTOFF = "The cutoff of the gyro's low-pass, a parameter of the vehicle, in the log would tell."
_HEADING = "GPS while the vehicle moves, a second IMU or a second compass in the log would tell."


def _creeps_in_order(kind: str, size: float, sigma: float) -> bool:
    """Whether what goes off slowly may go no further than that of a sensor in order."""
    return size < kind_of(kind).least_slow + SIGMAS * sigma


def _why_undecided(episode: Episode, best: BestEstimate, others: tuple[Episode, ...]) -> tuple[str, str]:
    """Why an episode that looks like a fault accuses nobody, empty where it does; and what would tell.

    The latter is empty where what to do against the episode itself is all there is to say.
    """
    noisy, (size, sigma, _) = best.contradicted, size_told(episode, best)
    other = _is_left_of(episode, others)
    rival = rival_of_another(episode, FAR if noisy else CLOSE)
    passing_gyro = episode.kind.startswith("gyro") and np.isfinite(episode.end)
    # GPS and gravity tell of a scale about any axis but the vertical
    alone = episode.kind == "gyro_scale" and axis_of(episode) != "z"
    by_the_compass = not episode.seconded and (passing_gyro or alone)
    gyro_or_compass = episode.witness == "compass" and gain_of(episode, "gyro") > _HALF * episode.gain
    reasons = (
        (episode.kind.endswith("_unrest"), "shaking does this: no sensor is blamed for its noise", ""),
        (episode.kind.endswith("_shock"),
         "a shock, strong vibration or lost samples do this too: no sensor is blamed for a single moment", ""),
        (_while_shaken(episode, others),
         "it is there only while the IMU scatters more: shaking that its samples fold down reads like it", _FASTER),
        (_may_be_coning(episode, size, best),
         "the gyro is shaken so much that what its low-pass hides of the shaking may add up to it", _CUTOFF),
        (_may_be_a_shock(episode, others),
         "but for how seldom that is, a moment that the IMU missed explains it as well: no sensor is blamed for one",
         _FASTER),
        (_may_be_folded(episode, best),
         "the IMU is shaken so much while it is there that its samples may fold down as much", _FASTER),
        (size < SIGMAS * sigma, "its size is hardly more than its σ", _FASTER),
        (other is not None,
         f"{_named(other)} explains as much at that time, or far more: one may be what the other leaves", _ANOTHER),
        (episode.kind in _BY_THE_IMU_ALONE and best.bursts >= _BURSTS,
         "the IMU is shaken in bursts that look the same: it cannot be told which of them is wrong", _FASTER),
        (episode.slow and _creeps_in_order(episode.kind, size, sigma),
         f"a {words(episode.witness)} in order creeps as far", _RECEIVER),
        (_began_unheard(episode, best),
         "the IMU was not heard when it began: whether it felt that motion cannot be told", _WHOLE),
        (by_the_compass, "only the compass speaks against the gyro: it cannot be told which of the two is wrong",
         _HEADING),
        (gyro_or_compass and "gps_position" not in best.residuals,
         "without GPS only the gyro speaks against the compass: it cannot be told which of the two is wrong", _HEADING),
        (noisy and episode.witness != "imu" and episode.kind not in _AGAINST_ITSELF, _CONTRADICTED, _FASTER),
        (rival is not None, f"{_named(rival)} explains it nearly as well: it cannot be told which of them is wrong",
         _ANOTHER),
    )  # fmt: skip
    return next(((why, tells) for applies, why, tells in reasons if applies), ("", ""))


def _named(kind: str | None) -> str:
    return words(kind or "")


_WITNESS = "GPS while the vehicle moves, or a second IMU, in the log would tell."
_RECEIVER = "A second GPS receiver in the log would tell."
_EARLIER = "A log that begins earlier would tell."


_MEASURED = ("position", "height")  # by GPS and barometer, whatever a gyro, an accelerometer or a compass reads


def _why_unsure(departure: Departure, best: BestEstimate, by_imu: float) -> tuple[str, str]:
    """Why a departure does not accuse the autopilot, empty where it does; and what would tell."""
    promising = (sensor for kind in best.promising if (sensor := SENSORS.get(kind.split("_")[0])))
    sensor = None if departure.quantity in _MEASURED else next(promising, None)
    slowly_off = departure.quantity == "position" and not departure.sudden
    reasons = (
        ("gps_position" not in best.residuals, "without GPS it cannot be told which of them is wrong", _WITNESS),
        (slowly_off and _creeps_in_order("gps_position", departure.size, departure.sigma),
         "a GPS in order creeps as far: it cannot be told which of them is wrong", _RECEIVER),
        (best.contradicted, _CONTRADICTED, _FASTER),
        (departure.recovers, "it was so when this began, and the estimate recovers: what led to it lies before",
         _EARLIER),
        (departure.start >= by_imu, "the IMU moved as the autopilot says: it cannot be told which of them is wrong",
         _ANOTHER),
        (sensor is not None,
         f"a fault of the {sensor} explains it nearly as well: it cannot be told which of them is wrong", _ANOTHER),
        (departure.size < _CERTAIN * departure.sigma, _HARDLY_OFF, _ANOTHER),
    )  # fmt: skip
    return next(((why, tells) for applies, why, tells in reasons if applies), ("", ""))


_STEPS = {"heading": "heading_jump", "position": "position_jump"}
_NEAR_S, _BLURRED_S = 5.0, 20.0  # a departure may be noticed so long after it began


def _steps(departure: Departure, jumps: Sequence[Finding]) -> bool:
    """Whether a departure begins with a jump of the autopilot's own: it is its own then, however uncertain its size.

    Of a position only where it is itself a step: between two lanes an estimate may jump there and back.
    """
    if departure.quantity == "position" and not departure.sudden:
        return False
    own = [one for one in jumps if one.kind == _STEPS.get(departure.quantity) and one.severity == "error"]
    return any(-_BLURRED_S < one.start_s - departure.start < _NEAR_S for one in own)


def _own(departure: Departure, best: BestEstimate, by_imu: float, steps: bool) -> Finding:
    """A departure that nothing explains: the sensors agree with one another, and the estimate does not with them.

    by_imu: s, when the first one began in which the IMU sides with the autopilot. steps: whether it begins with a jump.

    But for these, without GPS, where a fault of a sensor explains it nearly as well, or where it is not far beyond what
    both may be off by, it is said and accuses nobody.
    """
    led = best.contradicted or departure.start >= by_imu  # an estimator jumps too to be rid of what an IMU led it to
    why, would_tell = ("", "") if steps and not led else _why_unsure(departure, best, by_imu)
    unsure = bool(why)
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
        cause=None if unsure else departure.cause,
        undecided=unsure,
    )  # fmt: skip
