"""All findings of one IMU of a flight, without those that only follow from others, and with what the vehicle says."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from companion.analysis.attribution import findings_of
from companion.analysis.autopilot_error import known_biases
from companion.analysis.budget import Expected
from companion.analysis.comparison import Comparison, compare
from companion.analysis.constant_faults import ConstantError, constant_findings
from companion.analysis.deviations import estimator_deviations
from companion.analysis.fault_interval import fault_intervals
from companion.analysis.finding import Finding, by_severity
from companion.analysis.findings.aiding import misled_by_frozen, screened_aiding
from companion.analysis.findings.axes import meaning_findings
from companion.analysis.findings.control import when_lost
from companion.analysis.findings.installation import Installation, installation, level
from companion.analysis.findings.jumps import jump_findings, jumps_without_imu, reset_findings
from companion.analysis.findings.noisier import noisier_findings
from companion.analysis.findings.outages import outage_findings, receiver_findings
from companion.analysis.findings.readings import reading_findings
from companion.analysis.findings.residuals import residuals
from companion.analysis.findings.sampling import lags, rate_findings, stamp_findings
from companion.analysis.findings.settings import setting_findings
from companion.analysis.findings.stuck import stuck_findings
from companion.analysis.findings.turned import misled_by_turned
from companion.analysis.findings.vibration import noise_findings, vibration_findings
from companion.analysis.imu_spec import GENERIC, ImuSpec, ReferenceSpec
from companion.analysis.lasting_errors import ALL_THE_TIME
from companion.analysis.noise import FlightDensity
from companion.analysis.phases import landed_at, phases
from companion.analysis.reference import Limits
from companion.constants import check, harm, num
from companion.estimation import BestEstimate, kind_of
from companion.model import Flight, ImuTrack, Series


def reading_faults(flight: Flight, comparison: Comparison, figures: ImuSpec) -> list[Finding]:
    """Readings that cannot be: frozen, stuck, at the end of the range, of other units or axes."""
    track = comparison.track
    faults = [*reading_findings(track, flight.require_attitude(), figures, flight.armed(track.t, track.t))]
    others = [track for track in flight.imus.values() if track.instance != comparison.track.instance]
    faults += stuck_findings(comparison, others)
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
        heard = max(tracks, key=len)
        all_findings += outage_findings(flight, heard, np.diff(heard) > limits.longest_step(heard))
    all_findings += [*receiver_findings(flight), *jumps_without_imu(flight, limits), *reset_findings(flight)]
    told = [with_reports(f, flight) for f in when_lost(all_findings, flight, None, parts, GENERIC)]
    landed = landed_at(parts) - check.HEARTBEAT_S
    return flight, [f if f.start_s < landed else replace(f, severity="info", undecided=False) for f in told]


def _of_other_imus(flight: Flight, comparison: Comparison, faults: Sequence[Finding]) -> Iterator[Finding]:
    """Axes that are stuck on the IMUs that were not judged: each sensor's once, whichever message tells of it.

    ArduPilot's HIGHRES_IMU has the first usable gyro: the one that is dead is in RAW_IMU alone. Gyros only: in a calm
    hover an accelerometer of coarse steps and no noise reads the same for long beside one that has some.
    """
    parts = phases(flight)
    aligned = max((part.end for part in parts if part.kind == "aligning"), default=-np.inf)
    lost = min((part.start for part in parts if part.kind == "impact"), default=np.inf)
    told = {(comparison.track.instance, _sensor(f)) for f in faults if f.kind in ("stuck_axis", "frozen")}
    for track in flight.imus.values():
        if track.source == comparison.track.source or len(track) < 2:
            continue
        others = [other for other in flight.imus.values() if other.instance != track.instance]
        stuck = stuck_findings(compare(flight, track=track, how=comparison.how), others, ("gyro",))
        mine = [f for f in stuck if f.end_s > aligned and f.start_s < lost]
        mine = [f for f in mine if (track.instance, _sensor(f)) not in told]
        told |= {(track.instance, _sensor(f)) for f in mine}
        yield from (replace(f, evidence=f"{track.source}: {f.evidence}") for f in mine)


def _sensor(finding: Finding) -> str:
    return "" if finding.cause is None else finding.cause.sensor


def findings(
    flight: Flight,
    comparison: Comparison,
    allowed: Expected | None,
    figures: ImuSpec,
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
        all_findings.append(_not_independent(comparison))
    landed = landed_at(phases(flight))
    jumps = [
        f if f.start_s < landed - check.HEARTBEAT_S else replace(f, severity="info")
        for f in jump_findings(comparison, flight)
    ]
    all_findings += [*outage_findings(flight, comparison.track.t, comparison.gaps), *receiver_findings(flight)]
    all_findings += noise_findings(comparison, noise, figures, allowed)
    apart = [track for track in flight.imus.values() if track.instance != comparison.track.instance]
    unread = [(f.start_s, f.end_s, _sensor(f)) for f in faults]  # readings that are none are no noise
    all_findings += (
        f
        for f in _noisier(flight, comparison.track, apart)
        if not any(f.start_s < end and f.end_s > begin and f.kind.startswith(sensor) for begin, end, sensor in unread)
    )
    all_findings += vibration_findings(comparison, flight)
    raw = residuals(comparison)
    fitted = installation(comparison, raw, figures, autopilot, np.inf)
    if fitted is not None and best is not None and _turned_in_vain(flight, comparison, fitted, best):
        fitted = replace(fitted, mounting=np.zeros(3))
    all_findings += stamp_findings(flight, comparison, lags(comparison))
    clean, tilted = comparison.track, (0.0, 0.0)
    if fitted is not None and fitted.moved:
        all_findings += _installed(flight, comparison, fitted)
        clean = level(comparison.track, fitted)
        tilted = _tilted(fitted)
    if best is not None:
        limits = comparison.how.limits
        while_judged = tuple(one for one in fault_intervals(best) if one.start - num.SIGMAS * one.start_sigma < landed)
        deviations = estimator_deviations(flight, best, limits, tilted)
        deviations = tuple(one for one in deviations if not _is_led_to(one.start, one.end, faults))
        all_findings += findings_of(while_judged, deviations, best, jumps, flight.imu_in_use)
        all_findings += [*known_biases(flight, best), *setting_findings(flight, best, limits)]
        # the best estimate has judged where the autopilot went: a jump is one of the signs of it
        jumps = [_confirmed(f, all_findings, best) for f in jumps]
    all_findings += jumps
    track = comparison.track
    all_findings += constant_findings(constants, float(track.t[0]), float(track.t[-1]))
    return _told_once(flight, all_findings, [*_of_other_imus(flight, comparison, faults), *turned], turned), clean


def _told_once(
    flight: Flight, all_findings: Sequence[Finding], others: Sequence[Finding], turned: Sequence[Finding]
) -> tuple[Finding, ...]:
    """The findings, with those of other IMUs, without what only follows from others, and with what the vehicle says."""
    unread_imus = {f.cause.imu for f in turned if f.cause is not None}
    own = [f for f in all_findings if f.cause is None or f.cause.imu not in unread_imus]
    constant = {f.kind for f in own if f.severity == "error" and f.cause is not None and f.cause.onset_sigma_s is None}
    own = [f for f in own if not (f.kind in constant and f.side == "data" and ALL_THE_TIME in f.evidence)]
    own = [with_reports(f, flight) for f in own if not _follows(f, own)]
    return by_severity([*misled_by_turned(misled_by_frozen(own)), *others])


def _noisier(flight: Flight, track: ImuTrack, others: Sequence[ImuTrack]) -> Iterator[Finding]:
    """Axes that become noisier, while armed and while not apart: motors shake the axes of a sensor unequally."""
    changes = sorted(event.t for event in flight.events if event.kind in ("armed", "disarmed"))
    for begin, end in pairwise([-np.inf, *changes, np.inf]):
        own, *beside = (one[slice(*np.searchsorted(one.t, [begin, end]).tolist())] for one in (track, *others))
        if len(own) > 1:
            yield from noisier_findings(own, [one for one in beside if len(one) > 1])


def _tilted(fitted: Installation) -> tuple[float, float]:
    """Roll and pitch of the IMU, rad."""
    return float(fitted.mounting[0]), float(fitted.mounting[1])


def _turned_in_vain(flight: Flight, comparison: Comparison, fitted: Installation, best: BestEstimate) -> bool:
    """Whether the autopilot leans as the best estimate does, and as that of an IMU that is turned so it does not.

    Its windows alone may take a gyro that begins to be off on a circle for an IMU that sits askew.
    """

    def leans(tilted: tuple[float, float]) -> bool:
        return any(one.quantity == "tilt" for one in estimator_deviations(flight, best, comparison.how.limits, tilted))

    return bool(fitted.mounting.any()) and leans(_tilted(fitted)) and not leans((0.0, 0.0))


def _confirmed(jump: Finding, others: Sequence[Finding], best: BestEstimate) -> Finding:
    """A jump, as serious as the best estimate takes the autopilot to be at that time.

    Without GPS it knows nothing of positions: then a large jump says that the autopilot was wrong before it or is wrong
    after it, and an estimator that corrects itself accuses nobody.
    """
    off = [f for f in others if f.side == "autopilot" and f.severity == "error"]
    if jump.severity != "error" or any(f.start_s - check.NEAR_S <= jump.start_s <= f.end_s + check.NEAR_S for f in off):
        return jump
    size = jump.cause.size if jump.cause is not None and jump.kind == "position_jump" else None
    if size is not None and size >= kind_of("gps_position").least and "gps_position" not in best.residuals:
        words = (
            f"{jump.evidence}; without GPS it cannot be told whether the position was wrong before it or is after it"
        )
        return replace(jump, side="data", severity="warning", evidence=words, cause=None, undecided=True)
    return replace(jump, severity="info")


def _follows(finding: Finding, others: Sequence[Finding]) -> bool:
    """Whether a finding is only what another fault looks like from elsewhere.

    A frozen, stuck or turned sensor also looks biased, and misleads the autopilot.
    """
    told_itself = finding.kind in _CAUSES or finding.side == "data"
    return not told_itself and _is_led_to(finding.start_s, finding.end_s, others)


def _is_led_to(start: float, end: float, others: Sequence[Finding]) -> bool:
    """Whether what lasted so long (s) came of a sensor whose readings are none, and of nothing before that."""
    return any(
        f.kind in _CAUSES and f.severity == "error" and f.start_s < end and f.start_s - 2.0 < start for f in others
    )


_CAUSES = ("stuck_axis", "frozen", "units_wrong", "axes_wrong", "clocks_diverge")


def _installed(flight: Flight, comparison: Comparison, fitted: Installation) -> Iterator[Finding]:
    """What is said of how the IMU sits in the vehicle."""
    begin, end = float(comparison.track.t[0]), float(comparison.track.t[-1])
    if fitted.lag:
        yield Finding(
            "imu_lag",
            "data",
            "info",
            begin,
            end,
            f"the IMU lags {fitted.lag * 1e3:.1f} ± {fitted.lag_sigma * 1e3:.1f} ms behind the attitude",
            "Usual: a low-pass of 20 Hz makes 12 ms. It matters in fast turns alone; the calibration takes it out.",
        )
    if fitted.mounting.any():
        size = float(np.linalg.norm(fitted.mounting))
        roll, pitch, yaw = np.degrees(fitted.mounting)
        yield Finding(
            "mounting",
            "data",
            "warning" if size > harm.MOUNTING_RAD else "info",
            begin,
            end,
            f"the IMU is turned by ({roll:.1f}, {pitch:.1f}, {yaw:.1f})° against the axes of the attitude, throughout",
            f"A board trim ({flight.settings.board_trim}) that the log does not "
            "name, or the board sits askew. A flight that stays level cannot tell it from an accelerometer's offset.",
        )
    if fitted.lever.any():
        x, y, z = fitted.lever
        yield Finding(
            "lever_arm",
            "data",
            "info",
            begin,
            end,
            f"the IMU sits ({x:.2f}, {y:.2f}, {z:.2f}) m from the point that the position speaks of",
            f"Set {flight.settings.imu_place} to where the IMU is, so that the autopilot knows too.",
        )


def _not_independent(comparison: Comparison) -> Finding:
    return Finding(
        "not_independent",
        "data",
        "warning",
        float(comparison.track.t[0]),
        float(comparison.track.t[-1]),
        f"the estimator's biases have been subtracted from {comparison.track.source}: it agrees with the autopilot "
        "even where both are wrong",
        "Ask for SCALED_IMU (SET_MESSAGE_INTERVAL), or use the .ulg log.",
    )


_WORDS = ("ekf", "gps", "compass", "mag", "yaw", "lane", "glitch", "aiding", "primary", "variance", "failsafe", "reset")
_RATIOS = {
    "velocity_ratio": "velocity",
    "position_ratio": "position",
    "height_ratio": "height",
    "compass_ratio": "compass",
}


def with_reports(finding: Finding, flight: Flight) -> Finding:
    """The finding with what the vehicle said at that time, and how its estimator saw itself.

    That of the autopilot, and of a compass: ArduPilot says "ground mag anomaly" where one is turned or magnetised, once
    it has taken off, whenever that began.
    """
    of_compass = finding.kind.startswith("compass")
    if finding.side != "autopilot" and not of_compass:
        return finding
    begin, end = finding.start_s, min(finding.end_s, finding.start_s + check.AFTER_S)
    said = [(t.t, t.text) for t in flight.texts if _speaks(t.text)]
    said += [(e.t, e.text) for e in flight.events if e.kind in {"error", "event"} and _speaks(e.text)]
    during = [
        (t, text)
        for t, text in said
        if begin - check.BEFORE_S <= t <= end + check.AFTER_S or (of_compass and "mag anomaly" in text)
    ]
    nearest = sorted(during, key=lambda spoken: max(begin - spoken[0], spoken[0] - end, 0.0))
    words = dict.fromkeys(f"{''.join(c for c in text if c.isprintable())!r} at {t:.1f} s" for t, text in nearest)
    evidence = [finding.evidence]
    if words:
        evidence.append(f"the vehicle said {', '.join(list(words)[: check.MAX_QUOTED])}")
    estimator = flight.series.get("estimator")
    reach = check.BEFORE_S
    if estimator is not None and (ratio := _worst_ratio(estimator, begin - reach, end + reach)):
        evidence.append(ratio)
    return replace(finding, evidence="; ".join(evidence), headline=finding.headline or finding.evidence)


def _speaks(text: str) -> bool:
    return any(word in text.lower() for word in _WORDS)


def _worst_ratio(estimator: Series, begin: float, end: float) -> str:
    """The estimator's worst test ratio of a time, if it rejected something: 1 and more is what it does not believe."""
    during = (estimator.t >= begin) & (estimator.t <= end)
    ratios = {
        name: float(np.nanmax(estimator[column][during]))
        for column, name in _RATIOS.items()
        if column in estimator.columns and np.isfinite(estimator[column][during]).any()
    }
    if not ratios:
        return ""
    worst = max(ratios, key=lambda name: ratios[name])
    return f"{estimator.source}'s {worst} ratio reached {ratios[worst]:.1f} (1: rejected)" if ratios[worst] >= 1 else ""
