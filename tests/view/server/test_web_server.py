"""Where the page may be served, and what the user reads when it may not."""

from __future__ import annotations

import socket
import urllib.request

import pytest

from companion.model import DataError, Flight, InputError
from companion.view import Viewer
from companion.view.server.web_server import find_address
from tests.view.circles import examine, make_flight, recompute
from tests.waiting import LIMIT_S


def test_a_taken_port_becomes_the_next_one_and_is_told(flight: Flight, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with Viewer([flight], recompute, examine, port=port) as viewer:
            assert viewer.port > port
            assert viewer.url == f"http://127.0.0.1:{viewer.port}"
            assert viewer.warning is None
            # Read to its end: a connection that is half made when the server stops is never closed.
            with urllib.request.urlopen(viewer.url, timeout=LIMIT_S) as page:
                assert b"companion" in page.read()
    assert capsys.readouterr().out == ""  # stdout belongs to results


@pytest.mark.parametrize("host", ["no-such-host.invalid", "", "256.1.1.1", "x" * 300, "192.0.2.1"])
def test_a_host_that_is_not_here_is_refused_in_words(host: str) -> None:
    with pytest.raises(InputError, match=r"Use 127\.0\.0\.1"):
        find_address(host, 0)


@pytest.mark.parametrize("port", [-1, 65536, 10**9])
def test_a_port_that_does_not_exist_is_refused(port: int) -> None:
    with pytest.raises(InputError, match="choose one from 1 to 65535"):
        find_address("127.0.0.1", port)


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1"])
def test_loopback_needs_no_warning(host: str) -> None:
    try:
        address = find_address(host, 8080)
    except InputError:
        pytest.skip(f"this machine has no {host}")
    assert address.warning is None


def test_other_hosts_get_a_warning_with_the_safer_way() -> None:
    address = find_address("0.0.0.0", 8080)
    assert address.warning is not None
    assert f"ssh -L {address.port}:127.0.0.1:{address.port} user@host" in address.warning
    assert address.url == f"http://127.0.0.1:{address.port}/?token={address.token}"
    assert len(address.token) == 48
    assert address.token != find_address("0.0.0.0", 8080).token


def test_a_flight_that_cannot_be_shown_raises_before_anything_is_served() -> None:
    with pytest.raises(InputError, match="no flight"):
        Viewer([], recompute, examine)
    flight = make_flight()
    hollow = Flight(flight.vehicle, 1, flight.start, flight.duration)
    with pytest.raises(DataError, match="no attitude"):
        Viewer([hollow], recompute, examine)


def test_a_bug_in_the_view_thread_is_raised_by_run(flight: Flight, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(_: float) -> None:
        raise ZeroDivisionError

    viewer = Viewer([flight], recompute, examine, port=0)
    monkeypatch.setattr(viewer.player, "advance", broken)
    with pytest.raises(ZeroDivisionError):
        viewer.run()
