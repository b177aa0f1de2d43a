"""Which findings only follow from others, and what the vehicle itself said of them.

Also here: findings about the loss of control, and what is left of the others beside it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from companion.analysis.constant_faults import ALL_THE_TIME
from companion.analysis.finding import Finding, by_severity
from companion.analysis.findings.aiding import misled_by_frozen
from companion.analysis.findings.readings import reading_findings
from companion.analysis.findings.settings import misled_by_turned
from companion.analysis.imu_spec import ImuSpec
from companion.analysis.loss_of_control import unjudged
from companion.constants import check
from companion.model import Flight, ImuTrack, Phase, Series


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
        f
        for f in all_findings
        if not any(begin <= f.start_s and f.end_s < over + check.WORTHLESS_S for begin, over in uncontrolled)
    ]
    kept = [replace(f, severity="info", cause=None) if f.start_s > end - check.WORTHLESS_S else f for f in kept]
    out: list[Finding] = []
    for part in lost:
        clipping: Iterable[Finding] = ()
        if track is not None:
            falling = track[slice(*np.searchsorted(track.t, [part.start, part.end]).tolist())]
            clipping = reading_findings(falling, flight.require_attitude(), imu_spec) if len(falling) > 1 else ()
        tumbling = [f for f in clipping if f.kind == "gyro_clipping"]
        out += [_control_lost(flight, part, tumbling), *(_as_consequence(f) for f in tumbling)]
    return by_severity((*out, *kept))


def _control_lost(flight: Flight, part: Phase, tumbling: Sequence[Finding]) -> Finding:
    words = f"control was lost at {part.start:.1f} s{_at_its_end(flight, part.start)}"
    until = "after it" if part.end >= flight.start + flight.duration else f"until {part.end:.1f} s"
    return Finding(
        "control_lost",
        "data",
        "warning",
        part.start,
        part.end,
        f"{words} ({part.reason}); nothing {until} is judged" + (_too_fast(tumbling[0]) if tumbling else ""),
        _LOST,
        words,
        undecided=bool(tumbling),
    )


def _as_consequence(clipping: Finding) -> Finding:
    """A gyro that reads no further as the vehicle tumbles: nobody's fault."""
    return replace(clipping, severity="warning", advice=_LOST, cause=None)


_LOST = "Look at motors, propellers and the desired attitude before it: a vehicle that tumbles misleads every sensor."


def _at_its_end(flight: Flight, lost: float) -> str:
    """Which outputs stood at the upper end of their range as control was lost, and at no other time; "" for none."""
    track = flight.actuators
    if track is None:
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


def _too_fast(clipping: Finding) -> str:
    turns = f"from {clipping.start_s:.1f} s on the vehicle turns faster than the gyro reads"
    return f": {turns} ({clipping.evidence}), which misleads the autopilot too"


def without_consequences(
    flight: Flight, all_findings: Sequence[Finding], others: Sequence[Finding], turned: Sequence[Finding]
) -> tuple[Finding, ...]:
    """The findings, with those of other IMUs, without what only follows from others, and with what the vehicle says."""
    unread_imus = {f.cause.imu for f in turned if f.cause is not None}
    own = [f for f in all_findings if f.cause is None or f.cause.imu not in unread_imus]
    constant = {f.kind for f in own if f.severity == "error" and f.cause is not None and f.cause.onset_sigma_s is None}
    own = [f for f in own if not (f.kind in constant and f.side == "data" and ALL_THE_TIME in f.evidence)]
    own = [with_reports(f, flight) for f in own if not _follows(f, own)]
    return by_severity([*misled_by_turned(misled_by_frozen(own)), *others])


def _follows(finding: Finding, others: Sequence[Finding]) -> bool:
    """Whether a finding is only what another fault looks like from elsewhere.

    A frozen, stuck or turned sensor also looks biased, and misleads the autopilot.
    """
    own_cause = finding.kind in _CAUSES or finding.side == "data"
    return not own_cause and is_led_to(finding.start_s, finding.end_s, others)


def is_led_to(start: float, end: float, others: Sequence[Finding]) -> bool:
    """Whether what lasted so long (s) came of a sensor whose readings are none, and of nothing before that."""
    return any(
        f.kind in _CAUSES and f.severity == "error" and f.start_s < end and f.start_s - 2.0 < start for f in others
    )


_CAUSES = ("stuck_axis", "frozen", "units_wrong", "axes_wrong", "clocks_diverge")


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
    texts = [(t.t, t.text) for t in flight.texts if _speaks(t.text)]
    texts += [(e.t, e.text) for e in flight.events if e.kind in {"error", "event"} and _speaks(e.text)]
    during = [
        (t, text)
        for t, text in texts
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
