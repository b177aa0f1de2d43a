"""Who may connect: our own page and programs, and nobody else's page."""

from __future__ import annotations

import contextlib
import warnings

import pytest
import viser
import websockets.exceptions
import websockets.sync.client

from companion.model import Flight
from companion.view import Viewer
from companion.view.doorkeeper import is_own_page, own_names
from tests.view.circles import examine, recompute
from tests.waiting import LIMIT_S

NAMES = frozenset({"localhost", "pi.local"})


@pytest.mark.parametrize(
    ("host", "origin"),
    [
        ("127.0.0.1:8080", "http://127.0.0.1:8080"),
        ("localhost:9000", "http://localhost:9000"),  # forwarded by ssh to another port
        ("[::1]:8080", "http://[::1]:8080"),
        ("192.168.1.7:8080", "http://192.168.1.7:8080"),
        ("pi.local:8080", "http://pi.local:8080"),
        ("127.0.0.1:8080", None),  # a program
    ],
)
def test_own_pages_are_admitted(host: str, origin: str | None) -> None:
    assert is_own_page(host, origin, NAMES)


@pytest.mark.parametrize(
    ("host", "origin"),
    [
        ("127.0.0.1:8080", "https://evil.example"),  # another site's page
        ("127.0.0.1:8080", "http://127.0.0.1:9999"),  # another program's page
        ("127.0.0.1:8080", "null"),  # a sandboxed frame, a file
        ("evil.example:8080", "http://evil.example:8080"),  # a name made to mean this machine
        ("evil.example:8080", None),
        ("127.0.0.1.evil.example", "http://127.0.0.1.evil.example"),
        (None, None),
        ("[::1", "http://[::1"),
        ("", ""),
    ],
)
def test_other_sites_are_refused(host: str | None, origin: str | None) -> None:
    assert not is_own_page(host, origin, NAMES)


def test_the_address_that_was_asked_for_is_a_name_of_its_own() -> None:
    assert {"localhost", "workshop"} <= own_names("Workshop")


@pytest.mark.parametrize(("origin", "served"), [("https://evil.example", False), (None, True), ("own", True)])
def test_a_foreign_page_hears_nothing(flight: Flight, origin: str | None, served: bool) -> None:
    def first_message(url: str, origin: str | None) -> bytes | str | None:
        version = websockets.Subprotocol(f"viser-v{viser.__version__}")
        headers = {} if origin is None else {"Origin": origin}
        with (
            contextlib.suppress(websockets.exceptions.ConnectionClosed),
            websockets.sync.client.connect(
                url, additional_headers=headers, subprotocols=[version], proxy=None
            ) as socket,
        ):
            return socket.recv(timeout=LIMIT_S)
        return None

    with warnings.catch_warnings(), Viewer([flight], recompute, examine, port=0) as viewer:
        own = viewer.url if origin == "own" else origin
        message = first_message(viewer.url.replace("http", "ws", 1), own)
    assert (message is not None) is served
