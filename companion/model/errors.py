"""The errors of companion, and the checks of what comes from outside: each message has the cause and the remedy.

Raised where the fact is known, caught only in `companion.cli`, which prints the message and exits with `exit_code`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


class CompanionError(Exception):
    """Base of everything that a user can mend. The message is one or two plain sentences."""

    exit_code = 2


class InputError(CompanionError):
    """A file, link or address that cannot be opened, or holds nothing that we read."""


class DataError(CompanionError):
    """A log that lacks what was requested (no IMU, no attitude, unknown vehicle...), or arrays that do not fit."""


class NoEstimateError(DataError):
    """No best estimate can be made from an IMU.

    imu: its message; why: what its readings lack, without a full stop; remedy: a sentence.
    """

    def __init__(self, imu: str, why: str, remedy: str) -> None:
        super().__init__(imu, why, remedy)  # all of them, or it could not be pickled
        self.why = f"no best estimate from {imu}: {why}"
        self.remedy = remedy

    def __str__(self) -> str:
        return f"{self.why}. {self.remedy}"


class SettingsError(CompanionError):
    """An option or a settings file with an unknown key, a wrong type or a value out of range."""


_NUMBERS = "fiu"
"""Kinds of NumPy's types: floats, signed and unsigned integers."""


def floats(name: str, values: object, shape: tuple[int, ...], *, finite: bool = True) -> npt.NDArray[np.float64]:
    """The values in double precision, whatever numbers they are: integers overflow, float32 loses a flight's time.

    Raises DataError for what is no NumPy array of that shape with numbers in it, and for non-finite ones if `finite`.
    """
    if not isinstance(values, np.ndarray) or values.dtype.kind not in _NUMBERS:
        kind = f"an array of {values.dtype}" if isinstance(values, np.ndarray) else type(values).__name__
        raise DataError(f"{name} must be a NumPy array of numbers, got {kind}: use np.array(..., dtype=float)")
    if values.shape != shape:
        raise DataError(f"{name} must have shape {shape}, got {values.shape}")
    if finite and not np.isfinite(values).all():
        raise DataError(f"{name} holds non-finite values")
    return values.astype(np.float64, copy=False)


def times(name: str, given: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Times (N,) in double precision. Raises DataError unless they are finite and increase strictly."""
    t = floats(name, given, np.shape(given))
    if t.ndim != 1:
        raise DataError(f"{name} must have shape (N,), got {t.shape}")
    if not (rising := t[1:] > t[:-1]).all():
        first = int(np.argmin(rising))
        raise DataError(f"{name} must increase strictly; sample {first + 1} does not follow sample {first}")
    return t


def is_number(value: object) -> bool:
    """Whether it is one finite number."""
    return isinstance(value, int | float | np.integer | np.floating) and bool(np.isfinite(value))


def check_number(name: str, value: float, *, least: float = -np.inf) -> None:
    """Raises SettingsError for what is no finite number, or less than the least."""
    if not is_number(value) or value < least:
        bound = f" and at least {least:g}" if np.isfinite(least) else ""
        raise SettingsError(f"{name} must be finite{bound}, got {value!r}")


def check_seconds(name: str, value: float) -> None:
    """Raises SettingsError for what is no positive number of seconds."""
    if not is_number(value) or not value > 0:
        raise SettingsError(f"{name} must be positive seconds, got {value!r}")
