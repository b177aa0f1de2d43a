"""Every IMU of a flight through the same windows: which of them is the odd one out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from companion.analysis.budget import ATTITUDE, POSITION, budget, chi_square_95, nees, stacked
from companion.analysis.comparison import Comparison, windows
from companion.analysis.drift import DriftRow, drift_of
from companion.analysis.figures import ImuFigures, ReferenceFigures
from companion.analysis.finding import Finding
from companion.model import Flight

_HORIZON_S = 5.0
_RATE_HZ = 10.0  # below it an IMU says nothing about itself
_FEWEST = 8  # windows: a share of fewer says little
_GOOD, _BAD = 0.85, 0.75  # share of windows inside the 95 % bound


@dataclass(frozen=True, slots=True, eq=False)
class Sibling:
    """One IMU of several."""

    imu: str
    instance: int
    rate_hz: float
    drift: DriftRow  # after 5 s
    inside: Mapping[str, float]  # attitude, position → share of windows inside the 95 % bound; empty without windows


def siblings(
    flight: Flight,
    compare_imu: Callable[[str], Comparison],
    figures_of: Callable[[str], ImuFigures],
    autopilot: ReferenceFigures,
) -> tuple[Sibling, ...]:
    """Every IMU of the flight with two samples or more, each by its own part's figures."""
    return tuple(
        _sibling(compare_imu(name), figures_of(name), autopilot)
        for name, track in flight.imus.items()
        if len(track) > 1
    )


def odd_one_out(all_of_them: tuple[Sibling, ...]) -> Finding | None:
    """The one IMU that disagrees while another agrees with the autopilot in the same flight.

    Two messages of one instance (RAW_IMU and HIGHRES_IMU) are one IMU.
    """
    judged = [s for s in all_of_them if s.inside and s.rate_hz >= _RATE_HZ and s.drift.windows >= _FEWEST]
    bad = [s for s in judged if min(s.inside.values()) < _BAD]
    good = [s for s in judged if min(s.inside.values()) >= _GOOD]
    if len({s.instance for s in bad}) != 1 or not {s.instance for s in good} - {bad[0].instance}:
        return None
    odd = bad[0]
    worst = min(odd.inside, key=lambda quantity: odd.inside[quantity])
    return Finding(
        "imus_disagree",
        "imu",
        "warning",
        float(odd.drift.errors.anchor_s[0]),
        float(odd.drift.errors.end_s[-1]),
        f"{odd.imu} is inside its bound in {odd.inside[worst]:.0%} of the windows ({worst}), "
        f"{good[0].imu} in {min(good[0].inside.values()):.0%}",
        f"The autopilot and {good[0].imu} agree: it is {odd.imu} that is wrong. Calibrate it; replace "
        "it if that does not mend it.",
    )


def _sibling(comparison: Comparison, figures: ImuFigures, autopilot: ReferenceFigures) -> Sibling:
    chosen = windows(comparison, _HORIZON_S)
    inside: dict[str, float] = {}
    if len(chosen.start):
        total = budget(comparison, chosen, figures, autopilot).total
        error = stacked(comparison, chosen)
        blocks = {"attitude": ATTITUDE, "position": POSITION} if comparison.has_position else {"attitude": ATTITUDE}
        inside = {
            name: float(np.mean(nees(error[:, b], total[:, b, b]) < chi_square_95(3))) for name, b in blocks.items()
        }
    row = drift_of(comparison, (_HORIZON_S,)).rows[0]
    track = comparison.track
    return Sibling(track.source, track.instance, track.rate_hz, row, inside)
