"""One IMU of a flight: everything that the analysis says about it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from companion.comparison import (
    DEFAULT,
    NO_CORRECTION,
    Agreement,
    Calibration,
    Comparison,
    Correction,
    Drift,
    Expected,
    FlightDensity,
    ImuSpec,
    Integration,
    ReferenceSpec,
    Rest,
    SensorSpec,
    Windows,
    agreement,
    aligned_at,
    between,
    calibrate,
    compare,
    controlled,
    drift_over,
    expected_over,
    flown,
    in_control,
    known_from,
    landed_at,
    noise_in_flight,
    phases,
    rests,
    unjudged,
    while_judged,
    windows,
)
from companion.constants import check, healthy, num
from companion.estimation import (
    CONSTANTS,
    BestEstimate,
    ConstantErrors,
    Effort,
    hypothesis_of,
    other_reading,
    smooth,
    without_errors,
)
from companion.model import Array, Flight, ImuTrack, NoEstimateError, brief
from companion.noise import chi_square, restored
from companion.verdict.attribution import fault_probability
from companion.verdict.constant_faults import beside_best, constant_fault_probability, level_is_unusual, read_wrongly
from companion.verdict.deviations import AutopilotBias, Sensitivity, autopilot_bias, is_judged, sensitivity
from companion.verdict.finding import Finding
from companion.verdict.findings.aiding import screened_aiding
from companion.verdict.findings.axes import misread_finding, righted_compasses, turned_others
from companion.verdict.findings.detect import findings, reading_faults, when_lost
from companion.verdict.findings.stuck import any_stands_still, missed_findings
from companion.verdict.rest_to_rest import changed_at_rest
from companion.verdict.verdict import Verdict, decide


@dataclass(frozen=True, eq=False)
class Assessment:
    """One IMU of a flight: drift, what it should be, calibration, verdict."""

    __repr__ = brief

    comparison: Comparison  # of the IMU, corrected if that was asked for
    judged: Comparison  # the same without what was measured out of control
    horizons: tuple[float, ...]  # s, one for each row of the drift
    imu_spec: ImuSpec
    autopilot: ReferenceSpec
    measured_noise: FlightDensity
    rests: tuple[Rest, ...]  # where the vehicle stood still
    autopilot_bias: AutopilotBias | None  # the gyro bias that the autopilot believes in
    agreements: Mapping[float, Agreement]  # horizon, s → the windows as the verdict judges them
    verdict: Verdict
    best: BestEstimate | None  # a third opinion; None where the flight allows none
    sensitivity: Sensitivity  # what the flight could have shown

    @cached_property
    def sets(self) -> tuple[Windows, ...]:
        """The windows of each row of the drift."""
        return tuple(windows(self.comparison, horizon) for horizon in self.horizons)

    @cached_property
    def drift(self) -> Drift:
        """How far the dead reckoning ends from the autopilot."""
        return drift_over(self.comparison, self.sets)

    @cached_property
    def expected(self) -> tuple[Expected | None, ...]:
        """What is allowed of each row of the drift; None without windows."""
        return tuple(self.expected_of(row) for row in range(len(self.sets)))

    def expected_of(self, row: int) -> Expected | None:
        """What is allowed of one row of the drift alone: of an hour each takes tenths of a second."""
        return expected_over(self.comparison, self.sets[row], self.imu_spec, self.autopilot)

    @property
    def calibration(self) -> Calibration | None:
        """What the flight says of the IMU's errors."""
        return self._fitted[0]

    @cached_property
    def uncorrected(self) -> Drift | None:
        """The drift in the second half of the flight; None where a half has too few windows."""
        return None if self._fitted[1] is None else drift_over(self.judged, [self._second_half(self.judged)])

    @cached_property
    def corrected(self) -> Drift | None:
        """The same windows with the calibration of the first half."""
        own, part = self.judged, self._fitted[1]
        if part is None:
            return None
        corrected = own.of(part.correction.apply(own.track))
        return drift_over(corrected, [self._second_half(corrected)])

    @property
    def made_worse(self) -> bool:
        """Whether the calibration spoils windows that it was not fitted to: the errors are not constant.

        Twice as far off, and further than what the autopilot itself may be off at the two ends of a window.
        """
        if self.uncorrected is None or self.corrected is None:
            return False
        first, then, ends = self.uncorrected.rows[0], self.corrected.rows[0], np.sqrt(2.0 * 3.0)  # of three axes
        turned = first.attitude_deg, then.attitude_deg, np.degrees(self.autopilot.attitude_noise) * ends
        moved = first.position_m, then.position_m, self.autopilot.position * ends
        pairs = ((b, a, least) for b, a, least in (turned, moved) if b is not None and a is not None)
        return any(a.median > max(2 * b.median, least) for b, a, least in pairs)

    @cached_property
    def judged_by_best(self) -> tuple[Drift, Drift] | None:
        """The drift of the same windows against the best estimate, without and with what is taken off as the IMU's.

        Mounting and lag are the autopilot's, and are left alone. None without a best estimate.
        """
        own, part, best = self.judged, self._fitted[1], self._third
        if part is None or best is None:
            return None
        of_imu = replace(part.correction, mounting=np.zeros(3), time_offset=0.0, lever_arm=np.zeros(3))
        beside, chosen = beside_best(own, best, self._second_half(own))
        return drift_over(beside, [chosen]), drift_over(beside.of(of_imu.apply(own.track)), [chosen])

    @cached_property
    def _fitted(self) -> tuple[Calibration | None, Calibration | None]:
        """The calibration, and that of the first half; None where a half has too few windows."""
        own, best = self.judged, self._third
        if len(windows(own, num.JUDGED_S).start) < num.MIN_WINDOWS:
            return None, None

        def fitted(errors: ConstantErrors | None, until: float = np.inf) -> Calibration | None:
            known = None if errors is None else known_from(errors, self.imu_spec, own.track)
            return calibrate(own, self.imu_spec, self.autopilot, horizon=num.JUDGED_S, until=until, known=known)

        try:
            kinds = [] if best is None else [hypothesis_of(one.kind) for one in best.explained]
            # of what lasts for a while there is no constant one of the whole flight
            steady = not any(kind.device == "imu" and not kind.nuisance for kind in kinds)
            whole = fitted(best.errors if best and steady else None)
            part = fitted(best.first_half[1] if best and steady else None, self._middle)
        except np.linalg.LinAlgError:  # the flight does not determine what is asked of it
            return None, None
        if part is None or min(part.windows, len(self._second_half(own).start)) < num.MIN_WINDOWS:
            return whole, None
        return whole, part

    def _second_half(self, comparison: Comparison) -> Windows:
        chosen = windows(comparison, num.JUDGED_S)
        return chosen.only(comparison.track.t[chosen.start] >= self._middle)

    @property
    def _middle(self) -> float:
        """Of the flight, s, boot clock."""
        t = self.judged.track.t
        return float(0.5 * (t[0] + t[-1])) if self._third is None else self._third.first_half[0]

    @property
    def _third(self) -> BestEstimate | None:
        """The best estimate, where anything but the IMU told it of the vehicle's turns."""
        return _independent(self.best)


def assess(
    flight: Flight,
    imu_spec: ImuSpec,
    *,
    autopilot: ReferenceSpec | None = None,
    horizons: Sequence[float] = num.HORIZONS_S,
    imu: str | None = None,
    how: Integration = DEFAULT,
    correction: Correction = NO_CORRECTION,
    before: BestEstimate | None = None,
    confusion: bool = False,
    effort: Effort = Effort(),  # noqa: B008  (frozen)
) -> Assessment:
    """Everything about one IMU of a flight. Raises as `drift` does; before, confusion, effort: as `smooth`."""
    autopilot, parts = autopilot or ReferenceSpec(), phases(flight)
    track = correction.apply(flight.imu(imu))
    seen, comparison = controlled(flight, parts, track.source), compare(flight, track=track, how=how)
    own = replace(seen, imus={**seen.imus, track.source: correction.apply(seen.imu(track.source))})
    judged = comparison if seen is flight else compare(own, imu=track.source, how=how)
    noise = noise_in_flight(seen, judged.track, imu_spec, how.limits)
    chosen = windows(judged, num.JUDGED_S)
    allowed = expected_over(judged, chosen, imu_spec, autopilot)
    faults = [f for f in reading_faults(seen, judged, imu_spec) if f.end_s > aligned_at(parts)]
    own, frozen = screened_aiding(own, judged.track)
    enough = len(while_judged(chosen, judged.track.t, parts).start) >= num.MIN_WINDOWS
    differ = enough and allowed is not None and not Agreement(num.JUDGED_S, 0, {}, allowed.inside).is_consistent
    estimate = partial(smooth, confusion=confusion, effort=effort)
    made, more = _best(own, judged, faults, unjudged(parts), before, estimate, differ, effort)
    best = made if isinstance(made, BestEstimate) else None
    turned = turned_others(seen, judged.track, faults := [*faults, *more, *frozen], best)
    constants = read_wrongly(best, seen, how.gravity, [*faults, *turned])
    all_findings, clean = findings(flight, judged, allowed, imu_spec, noise, autopilot, faults, best, constants, turned)
    resting = [*changed_at_rest(seen, best, faults)]
    all_findings = when_lost([*all_findings, *resting], flight, track, parts, imu_spec)
    third = _independent(best)
    usual = imu_spec if third is None else in_flight(imu_spec, third)
    corrected = judged.of(clean if third is None else restored(_unbiased(clean, third, flight), judged.gaps))
    lengths, several = dict.fromkeys((*num.AGREEING_S, *horizons)), flown(parts)
    agreed = partial(agreement, corrected, judged, parts=parts, usual=usual, autopilot=autopilot)
    agreements = {one: agreed(one, within=in_control(parts)) for one in lengths}
    by_flight = {span: [agreed(one, within=[span]) for one in num.AGREEING_S] for span in several if len(several) > 1}
    # by itself it says nothing of an autopilot that is silent
    beside = third if third is None or enough or is_judged(flight, third, how.limits) else None
    by_side: dict[str, float] = {}
    if best is not None and best.converged:
        by_side = fault_probability(best, constant_fault_probability(constants, resting), landed_at(parts))
    return Assessment(
        comparison=comparison,
        judged=judged,
        horizons=tuple(horizons),
        imu_spec=imu_spec,
        autopilot=autopilot,
        measured_noise=noise,
        rests=rests(seen, judged.track, imu_spec),
        autopilot_bias=autopilot_bias(seen, judged.track),
        agreements=agreements,
        verdict=decide([agreements[h] for h in num.AGREEING_S], all_findings, beside, track.source, by_side, by_flight),
        best=best,
        sensitivity=_could_show(made, judged.track.t),
    )


def _could_show(made: BestEstimate | NoEstimateError, t: Array) -> Sensitivity:
    """What the flight could have shown; t: of the IMU that was judged (N,), all of which an estimate may not cover."""
    could, ends = sensitivity(made), check.WORTHLESS_S
    if isinstance(made, NoEstimateError) or (made.t[0] < t[0] + ends and made.t[-1] > t[-1] - ends):
        return could
    part = f"by the other sensors: but for {made.t[0]:.1f}-{made.t[-1]:.1f} s, with which the rest cannot be joined"
    return replace(could, not_judged=(*could.not_judged, part))


_UNTRUSTED = ("frozen", "stuck_axis", "gyro_clipping", "accel_clipping")


def _best(
    flight: Flight,
    comparison: Comparison,
    faults: Sequence[Finding],
    uncontrolled: Sequence[tuple[float, float]],
    before: BestEstimate | None,
    estimate: Callable[..., BestEstimate],
    differ: bool,
    effort: Effort,
) -> tuple[BestEstimate | NoEstimateError, list[Finding]]:
    """The best estimate, with the IMU's readings left out where they are invalid; or why there is none.

    And what it says of the readings: an axis that is stuck, or another way to read the axes that fits far better. The
    latter where GPS tells of turns and forces: a compass and gravity by themselves fit many ways.
    uncontrolled: spans (s, boot clock) in which the vehicle is out of control. estimate: `smooth`. differ: whether so
    many windows that they are judged are outside of what is expected.
    """
    imu, gravity = comparison.track.source, comparison.how.gravity
    if any(f.kind == "units_wrong" for f in faults):
        return NoEstimateError(imu, "its readings are of other units", "Try another IMU: --imu."), []
    untrusted = [*uncontrolled, *((f.start_s - 0.5, f.end_s + 0.5) for f in faults if f.kind in _UNTRUSTED)]
    again = partial(estimate, imu=imu, gravity=gravity, untrusted=untrusted)
    looked = partial(_looked, flight, comparison, faults, effort)
    try:
        best, new = looked(partial(again, before=before))
    except NoEstimateError as why:
        calm = between(uncontrolled, comparison.track.t) if uncontrolled else ()
        if not calm:
            return why, []
        try:  # the longest stretch in control: where nothing tells a heading, no other can be joined to it
            again = partial(again, span=max(calm, key=lambda one: one[1] - one[0]))
            best, new = looked(again)
        except NoEstimateError:
            return why, []
    righted, turned_itself = flight, any(f.kind == "axes_wrong" for f in faults)
    if not new and not turned_itself and best.linearisations < effort.looks_again:
        righted, new = righted_compasses(flight, best, again)
    if new:
        every = [*faults, *new]
        best_so, more = _best(righted, comparison, every, uncontrolled, before, estimate, differ, effort)
        return best_so, [*new, *more]
    if "gps_position" not in best.residuals or turned_itself or best.linearisations >= effort.looks_again:
        return best, []
    other = other_reading(flight, best, gravity=gravity, untrusted=untrusted, differ=differ)
    return best, [] if other is None else [misread_finding(flight.imu(imu), other, best)]


def _looked(
    flight: Flight,
    comparison: Comparison,
    faults: Sequence[Finding],
    effort: Effort,
    smooth: Callable[..., BestEstimate],
) -> tuple[BestEstimate, list[Finding]]:
    """The best estimate, and the axes that it says are stuck.

    Where an axis reads the same for a while the first cause may show already that it is stuck: every further one would
    explain what it missed meanwhile.
    """
    new = list[Finding]()

    def stuck(best: BestEstimate) -> bool:
        if best.linearisations < effort.looks_again:
            apart = partial(smooth, before=None, effort=replace(effort, most_causes=min(1, effort.most_causes)))
            new[:] = [f for f in missed_findings(comparison, best, flight, apart) if f not in faults]
        return bool(new)

    first = stuck if any_stands_still(comparison, flight) else None
    best = smooth(flight, effort=effort, enough=first)
    if not new:
        stuck(best)
    return best, new


def _independent(best: BestEstimate | None) -> BestEstimate | None:
    """The estimate, where anything but the IMU told it of its turns: GPS, a compass, or rest for most of the time.

    Without it a bias that steps is learned as noise, and nothing would contradict.
    """
    if best is None or not {"gps_position", "compass"}.isdisjoint(best.residuals):
        return best
    at_rest = best.residuals.get("rest_rate")
    return best if at_rest is not None and 2 * len(at_rest.t) > len(best.t) else None


def in_flight(imu_spec: ImuSpec, best: BestEstimate) -> ImuSpec:
    """The part's figures with the noise that it has in this flight, over seconds, and with what is left of its bias
    where the estimated one is taken off: what is not known of it, and what changes as the part warms.

    All windows of the flight share one draw of it: at its 99.9 % it has to reach no further than their 95 %.
    """

    shared = float(np.sqrt(chi_square(3, num.Z_999) / chi_square(3, num.Z_95)))  # for what all windows share

    def left(part: SensorSpec, noise: float, sigma: Array, warms: float) -> SensorSpec:
        unknown = float(np.sqrt((np.median(sigma, axis=0) ** 2).mean()))
        residual = shared * float(np.hypot(unknown, warms))
        return replace(part, noise_density=max(part.noise_density, noise), residual_bias=residual)

    noise, lasting, warms = best.noise, best.correlated, healthy.WARMING_BIAS
    gyro = left(imu_spec.gyro, noise.gyro_noise * lasting[0], best.gyro_bias_sigma, warms[0])
    accel = left(imu_spec.accel, noise.accel_noise * lasting[1], best.accel_bias_sigma, warms[1])
    return replace(imu_spec, gyro=gyro, accel=accel)


def _unbiased(track: ImuTrack, best: BestEstimate, flight: Flight) -> ImuTrack:
    """The track without the usual bias of the best estimate, and without the scale and misalignment found beside it.

    A bias that the autopilot knows and removes is no fault; one without the other is nobody's. What real parts hardly
    show is not taken off in silence: of an accelerometer that is off by more nothing is.
    """
    states = best.states
    if level_is_unusual(best, flight):
        place, _ = CONSTANTS["accel_matrix"]
        constants = states.constants.copy()
        constants[place] = 0.0
        states = replace(states, constants=constants, accel_bias=np.zeros_like(states.accel_bias))

    def usual(bias: Array, most: float) -> Array:
        return np.asarray(np.clip(np.median(bias, axis=0), -most, most))

    gyro = usual(states.gyro_bias, healthy.USUAL_BIAS["gyro"])
    return without_errors(track, states, gyro, usual(states.accel_bias, healthy.USUAL_BIAS["accel"]))
