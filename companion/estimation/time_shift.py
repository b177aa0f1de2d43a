"""Readings that come late by much: put at the times that they speak of, not corrected by a slope.

Where a vehicle was a second ago is no straight line from where it is. So of a kind that moves readings in time the
linear size is taken out of the readings, which go to other keyframes, and asked for again, until little is left: where
the readings would speak of what has not happened yet, it is not the time that is off. What it explained where the
vehicle did not move says little of its onset: that is sought again with its size known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.constants import num
from companion.estimation.candidate import Candidate
from companion.estimation.iteration import Start, estimate, preintegrated
from companion.estimation.linearisation import Linear, linearise
from companion.estimation.search import times_of_change
from companion.estimation.setup import Setup
from companion.estimation.shapes import activation
from companion.estimation.system import misfit
from companion.model import Array

Limits = Mapping[str, tuple[float, float]]


@dataclass(frozen=True, slots=True, eq=False)
class TimeShifted:
    """The readings at the times that they speak of if a candidate is right, and the candidate so found."""

    setup: Setup
    candidate: Candidate
    estimated: tuple[Start, Linear] | None = None  # of both, where that was needed to find them


def time_shifted(
    setup: Setup, start: Start, accepted: Sequence[Candidate], candidate: Candidate, limits: Limits | None = None
) -> TimeShifted | None:
    """The problem with the readings where a candidate puts them.

    As it is where the candidate moves no readings in time, or its size does not settle; None where readings would
    speak of what has not happened yet. limits: of the densities of the IMU, see `estimate`.
    """
    if not candidate.hypothesis.time_shifts:
        return TimeShifted(setup, candidate)
    linearly, moved, settled = candidate, setup, start
    for searched in (False, True):
        for _ in range(num.LATENCY_ROUNDS):
            settled, linear = estimate(moved, start, [*accepted, candidate], limits)
            further = float(linear.solution.c[-1])
            if abs(further) < num.LATENCY_CONVERGED_S:
                break
            candidate = replace(candidate, taken=candidate.taken + further)
            if candidate.taken < -float(settled.states.constant("gps_latency")[0]):
                return None
            moved = _moved(setup, candidate)
        else:
            return TimeShifted(setup, linearly)
        if searched or candidate.shape != "step" or abs(candidate.taken) < num.LATENCY_SEARCHED_S:
            break
        candidate = _with_onset(setup, settled, accepted, candidate)
        moved = _moved(setup, candidate)
    return TimeShifted(moved, candidate, (settled, linear))


def _moved(setup: Setup, candidate: Candidate) -> Setup:
    """The readings at the times that they speak of, while the candidate is at work."""
    onset, end = np.array([candidate.onset]), np.array([candidate.end])
    readings = tuple(
        one.later(candidate.taken * activation(candidate.shape, onset, end, one.t, one.t)[0], setup.t)
        if one.name in candidate.hypothesis.time_shifts
        else one
        for one in setup.readings
    )
    return replace(setup, readings=readings)


def _with_onset(setup: Setup, settled: Start, accepted: Sequence[Candidate], candidate: Candidate) -> Candidate:
    """The candidate from when on the readings fit best, its size known, at the noise that was learned."""
    states, path = settled.states, preintegrated(setup, settled.states, settled.path)

    def misfits(onsets: Array) -> Array:
        """Each less what as many readings leave that fit: some may be moved out of the flight."""
        excess = []
        for onset in onsets:
            one = replace(candidate, onset=float(onset))
            linear = linearise(
                _moved(setup, one), path, states, settled.noise, settled.scale, {}, settled.slow, [*accepted, one]
            )
            fitting = sum(m.residual.size for m in linear.measurements)
            excess.append(misfit(linear.motion, linear.measurements, linear.solution) - fitting)
        return np.array(excess)

    first, last = times_of_change(setup.t)
    onsets = np.linspace(first, last, num.LATENCY_ONSETS)
    left, step = misfits(onsets), float(onsets[1] - onsets[0])
    for _ in range(num.LATENCY_REFINEMENTS):
        fine = np.clip(onsets[np.argmin(left)] + step * np.linspace(-1.0, 1.0, num.LATENCY_FINE_ONSETS), first, last)
        onsets, where = np.unique(np.concatenate((onsets, fine)), return_index=True)
        left = np.concatenate((left, misfits(fine)))[where]
        step = 2.0 * step / (num.LATENCY_FINE_ONSETS - 1)
    best = float(onsets[np.argmin(left)])
    likely = np.gradient(onsets) * np.exp(0.5 * (left.min() - left))
    sigma = float(np.sqrt(likely @ (onsets - best) ** 2 / likely.sum()))
    return replace(candidate, onset=best, onset_sigma=max(sigma, num.ONSET_SIGMA_S))
