"""Libraries that only some commands need."""

from __future__ import annotations

from companion.model import InputError


def missing(extra: str, purpose: str) -> InputError:
    """The error for a library of an extra that is not installed, with the command that installs it.

    purpose: what needs which library, as a sentence without its full stop.
    """
    from companion.installation.install_command import install_command  # noqa: PLC0415  (0.1 s, in this case alone)

    return InputError(f"{purpose}. Install it: {install_command(extra)}")
