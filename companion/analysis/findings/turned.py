"""Findings about compass and IMU that are turned against each other since the start of the log.

Two sensors do not tell which of them sits otherwise than its setting says. A third does: gravity, or the vehicle's own
control. What hangs at its thrust and flew upright had its IMU right to half of 45° about every axis: with a board that
is turned further it would have leant another way than it was told to, and turned over.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from companion.analysis.finding import Cause, Finding
from companion.analysis.loss_of_control import UPRIGHT, down_in_body
from companion.analysis.parameters import board_orientation, compass_orientation, is_internal, mended
from companion.analysis.phases import flown, phases
from companion.constants import num
from companion.estimation import BestEstimate, TurnedCompass, righted, turned_compasses
from companion.model import Array, Flight, orientation_name, orientations
from companion.strapdown import quaternion


def righted_compasses(
    flight: Flight, best: BestEstimate, without_compass: Callable[[Flight], BestEstimate]
) -> tuple[Flight, list[Finding]]:
    """The flight with compasses turned as they have to be, and a finding for each; as it is where none is turned.

    best, without_compass: as for `turned_compasses`.
    """
    turned = turned_compasses(flight, best, without_compass)
    return (righted(flight, turned) if turned else flight), [_finding(flight, one, best) for one in turned]


def _finding(flight: Flight, one: TurnedCompass, best: BestEstimate) -> Finding:
    turn = orientations()[one.orientation]
    internal = bool(is_internal(flight, one.instance))  # a board that is turned takes it along
    sure = internal or _imu_is_right(flight, best, turn)
    board = board_orientation(flight)
    compass = mended(flight, compass_orientation(flight, one.instance), turn, board if internal else "")
    what = "" if sure else " and the IMU are turned against each other"
    how = (
        f"the compass ({one.source}){what or ' is turned'} by {orientation_name(one.orientation)} since the start of "
        f"the log: so turned, its readings are {np.degrees(one.left):.0f}° off the Earth's field, as they are "
        f"{np.degrees(one.off):.0f}°"
    )
    begin, end = float(best.t[0]), float(best.t[-1])
    if not sure:
        told = f"{how}; which of them sits so, or is set so, cannot be told"
        turned_board = mended(flight, board, quaternion.conjugate(turn))
        advice = f"Set {compass} if the compass is mounted so, or {turned_board} if the board is."
        return Finding("compass_orientation", "data", "warning", begin, end, told, advice, undecided=True)
    size = float(2.0 * np.arccos(min(abs(turn[0]), 1.0)))
    cause = Cause("compass_orientation", "data", begin, sensor="compass", size=size, unit="rad")
    advice = f"Set {compass}, and calibrate the compass again."
    if internal:
        advice = f"It is set to be internal, turned with {board}: if it is external, say so and set {compass}."
    return Finding("compass_orientation", "data", "warning", begin, end, how, advice, how, cause)


def _imu_is_right(flight: Flight, best: BestEstimate, turn: Array) -> bool:
    """Whether gravity or the vehicle's control says that the IMU cannot be turned by the reverse of a rotation (4,).

    Gravity tells of a rotation that leaves down not where it is: half of the time the vehicle is nearly upright.
    """
    half = np.cos(num.ORIENTATION_HALF_RAD)
    upright = float(np.median(down_in_body(best.q_ned_frd)[:, 2])) > half
    tilts = float(down_in_body(turn[None])[0, 2]) < half
    flew = flight.vehicle.type in UPRIGHT and bool(flown(phases(flight)))
    return upright and (tilts or flew)


_SHOWS = ("heading_off", "heading_jump", "velocity_off", "position_off", "compass_turn")


def misled_by_turned(findings: Sequence[Finding]) -> list[Finding]:
    """The findings, where a turned compass misled the autopilot with that as the cause.

    Where it may be the board as well, what it led to accuses nobody.
    """
    turned = next((one for one in findings if one.kind == "compass_orientation"), None)
    led = [f for f in findings if f.kind in _SHOWS and f.side == "autopilot" and f.severity == "error"]
    if turned is None or not led:
        return list(findings)
    words = led[0].headline or led[0].evidence
    said = f"{turned.evidence}; the autopilot was misled by it: {words}"
    if turned.undecided:
        instead = {id(f): replace(f, side="data", severity="warning", undecided=True) for f in led}
        instead[id(turned)] = replace(turned, evidence=said)
    else:
        consequences = tuple(f.headline or f.evidence for f in led)
        cause = None if turned.cause is None else replace(turned.cause, side="autopilot", consequences=consequences)
        instead = {id(turned): replace(turned, side="autopilot", severity="error", evidence=said, cause=cause)}
    return [instead.get(id(f), f) for f in findings]
