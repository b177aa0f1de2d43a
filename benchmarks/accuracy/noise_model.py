"""Whether each sensor's noise is what the estimate takes it for: `python benchmarks/accuracy/noise_model.py [LOG ...]`.

λ of a sensor is the median over all onsets of χ² of a step of it, divided by the median of that χ² distribution: 1
where the noise model is right, above it where healthy readings wander more than the model allows, below it where the
model gives power away. Nothing may be wrong in the flights. By chance λ of one flight scatters over 0.3 to 2.5.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from benchmarks.accuracy.injected import NO_LOGS, logs_of
from benchmarks.accuracy.parallel import Failed, each
from companion.app.recording import read_recording
from companion.estimation import hypothesis_of
from companion.estimation.iteration import estimate, start_of
from companion.estimation.scan import scan
from companion.estimation.setup import first_guess, set_up
from companion.estimation.system import Problem
from companion.model import STANDARD_GRAVITY, DataError, Flight

REAL = (
    "real/JAParedes__ulogPX4QuadcopterAnimation__TestFlight1.ulg",
    "real/JAParedes__ulogPX4QuadcopterAnimation__TestFlight2.ulg",
    "real/zlite__PX4_flight_review__3DRFlight_1.ulg.xz",
    "real/zlite__PX4_flight_review__3DRFlight_2.ulg.xz",
    "real/srikanthgoli1__rrc_fault_tolerant_control__10_mm_cut_hover_2.BIN",
    "real/srikanthgoli1__rrc_fault_tolerant_control__25_mm_cut_hover_1.BIN",
    "real/srikanthgoli1__rrc_fault_tolerant_control__good_prop_hover_1.BIN",
    "real/srikanthgoli1__rrc_fault_tolerant_control__good_prop_straight_line_1.BIN",
    "real/spark404__dataflashlog__log.bin",
    "strangers/Mercy2Green__UAV-Flight-Datatset__log_24_2022-12-1-15-02-52.ulg.xz",
)

STEPS: Mapping[str, str] = {
    "gyro": "gyro_bias",
    "accelerometer": "accel_bias",
    "GPS position": "gps_position",
    "GPS height": "gps_height",
    "GPS velocity": "gps_velocity",
    "GPS motion": "gps_motion",
    "compass": "compass_field",
    "barometer": "barometer",
}
"""Sensor → the hypothesis whose step is tried."""

_ONSETS = 48
_MARGIN = 0.1  # of the flight at each end: a step there is told by few readings


def lambdas(flight: Flight) -> dict[str, float]:
    """λ of each sensor of a healthy flight. Raises DataError where the IMU carries no estimate."""
    setup = set_up(flight, None, STANDARD_GRAVITY, None)
    _, linear = estimate(setup, start_of(setup, first_guess(setup, flight)))
    return of_solution(linear)


def of_solution(problem: Problem) -> dict[str, float]:
    """λ of each sensor that has a hypothesis in the problem."""
    grid = scan(problem, _ONSETS)
    t = grid.cuts
    margin = _MARGIN * (t[-1] - t[0])
    onsets = np.flatnonzero((t > t[0] + margin) & (t < t[-1] - margin))
    out = {}
    for sensor, kind in STEPS.items():
        score = grid.score(hypothesis_of(kind), "step", onsets)
        if score is None:
            continue
        b, v = score
        chi2 = np.einsum("ti,tij,tj->t", b, np.linalg.pinv(v, rcond=1e-9, hermitian=True), b)
        m = b.shape[1]
        out[sensor] = float(np.median(chi2) / (m * (1.0 - 2.0 / (9.0 * m)) ** 3))  # Wilson and Hilferty 1931
    return out


def of_recording(path: Path) -> dict[str, float]:
    """λ of the first flight of a recording that carries an estimate."""
    for flight in read_recording(path).flights:
        try:
            return lambdas(flight)
        except DataError:
            continue
    return {}


def lines(found: Mapping[str, Mapping[str, float]]) -> Iterator[str]:
    """A Markdown table: a row for each flight, the median, and the share within [0.5, 2]."""
    yield f"| flight | {' | '.join(STEPS)} |"
    yield "|---" * (len(STEPS) + 1) + "|"
    for name, own in found.items():
        yield f"| {name} | {' | '.join(f'{own[s]:.2f}' if s in own else '' for s in STEPS)} |"
    every = {s: np.array([own[s] for own in found.values() if s in own]) for s in STEPS}
    yield f"| **median** | {' | '.join(f'{np.median(v):.2f}' if len(v) else '' for v in every.values())} |"
    inside = (f"{int(((v >= 0.5) & (v <= 2.0)).sum())} of {len(v)}" for v in every.values())
    yield f"| **within 0.5 to 2** | {' | '.join(inside)} |"


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", type=Path, help="healthy logs or folders, default: the standard set")
    parser.add_argument("--workers", type=int, help="processes, default: one for each processor")
    chosen = parser.parse_args()
    paths = logs_of(chosen.logs, REAL)
    if not paths:
        parser.error(NO_LOGS)
    found = {paths[i].name: said for i, said in each(of_recording, paths, workers=chosen.workers, timeout=120.0)
             if not isinstance(said, Failed)}  # fmt: skip
    print(*lines(dict(sorted(found.items()))), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
