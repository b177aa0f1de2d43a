"""A compass that has turned in its mounting, or whose field has turned: its columns where the angle may be any."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from companion.constants import num
from companion.estimation.candidate import Candidate
from companion.estimation.model import ATTITUDE, CONSTANT_STATES, CONSTANTS
from companion.estimation.shapes import activation
from companion.estimation.system import Measurement, Problem
from companion.model import Array
from companion.strapdown import left_jacobian, quaternion, skew

_FIELD, _ = CONSTANTS["earth_field"]
_SOFT_IRON, _ = CONSTANTS["soft_iron"]
_BY_FIELD = np.r_[_SOFT_IRON, CONSTANTS["compass_latency"][0]]  # whose columns are of the field

_Sized = tuple[Candidate, slice, Array]
"""What is accepted, the place of its sizes among the columns, and the sizes that they were found to be."""


def about_sizes(
    problem: Problem, accepted: Sequence[Candidate], sizes: Array, in_field: Callable[[Array], Measurement]
) -> Problem:
    """The problem with a compass that has turned, or its field, by what that was found to: sizes (m,) of all accepted.

    Its columns are the derivatives there, and its residuals those of sizes that are counted from zero. in_field: what
    the compass would read of an Earth's field (3,) µT: its derivatives are linear in that.
    """
    compass = problem.measurement("compass")
    if compass is None or not sizes.any() or not any(one.hypothesis.turns for one in accepted):
        return problem
    sized, first = list[_Sized](), CONSTANT_STATES
    for one in accepted:
        own, first = slice(first, first + one.unknowns(problem)), first + one.unknowns(problem)
        sized.append((one, own, sizes[own.start - CONSTANT_STATES : own.stop - CONSTANT_STATES]))
    level = complex(*problem.states.constant("earth_field")[:2])
    fields = [part for part in sized if part[0].hypothesis.turns_field]
    turned = _with_turned_field(compass, level, fields, in_field) if fields else compass
    compasses = [part for part in sized if part[0].hypothesis.turns_compass]
    iron = np.eye(3) + problem.states.constant("soft_iron").reshape(3, 3)
    turned = _turned(turned, iron, compasses, [own for _, own, _ in fields])
    from_zero = sum(turned.constants[..., own] @ so_far for _, own, so_far in (*fields, *compasses))
    turned = replace(turned, residual=turned.residual + from_zero)
    return replace(problem, measurements=tuple(turned if m is compass else m for m in problem.measurements))


def _with_turned_field(
    compass: Measurement, level: complex, sized: Iterable[_Sized], in_field: Callable[[Array], Measurement]
) -> Measurement:
    """The compass in a field whose level part, north + i east in µT, has turned."""
    of_field = compass.constants[..., _FIELD]
    changed, by_level = np.zeros(len(compass.t), np.complex128), np.zeros((len(compass.t), 2, 2))
    constants, residual = compass.constants.copy(), compass.residual.copy()
    for one, own, so_far in sized:
        which, size = _of_all_axes(one, so_far, 2)
        as_complex = complex(*size)
        changed += one.change_of_field(compass.t, level, as_complex)
        by_level += jacobian(partial(one.change_of_field, compass.t, size=as_complex), level)
        by_size = jacobian(partial(one.change_of_field, compass.t, level), as_complex)
        constants[..., own] = (of_field[..., :2] @ by_size)[..., which]
    offset = np.column_stack((changed.real, changed.imag, np.zeros(len(changed))))
    residual -= (of_field @ offset[..., None])[..., 0]
    states = compass.states.copy()
    states[..., ATTITUDE] += of_field @ skew(offset)
    for along, unit in zip(offset.T[:2], np.eye(3), strict=False):
        constants[..., _BY_FIELD] += along[:, None, None] * in_field(unit).constants[..., _BY_FIELD]
    constants[..., _FIELD.start : _FIELD.start + 2] += of_field[..., :2] @ by_level
    return replace(compass, residual=residual, states=states, constants=constants)


def _turned(compass: Measurement, iron: Array, sized: Iterable[_Sized], of_field: Sequence[slice]) -> Measurement:
    """The compass turned in its mounting: by R = exp(size) it reads R f in place of the field f in the body.

    A size that is larger by δ makes that exp(J_l δ) R f, so the columns are -[R f]× J_l (J_l: see `left_jacobian`), and
    R turns those of all that changes f. iron: (3, 3), by which the soft iron changes the field. of_field: columns of
    what has turned the field.
    """
    field = compass.constants[:, 0, _SOFT_IRON][:, :3] @ iron.T
    changes_field = np.r_[_FIELD, _BY_FIELD, *of_field]
    for one, own, so_far in sized:
        which, size = _of_all_axes(one, so_far, 3)
        share = activation(one.shape, np.array([one.onset]), np.array([one.end]), compass.t, compass.t)[0][:, None]
        by = quaternion.to_matrix(quaternion.exp(share * size))
        after = (by @ field[..., None])[..., 0]
        by_size = -skew(after) @ left_jacobian(share * size) * share[..., None]
        constants, states = compass.constants.copy(), compass.states.copy()
        constants[..., changes_field] = by @ constants[..., changes_field]
        states[..., ATTITUDE] = by @ states[..., ATTITUDE]
        constants[..., own] = by_size[..., which]
        changes_field = np.r_[changes_field, own]
        compass = replace(compass, residual=compass.residual - (after - field), states=states, constants=constants)
        field = after
    return compass


def _of_all_axes(one: Candidate, so_far: Array, axes: int) -> tuple[slice, Array]:
    """Which of all axes a candidate changes, and its size in all of them (axes,): zero in the others."""
    which, size = slice(one.axis, one.axis + 1) if one.axis >= 0 else slice(0, axes), np.zeros(axes)
    size[which] = so_far
    return which, size


def jacobian(changed: Callable[[complex], npt.NDArray[np.complex128]], at: complex) -> Array:
    """(M, 2, 2) of north and east by north and east, of M complex functions of a complex number."""
    step = num.FIELD_STEP
    columns = [(changed(at + way) - changed(at - way)) / (2.0 * step) for way in (step, 1j * step)]
    return np.stack([np.column_stack((one.real, one.imag)) for one in columns], axis=2)
