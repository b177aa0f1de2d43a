"""Findings about the loss of control, and what is left of the others beside it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from companion.analysis.finding import Finding, by_severity
from companion.analysis.findings.readings import reading_findings
from companion.analysis.imu_spec import ImuSpec
from companion.analysis.loss_of_control import unjudged
from companion.constants import check
from companion.model import Flight, ImuTrack, Phase


def when_lost(
    told: Sequence[Finding], flight: Flight, track: ImuTrack | None, parts: Sequence[Phase], figures: ImuSpec
) -> tuple[Finding, ...]:
    """The findings of a flight, with what tells that control was lost and without what came of that.

    track: the IMU with its readings out of control, None where there is none. A gyro at the end of its range is a
    consequence then, and takes the estimator along; whatever else is read accuses nobody. What begins out of control
    and goes on after it is a fault.
    Evidence in the last second of a log is worth nothing.
    """
    lost, out = [part for part in parts if part.kind == "impact"], unjudged(parts)
    end = flight.start + flight.duration if track is None else float(track.t[-1])
    kept = [
        f for f in told if not any(begin <= f.start_s and f.end_s < over + check.WORTHLESS_S for begin, over in out)
    ]
    kept = [replace(f, severity="info", cause=None) if f.start_s > end - check.WORTHLESS_S else f for f in kept]
    said: list[Finding] = []
    for part in lost:
        clipping: Iterable[Finding] = ()
        if track is not None:
            falling = track[slice(*np.searchsorted(track.t, [part.start, part.end]).tolist())]
            clipping = reading_findings(falling, flight.require_attitude(), figures) if len(falling) > 1 else ()
        tumbling = [f for f in clipping if f.kind == "gyro_clipping"]
        said += [_control_lost(flight, part, tumbling), *(_as_consequence(f) for f in tumbling)]
    return by_severity((*said, *kept))


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
