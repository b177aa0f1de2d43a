"""Which of the two is wrong: the sentence above everything that the analysis says about one IMU of a flight.

Also here: faults that would do harm and that a flight is too short, too calm or too noisy to show; and what is said of
a vehicle at one moment while it is listened to: the verdict now, how old it is, and all alarms.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal

from companion.comparison import Agreement, left_out
from companion.constants import check, num, priors
from companion.estimation import BestEstimate, hypothesis_of
from companion.model import brief, counted
from companion.verdict.fault_interval import BIAS_UNITS, SENSOR_WORDS, percent
from companion.verdict.finding import Cause, Finding, by_severity, leading_doubt

Status = Literal["consistent", "imu_suspect", "autopilot_suspect", "insufficient_data"]

_CONSTANT = ("gyro_bias", "gyro_scale", "accel_bias", "accel_scale")  # that may have been there all the time


@dataclass(frozen=True, slots=True)
class FlightVerdict:
    """The answer for one flight of several in a log."""

    start_s: float  # boot clock
    end_s: float
    status: Status
    summary: str
    cause: Cause | None = None


@dataclass(frozen=True, slots=True)
class Verdict:
    """The answer."""

    __repr__ = brief

    status: Status
    summary: str
    findings: tuple[Finding, ...]
    cause: Cause | None = None  # the first cause in time, that the summary is about; None where nobody is suspect
    probability: Mapping[str, float] = field(default_factory=dict)  # see `fault_probability`; empty if none tells
    flights: tuple[FlightVerdict, ...] = ()  # each by itself, where the log holds several

    @property
    def likeliest(self) -> tuple[tuple[str, float], ...]:
        """The two likeliest sides with their probabilities; empty where one is sure, or none is known."""
        sides = sorted(self.probability.items(), key=lambda pair: -pair[1])[:2]
        return tuple(sides) if sides and sides[0][1] < priors.ACCUSED else ()


def decide(
    agreements: Sequence[Agreement],
    findings: tuple[Finding, ...],
    best: BestEstimate | None,
    source: str,
    probability: Mapping[str, float] = MappingProxyType({}),
    by_flight: Mapping[tuple[float, float], Sequence[Agreement]] = MappingProxyType({}),
) -> Verdict:
    """The first cause in time; without one, whether IMU and autopilot agree, as far as the flight can tell.

    agreements: one for each horizon of AGREEING_S. source: the message of the IMU that the windows are of. probability:
    see `fault_probability`. by_flight: agreements of each flight of the log, from when to when it was, s, where there
    are several.
    """
    shares = _with_autopilot(probability, findings)
    whole = _as_sure(_decided(agreements, findings, best, source, probability), shares)
    probability = _with_readings(shares, whole.cause)
    unexplained = leading_doubt(whole.findings) is None and any(one.parted is not None for one in agreements)
    if whole.status == "insufficient_data" and (unexplained or (best is not None and best.contradicted)):
        probability = {}  # they are of a model that does not hold
    flights = []
    for (start, end), own in by_flight.items():
        during = tuple(f for f in whole.findings if f.start_s <= end and f.end_s > start)
        one = _decided(own, during, best, source, {})
        flights.append(FlightVerdict(start, end, one.status, one.summary, one.cause))
    return replace(whole, probability=probability, flights=tuple(flights))


def decide_without_imu(findings: tuple[Finding, ...], agreement: str, why: str) -> Verdict:
    """The autopilot's own errors, else what cannot be told.

    agreement: what is to be said where nothing was found; why: no IMU is judged, in a sentence or two.
    """
    unjudged = f"The IMU was not judged: {why}"
    if causes := sorted((f for f in findings if f.severity == "error"), key=lambda f: f.start_s):
        first = _first(causes)
        summary = f"Suspect the autopilot's estimate: {headline_of(first)}. {unjudged}"
        return Verdict("autopilot_suspect", summary, findings, stated_cause(first))
    doubt = leading_doubt(findings)
    told = agreement if doubt is None else doubt.evidence
    return Verdict("insufficient_data", f"Cannot tell: {told}. {unjudged}", findings)


def _with_autopilot(probability: Mapping[str, float], findings: Sequence[Finding]) -> Mapping[str, float]:
    """Beside the sensors the autopilot: that its estimate is in error by itself, where no sensor is known to be.

    Where nothing tells it from a fault of the IMU, that takes its own share of what is left for nobody.
    """
    if not probability:
        return probability
    shares = {**probability, "autopilot": 0.0}
    off = (f.cause for f in findings if f.cause is not None and (f.severity == "error" or f.side == "data"))
    for own in (cause for cause in off if cause.side == "autopilot" and not cause.sensor):
        sure, imu = (1.0, 0.0) if own.probability is None else (own.probability, own.rival_probability or 0.0)
        nobody = shares["nobody"]
        parts = {"autopilot": nobody * sure, "imu": nobody * imu, "nobody": -nobody * (sure + imu)}
        shares |= {side: shares[side] + part for side, part in parts.items()}
    return shares


WHOSE = {"imu": "the IMU", "autopilot": "the autopilot's estimate", "nobody": "no fault"}
SUSPECT: Mapping[str, Status] = {"imu": "imu_suspect", "autopilot": "autopilot_suspect"}


def _as_sure(verdict: Verdict, shares: Mapping[str, float]) -> Verdict:
    """The verdict; where the estimator has less than 95 % of all shares, whose own error it is, that it cannot be told.

    A sensor's fault has been weighed against its rivals before.
    """
    cause = verdict.cause
    if not shares or cause is None or cause.probability is None or cause.sensor:
        return verdict
    sides = {"imu": shares["imu"], "nobody": shares["nobody"]}
    sides["autopilot"] = sum(share for device, share in shares.items() if device not in sides)
    own, other = cause.side, max(sides.keys() - {cause.side}, key=lambda side: sides[side])
    if sides[own] >= priors.ACCUSED:
        return verdict
    two = f"{WHOSE[own]} from {WHOSE[other]} ({percent(sides[own])} / {percent(sides[other])})"
    errors = [f for f in verdict.findings if f.severity == "error" and f.side == own]
    first = headline_of(next(f for f in errors if stated_cause(f) == cause))
    doubted = (replace(f, side="data", severity="warning", undecided=True, cause=None) for f in errors)
    findings = by_severity((*doubted, *(f for f in verdict.findings if f not in errors)))
    return Verdict("insufficient_data", f"Cannot tell {two}: {first}.", findings)


def _with_readings(probability: Mapping[str, float], cause: Cause | None) -> Mapping[str, float]:
    """The same where it is the readings themselves that accuse an IMU, as no estimate does: all but a false alarm."""
    if not probability or cause is None or cause.side != "imu" or cause.probability is not None:
        return probability
    shares = {side: share * priors.FALSE_ALARM for side, share in probability.items()}
    return {**shares, "imu": shares["imu"] + 1.0 - priors.FALSE_ALARM}


def _decided(
    agreements: Sequence[Agreement],
    findings: tuple[Finding, ...],
    best: BestEstimate | None,
    source: str,
    probability: Mapping[str, float],
) -> Verdict:
    causes = sorted((f for f in findings if f.severity == "error" and f.side != "data"), key=lambda f: f.start_s)
    lost = [f for f in findings if f.kind == "control_lost"]
    judged = agreements[0]
    slow = next((f.evidence for f in findings if f.kind == "rate_too_low"), "")
    why_no_windows = slow or too_few_windows(judged)
    why_too_little = "" if causes or not why_no_windows else unseen(best, why_no_windows)
    if lost and slow and not causes:  # what misled the autopilot within the last second has hardly a sample
        why_too_little = why_too_little or f"{slow} to show what begins within a second of the loss"
    if (lacking := _lacking(findings, lost, bool(causes), why_too_little)) is not None:
        return Verdict("insufficient_data", lacking, findings)
    enough = [one for one in agreements if one.windows >= (num.MIN_WINDOWS if one is judged else num.MANY_WINDOWS)]
    worst = min(enough, key=lambda one: (one.parted is None, one.share), default=None)
    if causes:
        first = _first(causes)
        cause = stated_cause(first)
        summary = f"Suspect {WHOSE[first.side]}: {headline_of(first)}{_how_sure(cause)}.{_then(cause, lost)}"
        if judged.share == 1.0:  # what goes off slowly, or on an IMU not in use, shows beside the other sensors alone
            summary += f" {source} and the autopilot nevertheless agree: {judged}."
        return Verdict(SUSPECT[first.side], summary, findings, cause)
    if (doubt := _doubt(worst, findings, best, probability.get("imu", 0.0))) is not None:
        return Verdict("insufficient_data", f"Cannot tell: {doubt}.{_fall(lost)}", findings)
    fallen = f"{_fall(lost)[1:-1]}; " if lost else ""
    who = "the sensors" if lost and best is not None else "IMU and autopilot"
    how = str(worst)
    if why_no_windows:
        shown = "" if best is None else " or ".join(_would_show(best).values())
        how = f"by the best estimate: {why_no_windows}, but {shown} would have shown"
    summary = f"{fallen}{who} agree within the expected error ({how}{_likeliest(probability)})."
    if best is not None and probability and not why_no_windows:  # once: of all flights of a log together
        summary += _not_excluded(best)
    if best is not None and "gps_position" not in best.residuals:  # both may have it wrong together
        summary += " No GPS data: the position could not be verified."
    return Verdict("consistent", summary, findings)


def _how_sure(cause: Cause) -> str:
    """The probability that accuses, and that of the one sensor where it alone would not."""
    if cause.side_probability is None or cause.probability is None:
        return ""
    own = "" if cause.probability >= priors.ACCUSED else f"; {cause.sensor}: {percent(cause.probability)}"
    return f" (probability {percent(cause.side_probability)}{own})"


def _fall(lost: Sequence[Finding]) -> str:
    """That control was lost, as a sentence of its own; "" where it was not."""
    if not lost:
        return ""
    again = f", {len(lost)} times in all" if len(lost) > 1 else ""
    return f" {lost[0].headline[:1].upper()}{lost[0].headline[1:]}{again}."


def _then(cause: Cause, lost: Sequence[Finding]) -> str:
    """That control was lost after a cause began, and how long after where it began in flight; "" where it was not."""
    after = next((one for one in lost if one.start_s >= cause.onset_s), None)
    if after is None or (cause.onset_sigma_s is None and cause.end_s is None):  # it was there from the start
        return "" if after is None else _fall([after])
    return f"{_fall([after])[:-1]}, {after.start_s - cause.onset_s:.1f} s after it began."


def _likeliest(probability: Mapping[str, float]) -> str:
    """The probability that no sensor has a fault; of an aiding sensor that has one, which misled nobody."""
    if not probability:
        return ""
    whose, share = max(probability.items(), key=lambda pair: pair[1])
    name = {"gps": "GPS", "imu": "IMU"}.get(whose, whose)
    what = "no sensor fault" if whose == "nobody" else f"a fault of the {name}, which misled nobody"
    return f"; {what}: {percent(share)}"


def _not_excluded(best: BestEstimate) -> str:
    """Harmful faults of the IMU that are too small for this flight to show: "a gyro bias of 5.0-5.9 mrad/s"; or "".

    Those of GPS and compass only mislead where the autopilot follows them, and then it deviates from the best estimate.
    """
    ranges = []
    for sensor, (unit, scale, decimals) in BIAS_UNITS.items():
        harms = hypothesis_of(f"{sensor}_bias").harmful("step")
        shown = best.detectable.get(f"{sensor}_bias", harms)
        low, high = (f"{size * scale:.{decimals}f}" for size in (harms, shown))
        if high != low:
            ranges.append(f"{'an' if sensor == 'accel' else 'a'} {SENSOR_WORDS[sensor]} bias of {low}-{high} {unit}")
    return f" Not excluded: {' or '.join(ranges)}." if ranges else ""


def _lacking(
    findings: tuple[Finding, ...], lost: Sequence[Finding], has_cause: bool, why_too_little: str
) -> str | None:
    """Why nothing can be judged; None where it can. why_too_little: why windows and estimate do not tell, or ""."""
    if not has_cause and (misled := next((f for f in lost if f.undecided), None)):
        return f"Loss of control: {misled.evidence}. No sensor fault was found before that."
    if data := next((f.evidence for f in findings if f.side == "data" and f.severity == "error"), ""):
        return f"Cannot tell: {data}."
    if not why_too_little:
        return None
    doubt = leading_doubt(findings)
    undecided = "" if doubt is None else f"{doubt.evidence}; "
    begun = f"{_fall(lost)[1:]} No sensor fault was found, but" if lost and not undecided else "Cannot tell:"
    return f"{begun} {undecided}{why_too_little}."


def _doubt(worst: Agreement | None, findings: tuple[Finding, ...], best: BestEstimate | None, imu: float) -> str | None:
    """What speaks against agreement: what cannot be told, or what nothing explains; None where nothing does.

    imu: the probability that one is at fault: what harmed nothing yet, or is not known well enough.
    """
    if (doubt := leading_doubt(findings)) is not None:
        return doubt.evidence
    if worst is None or worst.is_consistent:
        return f"an IMU is at fault with a probability of {percent(imu)}" if imu > 1.0 - priors.ACCUSED else None
    why = "no single cause explains it"
    if best is None:
        why = "no independent sensor (GPS, compass) tells which is wrong"
    elif explained := next((f.evidence for f in findings if f.severity == "warning" and f.kind in _CONSTANT), ""):
        why = explained
    if (part := worst.parted) is not None:
        row = f"{part.windows} windows of {worst.horizon_s:g} s in a row"
        span = f"from {part.start_s:.1f} to {part.end_s:.1f} s ({row})"
        return f"IMU and autopilot differ in {part.quantity} by far more than expected {span}, and {why}"
    quantity = min(worst.inside, key=lambda name: worst.inside[name])
    return f"IMU and autopilot differ in {quantity} by more than expected (only {worst}), and {why}"


def _first(causes: Sequence[Finding]) -> Finding:
    """The first cause in time; of one sensor's that may have begun together, that whose beginning is known best.

    causes: in order of time. The other then takes up what the model of this one leaves.
    """
    first = stated_cause(causes[0])
    if not first.sensor or not first.onset_sigma_s:
        return causes[0]
    latest = first.onset_s + num.SIGMAS * first.onset_sigma_s
    together = [f for f in causes if f.start_s <= latest and stated_cause(f).sensor == first.sensor]
    return min(together, key=lambda f: stated_cause(f).onset_sigma_s or 0.0)


def headline_of(finding: Finding) -> str:
    """What is wrong and when, without the rivals and consequences that stand in the finding."""
    if finding.headline and finding.cause is not None:
        return finding.headline  # has its time, with how sure it is
    start, end = f"{finding.start_s:.1f}", f"{finding.end_s:.1f}"
    return f"{finding.headline or finding.evidence}, {f'at {start}' if start == end else f'from {start} to {end}'} s"


def stated_cause(finding: Finding) -> Cause:
    """What is wrong, in numbers; without a size where the finding has none."""
    return finding.cause or Cause(finding.kind, finding.side, finding.start_s, finding.end_s)


Band = tuple[tuple[float, float, float, float], ...]
"""Time since an anchor, s, and 1σ of what the error is expected to be then: attitude °, velocity m/s, position m."""

State = Literal[Status, "starting", "lost", "stale", ""]
"""A verdict; the estimator aligns or a flight has just begun; control was lost; the data are old; nothing yet."""


@dataclass(frozen=True, slots=True)
class Alarm:
    """A time in which somebody was suspect."""

    status: State
    text: str  # as it was said last, when most was known
    first: float  # s UNIX, of the newest data when it was said first
    last: float  # ... and last
    when: str = ""  # the same in words, by the clock of the computer


@dataclass(frozen=True, slots=True)
class LiveVerdict:
    """What is to be said at one moment. All text is untrusted."""

    status: State  # when its data were new
    text: str
    newest: float = 0.0  # s UNIX, when the newest data that it rests on arrived; 0: it rests on none
    vehicle: str = ""
    alarms: tuple[Alarm, ...] = ()  # since the session began; the newest last
    expected: Band = ()  # empty where it cannot be said
    was_consistent: bool = False  # whether it ever was, since then
    age_s: float = 0.0  # of its data, when it is read
    silent: bool = False  # whether nothing comes on the link then
    cause: Cause | None = None  # of an alarm

    @property
    def is_alarm(self) -> bool:
        """Whether somebody was suspect, when its data were new."""
        return self.status in SUSPECT.values()

    @property
    def is_stale(self) -> bool:
        """Whether it says nothing of now."""
        return bool(self.newest) and (self.silent or self.age_s > check.STALE_S)

    @property
    def now(self) -> tuple[State, str]:
        """The state that holds now, and why: one of old data says as of when it held.

        Nothing has taken an alarm back while the next verdict is waited for: it stays one, unless the link is silent.
        """
        if not self.is_stale:
            return self.status, self.text
        state: State = self.status if self.is_alarm and not self.silent else "stale"
        return state, f"as of {self.age_s:.0f} s ago: {self.text}"

    @property
    def so_far(self) -> tuple[State, str]:
        """The verdict on the session up to now, and why: the first alarm, and what was after it."""
        if not self.alarms:
            return ("consistent", "no alarm so far") if self.was_consistent else ("", "nothing is known yet")
        lines = [f"{a.when}: {a.text}" for a in self.alarms]
        more = f" ({len(lines) - 2} more)" if len(lines) > 2 else ""
        return self.alarms[0].status, "; ".join(dict.fromkeys([lines[0], lines[-1]])) + more


def unseen(best: BestEstimate | None, why_no_windows: str) -> str:
    """Why the best estimate does not speak for windows that there are not; "" where it does.

    Where each fault of the size that such faults have would show in it.
    """
    if best is None or "gyro_bias" not in best.detectable:
        return why_no_windows
    shown = _would_show(best).items()
    hidden = [words for kind, words in shown if best.detectable[kind] > hypothesis_of(kind).prior]
    return f"{why_no_windows}; no fault was found, but {' and '.join(hidden)} would not have shown" if hidden else ""


def _would_show(best: BestEstimate) -> dict[str, str]:
    """Bias of a sensor of the IMU → the smallest that would have shown, in words."""
    shown = {}
    for sensor, (unit, scale, decimals) in BIAS_UNITS.items():
        kind, shown_as = f"{sensor}_bias", f"bias of the {SENSOR_WORDS[sensor]}"
        if (size := best.detectable.get(kind)) is not None:
            is_any = size > check.ANY_BIAS * hypothesis_of(kind).prior
            shown[kind] = f"any {shown_as}" if is_any else f"a {shown_as} of {scale * size:.{decimals}f} {unit}"
    return shown


def too_few_windows(judged: Agreement) -> str:
    """Why there are too few windows to be judged; "" where there are enough."""
    if judged.windows >= num.MIN_WINDOWS:
        return ""
    reasons = left_out(judged.excluded)
    short = f"the flight is too short: at least {num.MIN_WINDOWS * num.JUDGED_S:g} s are needed"
    usable = f"only {counted(judged.windows, 'window')}" if judged.windows else "no window"
    return f"{usable} of {num.JUDGED_S:g} s can be used ({f'left out: {reasons}' if reasons else short})"
