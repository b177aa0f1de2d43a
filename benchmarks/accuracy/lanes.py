"""Lanes of simulated flights against their truth: `python benchmarks/accuracy/lanes.py LOG...`.

A row for each span of each log: the lane that truly was the nearest, the one that is named, and those that are called
off with what they truly were off by. A log needs two lanes or more and the simulator's truth: ArduPilot's .BIN with SIM
and SIM2, PX4's .ulg with the groundtruth topics.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from companion.app.examination import lanes_of
from companion.app.recording import read_recording
from companion.app.settings import Settings
from companion.comparison.reference import attitude_error
from companion.constants import healthy
from companion.model import Array, CompanionError, EstimatorLane, TruthTrack, nearest
from companion.verdict import LaneSpan
from companion.verdict.lanes import healthy_bound


@dataclass(frozen=True, slots=True)
class Row:
    """One span of a log."""

    log: str
    what: str
    start_s: float
    end_s: float
    nearest: str  # by the truth
    off: tuple[str, ...]  # lanes that truly are further off than a healthy one
    flown: tuple[str, ...]
    named: str | None
    called_off: tuple[str, ...]
    sizes: dict[str, dict[str, float]]  # lane → quantity → true error, rad, m/s, m

    @property
    def matters(self) -> bool:
        """Whether a lane that flew truly was off, and another one was not."""
        return bool(set(self.off) & set(self.flown)) and self.nearest not in self.off

    @property
    def is_right(self) -> bool:
        """Whether the nearest lane is named, or one that is further off by less than a healthy one errs."""
        if self.named is None:
            return False
        own, least = self.sizes[self.named], self.sizes[self.nearest]
        return all(own[q] - size <= healthy.AP_SIGMA[q] for q, size in least.items() if q in own)

    @property
    def condemned(self) -> tuple[str, ...]:
        """Good lanes that are called off."""
        return tuple(name for name in self.called_off if name not in self.off)


def true_sizes(lane: EstimatorLane, truth: TruthTrack, start: float, end: float) -> dict[str, float]:
    """Root mean square errors of a lane over a span by the truth: rad, m/s, m. Positions begin together."""
    inside = (lane.t >= max(start, truth.t[0])) & (lane.t <= min(end, truth.t[-1]))
    row = nearest(truth.t, lane.t)
    turn = attitude_error(lane.q_ned_frd, truth.q_ned_frd[row])
    moved, fast = lane.position - truth.position[row], lane.velocity - truth.velocity[row]
    first = np.flatnonzero(np.isfinite(moved).all(axis=1))[:20]
    moved = moved - (np.median(moved[first], axis=0) if len(first) else 0.0)
    parts = {"tilt": turn[:, :2], "heading": turn[:, 2:], "velocity": fast[:, :2], "position": moved[:, :2]}
    parts["height"] = moved[:, 2:]
    return {name: size for name, values in parts.items() if np.isfinite(size := _rms(values[inside]))}


def _rms(values: Array) -> float:
    known = values[np.isfinite(values).all(axis=1)]
    return float(np.sqrt((known**2).sum(axis=1).mean())) if len(known) else float("nan")


def rows(path: Path) -> Iterator[Row]:
    """Every span of a log's first flight."""
    flight = read_recording(path).flights[0]
    truth = flight.truth
    if truth is None or len([one for one in flight.lanes if one.core is not None]) < 2:
        return
    lanes, _ = lanes_of(flight, Settings())
    for span in lanes.spans:
        yield _row(path.name, [one for one in lanes.lanes if one.core is not None], truth, span)


def _row(log: str, lanes: list[EstimatorLane], truth: TruthTrack, span: LaneSpan) -> Row:
    sizes = {one.name: true_sizes(one, truth, span.start_s, span.end_s) for one in lanes}
    common = set.intersection(*(set(one) for one in sizes.values()))
    score = {name: sum((own[q] / healthy.AP_SIGMA[q]) ** 2 for q in common) for name, own in sizes.items()}
    off = tuple(name for name, own in sizes.items() if any(size > healthy_bound(q) for q, size in own.items()))
    called = tuple(one.lane for one in span.lanes if one.off)
    best = min(score, key=lambda name: score[name])
    return Row(log, span.what, span.start_s, span.end_s, best, off, span.flown, span.right, called, sizes)


def main() -> int:
    """A line for each span, and the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("logs", nargs="+", type=Path)
    every: list[Row] = []
    for path in parser.parse_args().logs:
        try:
            for row in rows(path):
                every.append(row)
                print(
                    f"{row.log:26} {row.what:16} {row.start_s:6.1f}-{row.end_s:6.1f}  nearest {row.nearest:14} "
                    f"off {', '.join(row.off) or '-':30} named {row.named or '-':14} "
                    f"called off {', '.join(row.called_off) or '-'}"
                )
                for name, own in row.sizes.items():
                    shown = ", ".join(f"{quantity} {size:.3f}" for quantity, size in own.items())
                    print(f"    {name}: {shown}", flush=True)
        except CompanionError as error:
            print(f"{path.name:26} {error}", flush=True)
    matter = [row for row in every if row.matters]
    right = sum(row.is_right for row in matter)
    wrong = sum(row.named is not None and not row.is_right for row in every)
    print(f"the right lane is named in {right} of {len(matter)} spans in which it mattered, a wrong one in {wrong}")
    print(f"good lanes called off: {sum(len(row.condemned) for row in every)}, in {len(every)} spans")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
