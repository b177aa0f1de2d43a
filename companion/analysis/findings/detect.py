"""All findings of one IMU of a flight, without those that only follow from others, and with what the vehicle says.

Also here: what the best estimate says: the sensors' faults, where the autopilot leaves it, and what is set otherwise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from companion.analysis.attribution import findings_of
from companion.analysis.budget import Expected
from companion.analysis.comparison import Comparison, compare
from companion.analysis.constant_faults import ConstantError, constant_findings
from companion.analysis.deviations import estimator_deviations, known_biases
from companion.analysis.fault_interval import fault_intervals
from companion.analysis.finding import Finding, are_near
from companion.analysis.findings.aiding import screened_aiding
from companion.analysis.findings.axes import meaning_findings
from companion.analysis.findings.consequences import is_led_to, when_lost, with_reports, without_consequences
from companion.analysis.findings.installation import Installation, installation, level
from companion.analysis.findings.outages import (
    jump_findings,
    jumps_without_imu,
    outage_findings,
    receiver_findings,
    reset_findings,
)
from companion.analysis.findings.readings import reading_findings
from companion.analysis.findings.residuals import residuals
from companion.analysis.findings.sampling import lags, rate_findings, stamp_findings
from companion.analysis.findings.settings import setting_findings
from companion.analysis.findings.stuck import stuck_findings
from companion.analysis.findings.vibration import noise_findings, noisier_findings, vibration_findings
from companion.analysis.imu_spec import GENERIC, ImuSpec, ReferenceSpec
from companion.analysis.noise import FlightDensity
from companion.analysis.phases import aligned_at, landed_at, phases
from companion.analysis.reference import Limits
from companion.constants import check, harm, num
from companion.estimation import BestEstimate, hypothesis_of
from companion.model import Flight, ImuTrack


def findings_by_estimate(
    flight: Flight,
    best: BestEstimate,
    limits: Limits,
    known: tuple[Sequence[Finding], Sequence[Finding], Sequence[Finding]],
    landed: float,
    tilted: tuple[float, float],
) -> tuple[list[Finding], list[Finding]]:
    """Those of the best estimate, and the jumps as serious as it takes the autopilot to be then.

    known: all findings so far, those of readings that are none, and the jumps of the autopilot. landed: s, from when on
    nothing is judged. tilted: roll and pitch of the IMU, rad.
    """
    so_far, faults, jumps = known
    while_judged = tuple(one for one in fault_intervals(best) if one.start - num.SIGMAS * one.start_sigma < landed)
    deviations = estimator_deviations(flight, best, limits, tilted)
    deviations = tuple(one for one in deviations if not is_led_to(one.start, one.end, faults))
    out = findings_of(while_judged, deviations, best, flight.imu_in_use)
    out += [*known_biases(flight, best), *setting_findings(flight, best, limits)]
    # the best estimate has judged where the autopilot went: a jump is one of the signs of it
    return out, [_confirmed(f, [*so_far, *out], best) for f in jumps]


def leans_in_vain(flight: Flight, best: BestEstimate, limits: Limits, tilted: tuple[float, float]) -> bool:
    """Whether the autopilot leans as the best estimate does, and as that of an IMU that is turned so it does not.

    Its windows alone may take a gyro that begins to be off on a circle for an IMU that sits askew. tilted: its roll and
    pitch, rad.
    """

    def leans(tilted: tuple[float, float]) -> bool:
        return any(one.quantity == "tilt" for one in estimator_deviations(flight, best, limits, tilted))

    return any(tilted) and leans(tilted) and not leans((0.0, 0.0))


def _confirmed(jump: Finding, others: Sequence[Finding], best: BestEstimate) -> Finding:
    """A jump, as serious as the best estimate takes the autopilot to be at that time.

    Without GPS it knows nothing of positions: then a large jump says that the autopilot was wrong before it or is wrong
    after it, and an estimator that corrects itself accuses nobody.
    """
    off = [f for f in others if f.side == "autopilot" and f.severity == "error"]
    if jump.severity != "error" or are_near(off, jump.start_s):
        return jump
    size = jump.cause.size if jump.cause is not None and jump.kind == "position_jump" else None
    if size is not None and size >= hypothesis_of("gps_position").least and "gps_position" not in best.residuals:
        words = (
            f"{jump.evidence}; without GPS it cannot be told whether the position was wrong before it or is after it"
        )
        return replace(jump, side="data", severity="warning", evidence=words, cause=None, undecided=True)
    return replace(jump, severity="info")


_ARMING = ("armed", "disarmed")


def reading_faults(flight: Flight, comparison: Comparison, imu_spec: ImuSpec) -> list[Finding]:
    """Readings that cannot be: frozen, stuck, at the end of the range, of other units or axes."""
    track = comparison.track
    faults = [*reading_findings(track, flight.require_attitude(), imu_spec, flight.armed(track.t, track.t))]
    faults += stuck_findings(comparison, flight.imus.values())
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
    all_findings += [*receiver_findings(flight), *jumps_without_imu(flight, limits), *reset_findings(flight)]
    judged = [with_reports(f, flight) for f in when_lost(all_findings, flight, None, parts, GENERIC)]
    landed = landed_at(parts) - check.HEARTBEAT_S
    return flight, [f if f.start_s < landed else replace(f, severity="info", undecided=False) for f in judged]


def _of_other_imus(flight: Flight, comparison: Comparison, faults: Sequence[Finding]) -> Iterator[Finding]:
    """Axes that are stuck on the IMUs that were not judged: each sensor's once, whichever message tells of it.

    ArduPilot's HIGHRES_IMU has the first usable gyro: the one that is dead is in RAW_IMU alone. Gyros only: in a calm
    hover an accelerometer of coarse steps and no noise reads the same for long beside one that has some.
    """
    parts = phases(flight)
    aligned = aligned_at(parts)
    lost = min((part.start for part in parts if part.kind == "impact"), default=np.inf)
    reported = {(comparison.track.instance, _sensor(f)) for f in faults if f.kind in ("stuck_axis", "frozen")}
    for track in flight.imus.values():
        if track.source == comparison.track.source or len(track) < 2:
            continue
        stuck = stuck_findings(compare(flight, track=track, how=comparison.how), flight.imus.values(), ("gyro",))
        mine = [f for f in stuck if f.end_s > aligned and f.start_s < lost]
        mine = [f for f in mine if (track.instance, _sensor(f)) not in reported]
        reported |= {(track.instance, _sensor(f)) for f in mine}
        yield from (replace(f, evidence=f"{track.source}: {f.evidence}") for f in mine)


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
        all_findings.append(_not_independent(comparison))
    landed, limits = landed_at(phases(flight)), comparison.how.limits
    jumps = [
        f if f.start_s < landed - check.HEARTBEAT_S else replace(f, severity="info")
        for f in jump_findings(comparison, flight)
    ]
    all_findings += [*outage_findings(flight, comparison.track.t, comparison.gaps), *receiver_findings(flight)]
    all_findings += noise_findings(comparison, noise, imu_spec, allowed)
    apart = [track for track in flight.imus.values() if track.instance != comparison.track.instance]
    unread = [(f.start_s, f.end_s, _sensor(f)) for f in faults]  # readings that are none are no noise
    all_findings += (
        f
        for f in noisier_findings(comparison.track, apart, sorted(e.t for e in flight.events if e.kind in _ARMING))
        if not any(f.start_s < end and f.end_s > begin and f.kind.startswith(sensor) for begin, end, sensor in unread)
    )
    all_findings += vibration_findings(comparison, flight)
    raw = residuals(comparison)
    fitted = installation(comparison, raw, imu_spec, autopilot, np.inf)
    if (
        fitted is not None
        and best is not None
        and fitted.mounting.any()
        and leans_in_vain(flight, best, comparison.how.limits, _tilted(fitted))
    ):
        fitted = replace(fitted, mounting=np.zeros(3))
    all_findings += stamp_findings(flight, comparison, lags(comparison))
    clean, tilted = comparison.track, (0.0, 0.0)
    if fitted is not None and fitted.moved:
        all_findings += _installed(flight, comparison, fitted)
        clean = level(comparison.track, fitted)
        tilted = _tilted(fitted)
    if best is not None:
        more, jumps = findings_by_estimate(flight, best, limits, (all_findings, faults, jumps), landed, tilted)
        all_findings += more
    all_findings += jumps
    t = comparison.track.t
    all_findings += constant_findings(constants, float(t[0]), float(t[-1]))
    others = [*_of_other_imus(flight, comparison, faults), *turned]
    return without_consequences(flight, all_findings, others, turned), clean


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


def _tilted(fitted: Installation) -> tuple[float, float]:
    """Roll and pitch of the IMU, rad."""
    return float(fitted.mounting[0]), float(fitted.mounting[1])
