"""Ctrl-C and SIGTERM end what serves, in the background of a script too."""

from __future__ import annotations

import signal

import pytest

from tests.processes import COMPANION, ended, next_line, started

pytestmark = pytest.mark.slow

# A shell without job control starts what it puts in the background with SIGINT ignored.
IN_BACKGROUND = ("sh", "-c", "trap '' INT; exec \"$@\"", "sh")


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    ("words", "code"),
    [(("view", "demo", "--port", "0"), 0), (("view", "udpin:127.0.0.1:0", "--no-record"), 2)],
    ids=["a flight", "a link on which nobody is heard"],
)
def test_a_server_in_the_background_is_ended(words: tuple[str, ...], code: int, end: int) -> None:
    with started(*IN_BACKGROUND, *COMPANION, *words) as process:
        assert "http://" in next_line(process, process.stdout)
        said, told = ended(process, end)
    assert (process.returncode, said) == (code, "")
    assert "Traceback" not in told
