"""All findings of one IMU of a flight, without those that only follow from others, and with what the vehicle says.

Also here: what the best estimate says: the sensors' faults, where the autopilot leaves it, and what is set otherwise;
and findings about the loss of control, and what is left of the others beside it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from companion.comparison import (
    GENERIC,
    Comparison,
    Expected,
    FlightDensity,
    ImuSpec,
    Limits,
    ReferenceSpec,
    aligned_at,
    compare,
    ends_of,
    landed_at,
    phases,
    unjudged,
    window,
    within,
)
from companion.constants import check, healthy, num
from companion.estimation import BestEstimate, hypothesis_of
from companion.model import Flight, ImuTrack, Phase, Series
from companion.verdict.attribution import findings_of
from companion.verdict.constant_faults import ALL_THE_TIME, ConstantError, constant_findings
from companion.verdict.deviations import deviations_of, known_biases
from companion.verdict.fault_interval import fault_intervals
from companion.verdict.finding import Cause, Finding, are_near, by_severity
from companion.verdict.findings.aiding import screened_aiding
from companion.verdict.findings.axes import meaning_findings
from companion.verdict.findings.installation import installation, installation_findings
from companion.verdict.findings.outages import (
    interference_findings,
    jump_findings,
    jumps_without_imu,
    outage_findings,
    poor_gps_findings,
    reset_findings,
)
from companion.verdict.findings.readings import (
    frozen_findings,
    lags,
    rate_findings,
    reading_findings,
    stamp_findings,
)
from companion.verdict.findings.settings import setting_findings
from companion.verdict.findings.stuck import stuck_findings
from companion.verdict.findings.vibration import noise_findings, noisier_findings, vibration_findings


def findings_by_estimate(
    flight: Flight, best: BestEstimate, limits: Limits, faults: Sequence[Finding], tilted: tuple[float, float]
) -> list[Finding]:
    """Those of the best estimate. faults: of readings that are none. tilted: roll and pitch of the IMU, rad."""
    landed = landed_at(phases(flight))
    while_judged = tuple(one for one in fault_intervals(best) if one.start - num.SIGMAS * one.start_sigma < landed)
    every = deviations_of(flight, best, limits, tilted)
    deviations = tuple(one for one in every if not is_led_to(one.start, one.end, faults))
    out = findings_of(while_judged, deviations, best, flight.imu_in_use)
    return [*out, *known_biases(flight, best), *setting_findings(flight, best, limits)]


def leans_in_vain(flight: Flight, best: BestEstimate, limits: Limits, tilted: tuple[float, float]) -> bool:
    """Whether the autopilot leans as the best estimate does, and as that of an IMU that is turned so it does not.

    Its windows alone may take a gyro that begins to be off on a circle for an IMU that sits askew. tilted: its roll and
    pitch, rad.
    """

    def leans(tilted: tuple[float, float]) -> bool:
        deviations = deviations_of(flight, best, limits, tilted)
        return any(one.quantity == "tilt" and one.may_be_error for one in deviations)

    return any(tilted) and leans(tilted) and not leans((0.0, 0.0))


def _confirmed(jump: Finding, others: Sequence[Finding], best: BestEstimate) -> Finding:
    """A jump, as serious as the best estimate takes the autopilot to be at that time.

    Without GPS it knows nothing of positions: then a large jump says that the autopilot was wrong before it or is wrong
    after it, and an estimator that corrects itself accuses nobody.
    """
    off = [f for f in others if f.side == "autopilot" and f.severity == "error"]
    if jump.severity != "error" or are_near(off, jump.start_s):
        return jump
    misleads = (f for f in others if jump.kind in _MISLEADS.get(f.kind, ()) and f.start_s <= jump.start_s <= f.end_s)
    if not best.converged and any(misleads):  # it answers for nothing, and what misled the autopilot is known
        return jump
    size = jump.cause.size if jump.cause is not None and jump.kind == "position_jump" else None
    if size is not None and size >= hypothesis_of("gps_position").min_reported and "gps_position" not in best.residuals:
        words = (
            f"{jump.evidence}; without GPS it cannot be told whether the position was wrong before it or is after it"
        )
        return replace(jump, side="data", severity="warning", evidence=words, cause=None, undecided=True)
    return replace(jump, severity="info")


def reading_faults(flight: Flight, comparison: Comparison, imu_spec: ImuSpec) -> list[Finding]:
    """Readings that cannot be: frozen, stuck, at the end of the range, of other units or axes."""
    track = comparison.track
    armed = flight.armed(track.t, track.t)
    faults = [*reading_findings(track, flight.require_attitude(), imu_spec, armed)]
    faults += stuck_findings(comparison, flight.imus.values(), armed=armed)
    faults += meaning_findings(flight, comparison)
    return faults


def autopilot_findings(flight: Flight, limits: Limits) -> tuple[Flight, list[Finding]]:
    """What stands out where there is no IMU to judge; and the flight without readings of aiding sensors that cannot be.

    Of the autopilot and its aiding sensors alone: jumps, resets, times without a position, frozen sensors.
    """
    parts = phases(flight)
    flight, all_findings = screened_aiding(flight, None)
    tracks = [track.t for track in (flight.attitude, flight.position) if track is not None and len(track) > 1]
    if tracks:
        received = max(tracks, key=len)
        all_findings += outage_findings(flight, received, np.diff(received) > limits.longest_step(received))
    all_findings += [*interference_findings(flight), *poor_gps_findings(flight)]
    all_findings += [*jumps_without_imu(flight, limits), *reset_findings(flight)]
    judged = [with_reports(f, flight) for f in when_lost(all_findings, flight, None, parts, GENERIC)]
    return flight, _until_landed(judged, landed_at(parts))


def _until_landed(findings: Iterable[Finding], landed: float) -> list[Finding]:
    """The findings, those from the last landing (s) on as information alone."""
    before = landed - check.HEARTBEAT_S
    return [f if f.start_s < before else replace(f, severity="info", undecided=False) for f in findings]


def _of_other_imus(flight: Flight, comparison: Comparison, faults: Sequence[Finding]) -> Iterator[Finding]:
    """What stands still or becomes noisy on the IMUs that were not judged: each once, whichever message tells of it.

    ArduPilot's HIGHRES_IMU has the first usable gyro: the one that is dead is in RAW_IMU alone. Of a single sensor that
    is stuck, gyros only: in a calm hover an accelerometer of coarse steps and no noise reads the same for long beside
    one that has some. Of what is noisier for a while, what another IMU does not feel.
    """
    aligned = aligned_at(phases(flight))
    reported = {(comparison.track.instance, _sensor(f)) for f in faults if f.kind in ("stuck_axis", "frozen")}
    for track in flight.imus.values():
        if track.source == comparison.track.source or len(track) < 2:
            continue
        armed = flight.armed(track.t, track.t)
        still = [*frozen_findings(track, flight.require_attitude(), armed)]
        own = compare(flight, track=track, how=comparison.how)
        still += stuck_findings(own, flight.imus.values(), ("gyro",), armed)
        mine = [f for f in still if f.end_s > aligned and (track.instance, _sensor(f)) not in reported]
        reported |= {(track.instance, _sensor(f)) for f in mine}
        yield from (_of_imu(track, f) for f in mine)
    every, judged = flight.each_imu(), comparison.track.instance
    for track in (one for one in every if one.instance != judged):
        rest = [one for one in every if one.instance != track.instance]
        noisier = [f for f in noisier_findings(track, rest, _arming(flight)) if f.severity == "error"]
        mine = [f for f in noisier if (track.instance, _sensor(f)) not in reported]
        yield from (_of_imu(track, f) for f in mine if (track.instance, "") not in reported)


def _of_imu(track: ImuTrack, finding: Finding) -> Finding:
    """A finding of an IMU that was not judged, with whose it is."""
    cause = finding.cause or Cause(finding.kind, "imu", finding.start_s, finding.end_s)
    return replace(finding, evidence=f"{track.source}: {finding.evidence}", cause=replace(cause, imu=track.instance))


def _arming(flight: Flight) -> list[float]:
    """When it was armed and disarmed, s."""
    return sorted(e.t for e in flight.events if e.kind in {"armed", "disarmed"})


def _sensor(finding: Finding) -> str:
    return "" if finding.cause is None else finding.cause.sensor


def findings(
    flight: Flight,
    comparison: Comparison,
    allowed: Expected | None,
    imu_spec: ImuSpec,
    noise: FlightDensity,
    autopilot: ReferenceSpec,
    faults: Sequence[Finding],
    best: BestEstimate | None,
    constants: Sequence[ConstantError] = (),
    turned: Sequence[Finding] = (),
) -> tuple[tuple[Finding, ...], ImuTrack]:
    """What stands out, and the IMU with what is no fault taken out: how it sits in the vehicle.

    allowed: the drift that is expected in the windows that are judged. faults: of `reading_faults`. best: the best
    estimate, None where the flight allows none. constants: what its IMUs read wrongly all the time. turned: of other
    IMUs, whatever else these seem to be comes of that.
    """
    sampling = allowed.shares["attitude"]["sampling"] if allowed else 0.0
    all_findings = [*rate_findings(flight, comparison, sampling), *faults]
    if comparison.track.bias_removed and not flight.on_board:
        all_findings.append(_not_independent(comparison.track))
    limits = comparison.how.limits
    jumps = _until_landed(jump_findings(comparison, flight), landed_at(phases(flight)))
    all_findings += outage_findings(flight, comparison.track.t, comparison.gaps)
    all_findings += [*interference_findings(flight), *poor_gps_findings(flight)]
    all_findings += noise_findings(comparison, noise, imu_spec, allowed)
    apart = [track for track in flight.imus.values() if track.instance != comparison.track.instance]
    for f in noisier_findings(comparison.track, apart, _arming(flight)):  # invalid readings are no noise
        unread = (one for one in faults if f.start_s < one.end_s and f.end_s > one.start_s)
        if not any(f.kind.startswith(_sensor(one)) for one in unread):
            all_findings.append(f)
    all_findings += vibration_findings(comparison, flight)
    fitted = installation(comparison, imu_spec, autopilot)
    if fitted is not None and best is not None and leans_in_vain(flight, best, limits, fitted.tilted):
        fitted = replace(fitted, mounting=np.zeros(3))
    all_findings += stamp_findings(flight, comparison, lags(comparison))
    clean, tilted = comparison.track, (0.0, 0.0)
    if fitted is not None:
        all_findings += installation_findings(flight, comparison.track, fitted)
        clean, tilted = fitted.level(comparison.track), fitted.tilted
    if best is not None:  # it has judged where the autopilot went: a jump is one of the signs of it
        all_findings += findings_by_estimate(flight, best, limits, faults, tilted)
        jumps = [_confirmed(jump, all_findings, best) for jump in jumps]
    all_findings += jumps
    all_findings += constant_findings(constants, *ends_of(comparison.track.t))
    others = [*_of_other_imus(flight, comparison, faults), *turned]
    return without_consequences(flight, all_findings, others, turned), clean


def _not_independent(track: ImuTrack) -> Finding:
    taken = f"the estimator's biases have been subtracted from {track.source}"
    evidence = f"{taken}: it agrees with the autopilot even where both are wrong"
    advice = "Ask for SCALED_IMU (SET_MESSAGE_INTERVAL), or use the .ulg log."
    return Finding("not_independent", "data", "warning", *ends_of(track.t), evidence, advice)


def when_lost(
    all_findings: Sequence[Finding], flight: Flight, track: ImuTrack | None, parts: Sequence[Phase], imu_spec: ImuSpec
) -> tuple[Finding, ...]:
    """The findings of a flight, with what tells that control was lost and without what came of that.

    track: the IMU with its readings out of control, None where there is none. A gyro at the end of its range is a
    consequence then, and takes the estimator along; whatever else is read accuses nobody. What begins out of control
    and goes on after it is a fault.
    Evidence in the last second of a log is worth nothing.
    """
    lost, uncontrolled = [part for part in parts if part.kind == "impact"], unjudged(parts)
    end = flight.start + flight.duration if track is None else float(track.t[-1])

    kept = [
        f for f in all_findings
        if not any(begin <= f.start_s and f.end_s < over + check.WORTHLESS_S for begin, over in uncontrolled)
    ]  # fmt: skip
    kept = [
        replace(f, severity="info", cause=None, undecided=False) if f.start_s > end - check.WORTHLESS_S else f
        for f in kept
    ]
    out: list[Finding] = []
    for part in lost:
        tumbling: list[Finding] = []
        if track is not None and len(falling := track[window(track.t, part.start, part.end)]) > 1:
            clipping = reading_findings(falling, flight.require_attitude(), imu_spec)
            tumbling = [f for f in clipping if f.kind == "gyro_clipping"]
        out.append(_control_lost(flight, part, tumbling))
        # a gyro that reads no further as the vehicle tumbles is nobody's fault
        out += [replace(f, severity="warning", advice=_LOST, cause=None) for f in tumbling]
    return by_severity((*out, *kept))


def _control_lost(flight: Flight, part: Phase, tumbling: Sequence[Finding]) -> Finding:
    words = f"control was lost at {part.start:.1f} s{_at_its_end(flight, part.start)}"
    until = "after it" if part.end >= flight.start + flight.duration else f"until {part.end:.1f} s"
    evidence = f"{words} ({part.reason}); nothing {until} is judged"
    for clipping in tumbling[:1]:
        turns = f"from {clipping.start_s:.1f} s on the vehicle turns faster than the gyro reads"
        evidence += f": {turns} ({clipping.evidence}), which misleads the autopilot too"
    unsure = bool(tumbling)
    return Finding("control_lost", "data", "warning", part.start, part.end, evidence, _LOST, words, undecided=unsure)


_LOST = "Look at motors, propellers and the desired attitude before it: a vehicle that tumbles misleads every sensor."


def _at_its_end(flight: Flight, lost: float) -> str:
    """Which outputs stood at the upper end of their range as control was lost, and at no other time; "" for none."""
    if (track := flight.actuators) is None or not len(track):
        return ""
    full = np.nan_to_num(track.output) >= check.OUTPUT_FULL
    before = lost - check.AROUND_S
    usual = full[track.t < before].mean(axis=0) if (track.t < before).any() else full[0]
    around = (full[(track.t >= begin) & (track.t < begin + check.AROUND_S)] for begin in (before, lost))
    most = np.max([part.mean(axis=0) if len(part) else np.zeros(full.shape[1]) for part in around], axis=0)
    names = [output_name(flight, int(i)) for i in np.flatnonzero((most > 0.5) & (usual < 0.05))]
    return f" with {' and '.join(names)} at {'its' if len(names) == 1 else 'their'} end" if names else ""


_MOTORS = {33 + i: f"motor {i + 1}" for i in range(8)} | {82 + i: f"motor {i + 9}" for i in range(4)}
"""SERVOn_FUNCTION → what the output moves."""


def output_name(flight: Flight, index: int) -> str:
    """What an output of the actuator track moves, by its place."""
    if flight.actuators is not None and flight.actuators.source == "actuator_motors":
        return f"motor {index + 1}"
    function = flight.parameters.get(f"SERVO{index + 1}_FUNCTION", 0.0)
    return _MOTORS.get(int(function), f"output {index + 1}")


def without_consequences(
    flight: Flight, all_findings: Sequence[Finding], others: Sequence[Finding], turned: Sequence[Finding]
) -> tuple[Finding, ...]:
    """The findings, with those of other IMUs, without what only follows from others, and with what the vehicle says."""
    unread_imus = {f.cause.imu for f in turned if f.cause is not None}
    own = [f for f in all_findings if f.cause is None or f.cause.imu not in unread_imus]
    own = [f for f in own if not is_led_to(f.start_s, f.end_s, [one for one in others if _same_imu(one, f)])]
    constant = {f.kind for f in own if f.severity == "error" and f.cause is not None and f.cause.onset_sigma_s is None}
    own = [f for f in own if not (f.kind in constant and f.side == "data" and ALL_THE_TIME in f.evidence)]
    causes = [f for f in own if f.kind in _CAUSES or f.side == "data"]  # a frozen sensor looks biased, and misleads
    own = [with_reports(f, flight) for f in own if f in causes or not is_led_to(f.start_s, f.end_s, own)]
    return by_severity([*misled(own), *others])


def _same_imu(one: Finding, other: Finding) -> bool:
    """Whether two findings are of one IMU, which both name."""
    return one.cause is not None and other.cause is not None and one.cause.imu == other.cause.imu is not None


_MISLEADS = {
    "compass_frozen": ("heading_off", "heading_jump"),
    "barometer_frozen": ("height_off",),
    "gps_frozen": ("position_off", "velocity_off", "position_jump"),
    "gps_inconsistent": ("position_off", "velocity_off", "position_jump"),
    "compass_orientation": (
        "heading_off", "heading_jump", "tilt_off", "velocity_off", "position_off", "position_jump", "compass_turn",
    ),
}  # fmt: skip
"""What of an aiding sensor misleads the autopilot → how that shows."""


def misled(findings: Sequence[Finding]) -> list[Finding]:
    """The findings, where a frozen or turned sensor misled the autopilot with that as the cause of what it led to.

    Where it may be the board that is turned, and not the compass, what that led to accuses nobody.
    """
    out = list(findings)
    for i, one in enumerate(findings):
        throughout = one.kind == "compass_orientation"
        wrong = [f for f in findings if f.kind in _MISLEADS.get(one.kind, ()) and f.side == "autopilot"]
        led = [
            f for f in wrong
            if f.severity == "error" and (throughout or one.start_s <= f.start_s <= one.end_s + healthy.EKF_RECOVERS_S)
        ]  # fmt: skip
        if not led or (throughout and any(other.kind == one.kind for other in findings[:i])):
            continue
        consequences = tuple(f.headline or f.evidence for f in led)
        evidence = f"{one.evidence}; the autopilot was misled by it: {consequences[0]}"
        if throughout and one.undecided:
            out = [
                replace(f, side="data", severity="warning", cause=None, undecided=True) if f in led else f for f in out
            ]
            out[i] = replace(one, evidence=evidence)
            continue
        cause = one.cause or Cause(one.kind, "autopilot", one.start_s, one.end_s, sensor=one.kind.partition("_")[0])
        cause = replace(cause, side="autopilot", consequences=consequences)
        out[i] = replace(one, side="autopilot", severity="error", evidence=evidence, headline=one.evidence, cause=cause)
    return out


def is_led_to(start: float, end: float, others: Sequence[Finding]) -> bool:
    """Whether what lasted so long (s) came of a sensor whose readings are none, and of nothing before that.

    Nor of anything that began once the estimator had recovered from it, as in the next flight of a log.
    """
    causes = (f for f in others if f.kind in _CAUSES and f.severity == "error")
    return any(f.start_s < end and f.start_s - 2.0 < start <= f.end_s + healthy.EKF_RECOVERS_S for f in causes)


_CAUSES = ("stuck_axis", "frozen", "units_wrong", "axes_wrong", "clocks_diverge")


_WORDS = ("ekf", "gps", "compass", "mag", "yaw", "lane", "glitch", "aiding", "primary", "variance", "failsafe", "reset")


def with_reports(finding: Finding, flight: Flight) -> Finding:
    """The finding with what the vehicle said at that time, and how its estimator saw itself.

    That of the autopilot, and of a compass: ArduPilot says "ground mag anomaly" where one is turned or magnetised, once
    it has taken off, whenever that began.
    """
    of_compass = finding.kind.startswith("compass")
    if finding.side != "autopilot" and not of_compass:
        return finding
    begin, end = finding.start_s, min(finding.end_s, finding.start_s + check.AFTER_S)
    texts = [(one.t, one.text) for one in flight.texts]
    texts += [(one.t, one.text) for one in flight.events if one.kind in {"error", "event"}]
    during = [
        (t, text) for t, text in texts
        if (begin - check.BEFORE_S <= t <= end + check.AFTER_S or (of_compass and "mag anomaly" in text))
        and any(word in text.lower() for word in _WORDS)
    ]  # fmt: skip
    nearest = sorted(during, key=lambda spoken: max(begin - spoken[0], spoken[0] - end, 0.0))
    words = dict.fromkeys(
        f"{''.join(c for c in text if c.isprintable()).strip()!r} at {t:.1f} s" for t, text in nearest
    )
    evidence = [finding.evidence]
    if words:
        evidence.append(f"the vehicle said {', '.join(list(words)[: check.MAX_QUOTED])}")
    estimator = flight.series.get("estimator")
    if estimator is not None:
        evidence += _worst_ratio(estimator, begin - check.BEFORE_S, end + check.BEFORE_S)
    return replace(finding, evidence="; ".join(evidence), headline=finding.headline or finding.evidence)


def _worst_ratio(estimator: Series, begin: float, end: float) -> Iterator[str]:
    """The estimator's worst test ratio of a time, if it rejected something: 1 and more is what it does not believe."""
    during = within(estimator.t, (begin, end))
    columns = ((name, f"{name}_ratio") for name in ("velocity", "position", "height", "compass"))
    of_time = {name: estimator[column][during] for name, column in columns if column in estimator.columns}
    ratios = {name: float(np.nanmax(values)) for name, values in of_time.items() if np.isfinite(values).any()}
    worst = max(ratios, key=lambda name: ratios[name], default="")
    if ratios.get(worst, 0.0) >= 1:
        yield f"{estimator.source}'s {worst} ratio reached {ratios[worst]:.1f} (1: rejected)"
