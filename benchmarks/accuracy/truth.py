"""The best estimate and the autopilot's beside the truth: `python benchmarks/accuracy/truth.py [FILE or FOLDER ...]`.

Of every recording that holds a simulator's truth; without names, of those of ../shared/tlogs beside the checkout that
are labelled as healthy. For each flight 95 % of the error of the best estimate and of the autopilot's, at the keyframes
between take-off and landing, and the NEES divided by its dimension: 1 on average where σ is honest. A single flight is
one draw of what is constant in it, such as the IMU's bias or the iron beside the compass.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.accuracy.cutting import at, attitude_at
from benchmarks.accuracy.labelled import HERE
from benchmarks.accuracy.labels import SHARED, load_labels, recordings
from benchmarks.accuracy.parallel import Failed, each
from companion.api import smooth
from companion.app.recording import read_recording
from companion.comparison import phases
from companion.comparison.budget import nees
from companion.comparison.reference import attitude_error, length
from companion.estimation import ATTITUDE, POSITION, VELOCITY, BestEstimate
from companion.model import Array, CompanionError, Flight, TruthTrack
from companion.strapdown import quaternion

COLUMNS = ("tilt °", "heading °", "velocity m/s", "position m")
BLOCKS = {"attitude": ATTITUDE, "tilt": slice(0, 2), "velocity": VELOCITY, "position": POSITION}
_HEALTHY = {"none", "none_judgeable"}
_LEAST = 10  # keyframes beside which the truth stands


@dataclass(frozen=True, slots=True)
class Row:
    """A flight's figures."""

    name: str
    best: tuple[float, ...]  # 95 % of the error, by COLUMNS; NaN for what the truth does not tell
    autopilot: tuple[float, ...]
    nees: tuple[float, ...]  # by BLOCKS, divided by their dimensions


def error(truth: TruthTrack, t: Array, q_ned_frd: Array, velocity: Array, position: Array) -> Array:
    """(N, 9) truth minus estimate: attitude (rad, NED), velocity, position about its median.

    Truth and estimate count positions from origins of their own.
    """
    q = attitude_at(t, truth.t, quaternion.continuous_sign(truth.q_ned_frd))
    velocity_off, apart = at(t, truth.t, truth.velocity) - velocity, at(t, truth.t, truth.position) - position
    return np.concatenate((attitude_error(q, q_ned_frd), velocity_off, apart - np.median(apart, axis=0)), axis=1)


def sizes(errors: Array) -> tuple[float, ...]:
    """95 % of tilt and heading (degrees), velocity and position."""
    columns = (
        np.degrees(length(errors[:, :2])),
        np.degrees(np.abs(errors[:, 2])),
        length(errors[:, VELOCITY]),
        length(errors[:, POSITION]),
    )
    return tuple(float(np.quantile(column, 0.95)) for column in columns)


def row(name: str, flight: Flight, best: BestEstimate) -> Row | None:
    """None where the truth and what is judged have no time in common."""
    truth, attitude, position = flight.truth, flight.attitude, flight.position
    if truth is None or attitude is None or position is None or not np.isfinite(truth.q_ned_frd).all():
        return None
    first, last = max(truth.t[0], attitude.t[0], position.t[0]), min(truth.t[-1], attitude.t[-1], position.t[-1])
    flown = [one for one in phases(flight) if one.kind == "flight"]
    if flown:
        first, last = max(first, flown[0].start), min(last, flown[-1].end)
    judged = np.flatnonzero((best.t >= first) & (best.t <= last))
    if len(judged) < _LEAST:
        return None
    t = best.t[judged]
    ours = error(truth, t, best.q_ned_frd[judged], best.velocity[judged], best.position[judged])
    theirs = error(
        truth,
        t,
        attitude_at(t, attitude.t, quaternion.continuous_sign(attitude.q_ned_frd)),
        at(t, position.t, position.velocity),
        at(t, position.t, position.position),
    )
    errors = [(ours[:, block], best.covariance[judged, block, block]) for block in BLOCKS.values()]
    return Row(name, sizes(ours), sizes(theirs), tuple(float(nees(e, p).mean() / e.shape[1]) for e, p in errors))


def rows(path: Path) -> list[Row]:
    """Of each flight of a recording that has a truth beside it."""
    out = []
    for flight in read_recording(path).flights:
        if flight.truth is None:
            continue
        try:
            out.append(row(f"{path.parent.name}/{path.name}", flight, smooth(flight)))
        except CompanionError as why:
            print(f"{path.name}: {why}", file=sys.stderr)
    return [one for one in out if one is not None]


def _shown(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.2f}"


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs="*", type=Path, help="recordings, or folders of them")
    parser.add_argument("--workers", type=int, help="processes, default: one for each processor")
    chosen = parser.parse_args()
    paths = [p for path in chosen.paths for p in (recordings(path) if path.is_dir() else [path])]
    if not chosen.paths:
        labels = load_labels(HERE / "labels.toml")
        for path in recordings(SHARED):
            own = [label.truth for label in labels if label.matches(path.relative_to(SHARED).as_posix())]
            paths += [path] if own and own[0] in _HEALTHY else []
        if not paths:
            parser.error(f"no recording below {SHARED} is known to be healthy: name recordings, or a folder of them")
    print(f"| recording | {' | '.join(COLUMNS)} | {' | '.join(f'NEES {name}' for name in BLOCKS)} |")
    print("|---" * (1 + len(COLUMNS) + len(BLOCKS)) + "|")
    flights: list[Row] = []
    for index, result in each(rows, paths, workers=chosen.workers):
        if isinstance(result, Failed):
            print(f"{paths[index]}: {result.reason}", file=sys.stderr)
            continue
        for one in result:
            pairs = [f"{_shown(best)} / {_shown(theirs)}" for best, theirs in zip(one.best, one.autopilot, strict=True)]
            print(f"| {' | '.join((one.name, *pairs, *map(_shown, one.nees)))} |")
        flights += result
    if flights:
        better = sum(one.best[0] <= one.autopilot[0] for one in flights)
        means = np.nanmean([one.nees for one in flights], axis=0)
        print(f"\nTilt at least as good as the autopilot's on {better} of {len(flights)} flights.")
        print("NEES, mean: " + ", ".join(f"{name} {mean:.2f}" for name, mean in zip(BLOCKS, means, strict=True)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
