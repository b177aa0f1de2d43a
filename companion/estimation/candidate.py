"""A hypothesis at its likeliest times: its columns in the problem, and once accepted its size and its rivals."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from companion.constants import num, priors
from companion.estimation.differences import score_of_own
from companion.estimation.evidence import Trial, grows_for
from companion.estimation.hypotheses import Hypothesis, Signature
from companion.estimation.model import Explained, Rival
from companion.estimation.shapes import SLOPED, activation
from companion.estimation.system import Problem
from companion.model import Array


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A hypothesis at its likeliest times, which is tried and may be accepted."""

    hypothesis: Hypothesis
    shape: str
    onset: float  # s
    end: float  # s, of a pulse; infinite for what stays
    onset_sigma: float
    axis: int  # the one component that changes; -1 for all
    log_odds: float  # against nothing, see `evidence.Trial`
    fault: float  # probability, if it occurred, that it is harmful
    imu: int | None = None  # the IMU whose it is, where that is not the estimate's
    taken: float = 0.0  # of its size, what the readings have been corrected by: the rest is small, and linear

    @classmethod
    def of_trial(cls, one: Trial) -> Candidate:
        """The likeliest times of a trial."""
        i = one.best
        onset_sigma = max(one.onset_sigma, num.ONSET_SIGMA_S)
        taken = float(one.size[i, 0]) if one.hypothesis.time_shifts else 0.0
        return cls(one.hypothesis, one.shape, float(one.onset[i]), float(one.end[i]), onset_sigma, int(one.axis[i]),
                   one.log_odds, one.fault, one.imu, taken)  # fmt: skip

    def change_of_field(self, t: Array, level: complex, size: complex) -> npt.NDArray[np.complex128]:
        """(M,) µT, north + i east: what the level part of the Earth's field changes by at times t (M,).

        What steps does so by its size; what grows turns evenly, from where it is `level`, and as evenly gets stronger.
        """
        share = activation(self.shape, np.array([self.onset]), np.array([self.end]), t, t)[0]
        if self.shape not in SLOPED:
            return np.asarray(share * size)
        grown = share * size / level
        return np.asarray(level * ((1.0 + grown.real) * np.exp(1j * grown.imag) - 1.0))

    @property
    def name(self) -> tuple[str, str, int | None]:
        """Hypothesis, shape and the IMU whose it is."""
        return self.hypothesis.name, self.shape, self.imu

    @property
    def rival(self) -> Rival:
        """The same as one of several."""
        return Rival(self.hypothesis.name, self.shape, self.log_odds, self.fault, self.imu)

    def explained(self, size: Array, sigma: Array, rivals: tuple[Rival, ...], place: slice | None = None) -> Explained:
        """The same once it is accepted, with its size and what else it could have been."""
        return Explained(self.hypothesis.name, self.shape, self.onset, self.onset_sigma, self.end, size, sigma, rivals,
                         self.imu, place)  # fmt: skip

    def unknowns(self, problem: Problem) -> int:
        """How many sizes of it there are in a problem; 0 where it changes nothing of the estimate."""
        return 0 if (signature := self.of(problem)) is None else signature.unknowns

    def of(self, problem: Problem) -> Signature | None:
        """The signature of what changes; None for what changes nothing of the estimate."""
        if self.imu is not None:
            return None
        whole = self.hypothesis.signature(problem)
        if whole is None or self.axis < 0:
            return whole
        part = slice(self.axis, self.axis + 1)
        motion = None if whole.motion is None else whole.motion[..., part]
        return Signature(motion, {name: values[..., part] for name, values in whole.measurements.items()})


def with_candidate(problem: Problem, candidate: Candidate) -> Problem:
    """The problem with the sizes of a hypothesis as further unknowns."""
    signature = candidate.of(problem)
    mean, sigma = _from_differences(problem, candidate)
    problem = beside(problem, candidate)
    if signature is None:
        return problem
    onset, end = np.array([candidate.onset]), np.array([candidate.end])
    motion, measurements, m = problem.motion, list(problem.measurements), signature.unknowns
    column = np.zeros((*motion.residual.shape, m))
    if signature.motion is not None:
        share = activation(candidate.shape, onset, end, problem.t[:-1], problem.t[1:])[0]
        column = signature.motion * share[:, None, None]
    motion = replace(motion, constants=np.concatenate((motion.constants, column), axis=2))
    for i, one in enumerate(measurements):
        own = np.zeros((*one.residual.shape, m))
        if one.name in signature.measurements:
            shape = candidate.hypothesis.shape_at(one.name, candidate.shape)
            own = signature.measurements[one.name] * activation(shape, onset, end, one.t, one.t)[0][:, None, None]
        measurements[i] = replace(one, constants=np.concatenate((one.constants, own), axis=2))
    prior = replace(
        problem.prior,
        constants_residual=np.concatenate((problem.prior.constants_residual, mean - candidate.taken)),
        constants_sigma=np.concatenate((problem.prior.constants_sigma, sigma)),
    )
    return replace(problem, motion=motion, measurements=tuple(measurements), prior=prior)


def _from_differences(problem: Problem, candidate: Candidate) -> tuple[Array, Array]:
    """What is known of a size beforehand, (m,) and its 1σ: by the other IMUs too, of an error of the estimate's own."""
    times = np.array([candidate.onset]), np.array([candidate.end]), float(problem.t[-1])
    over = grows_for(candidate.shape, *times, priors.RAMP_S)  # s in which a likely size is reached
    b, v = np.zeros(1), np.full(1, (candidate.hypothesis.prior / float(over[0])) ** -2.0)
    if candidate.hypothesis.between_imus and candidate.imu is None and problem.others:
        gradient, information = score_of_own(problem.others, candidate.hypothesis, candidate.shape, *times[:2])
        b, v = gradient[0], v + np.diagonal(information[0])
        if candidate.axis >= 0:
            b, v = b[candidate.axis : candidate.axis + 1], v[candidate.axis : candidate.axis + 1]
    m = candidate.unknowns(problem)
    return np.broadcast_to(b / v, m), np.broadcast_to(v**-0.5, m)


def beside(problem: Problem, candidate: Candidate) -> Problem:
    """The problem whose differences between IMUs leave a candidate free."""
    if not candidate.hypothesis.between_imus:
        return problem
    others = (one.beside(candidate) if candidate.imu in (None, one.instance) else one for one in problem.others)
    return replace(problem, others=tuple(others))
