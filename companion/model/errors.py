"""The errors of companion: each message says what was found and what to do about it.

Raised where the fact is known, caught only in `companion.cli`, which prints the message and exits with `exit_code`.
"""

from __future__ import annotations


class CompanionError(Exception):
    """Base of everything that a user can mend. The message is one or two plain sentences."""

    exit_code = 2


class InputError(CompanionError):
    """A file, link or address that cannot be opened, or holds nothing that we read."""


class DataError(CompanionError):
    """A log that lacks what was asked of it (no IMU, no attitude, unknown vehicle...), or arrays that do not fit."""


class SettingsError(CompanionError):
    """An option or a settings file with an unknown key, a wrong type or a value out of range."""
