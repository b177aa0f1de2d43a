"""The errors of companion: each message has the cause and the remedy.

Raised where the fact is known, caught only in `companion.cli`, which prints the message and exits with `exit_code`.
"""

from __future__ import annotations


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
