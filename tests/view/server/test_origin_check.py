"""Who may connect: our own page and programs, and nobody else's page."""

from __future__ import annotations

import contextlib
import gzip
import http.client
import warnings
from collections.abc import Iterator
from urllib.parse import urlsplit

import pytest
import viser
import websockets.asyncio.server
import websockets.exceptions
import websockets.sync.client

from companion.view import Viewer
from companion.view.server.origin_check import guarded, is_own_page, own_names
from tests.view.circles import examine, make_flight, recompute
from tests.waiting import LIMIT_S, wait_for

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


@pytest.fixture(scope="module")
def open_page() -> Iterator[str]:
    with warnings.catch_warnings(), Viewer([make_flight()], recompute, examine, port=0) as viewer:
        yield viewer.url


@pytest.fixture(scope="module")
def closed_page() -> Iterator[str]:
    """One that asks for a token: its address, with it."""
    with warnings.catch_warnings(), Viewer([make_flight()], recompute, examine, port=0, token=True) as viewer:
        yield viewer.url


def first_message(url: str, **headers: str) -> bytes | str | None:
    """What is heard at an http address, opened as a WebSocket; None where nobody speaks."""
    with (
        contextlib.suppress(websockets.exceptions.WebSocketException),
        websockets.sync.client.connect(
            url.replace("http", "ws", 1),
            additional_headers=headers,
            subprotocols=[websockets.Subprotocol(f"viser-v{viser.__version__}")],
            proxy=None,
        ) as socket,
    ):
        return socket.recv(timeout=LIMIT_S)
    return None


def answer(url: str, path: str = "/", **headers: str) -> tuple[http.client.HTTPResponse, bytes]:
    """What is answered there, and its body."""
    connection = http.client.HTTPConnection(urlsplit(url).netloc, timeout=LIMIT_S)
    try:
        connection.request("GET", path, headers=headers)
        got = connection.getresponse()
        return got, got.read()
    finally:
        connection.close()


def get(url: str, path: str = "/", **headers: str) -> http.client.HTTPResponse:
    return answer(url, path, **headers)[0]


@pytest.mark.parametrize(("origin", "served"), [("https://evil.example", False), (None, True), ("own", True)])
def test_a_foreign_page_hears_nothing(open_page: str, origin: str | None, served: bool) -> None:
    headers = {} if origin is None else {"Origin": open_page if origin == "own" else origin}
    assert (first_message(open_page, **headers) is not None) is served


def test_a_foreign_name_gets_no_page(open_page: str) -> None:
    assert get(open_page).status == 200
    assert get(open_page, Host="evil.example").status == 403


def test_no_page_may_show_ours_in_a_frame(open_page: str, closed_page: str) -> None:
    for answer in (get(open_page), get(open_page, "/nothing"), get(closed_page), get(closed_page, Host="evil.example")):
        assert answer.getheader("Content-Security-Policy") == "frame-ancestors 'none'"
        assert answer.getheader("X-Frame-Options") == "DENY"


@pytest.mark.parametrize("query", ["websocket=ws://evil.example", "playbackPath=https://evil.example/x.viser", "x"])
def test_no_address_makes_the_page_connect_elsewhere(open_page: str, query: str) -> None:
    answer = get(open_page, f"/?{query}")
    assert (answer.status, answer.getheader("Location")) == (303, "./")


def test_without_the_token_nothing_is_served(closed_page: str) -> None:
    bare = closed_page.partition("/?")[0]
    wrong = bare + "/?token=" + "0" * 48
    for answer in (get(bare), get(bare, "/?token="), get(bare, "/?token=%FF"), get(bare, Cookie="a[]=;;")):
        assert answer.status == 403
    for url in (bare, wrong):
        assert first_message(url) is None


def test_the_token_opens_the_page_once_and_the_cookie_from_then_on(closed_page: str) -> None:
    bare, _, query = closed_page.partition("/?")
    answer = get(bare, f"/?{query}")
    assert (answer.status, answer.getheader("Location")) == (303, "./")
    cookie, *attributes = (answer.getheader("Set-Cookie") or "").split("; ")
    assert {"HttpOnly", "SameSite=Lax"} <= set(attributes)
    assert get(bare, Cookie=cookie).status == 200
    assert first_message(bare, Cookie=cookie, Origin=bare) is not None
    assert first_message(bare, Cookie=cookie, Origin="https://evil.example") is None


def test_a_program_says_the_token_in_its_address_or_in_a_header(closed_page: str) -> None:
    bare, _, query = closed_page.partition("/?")
    assert first_message(closed_page) is not None
    assert first_message(bare, Authorization=f"Bearer {query.removeprefix('token=')}") is not None


def test_a_page_of_another_version_is_told_so_and_not_the_terminal(
    open_page: str, capfd: pytest.CaptureFixture[str]
) -> None:
    foreign = [websockets.Subprotocol("viser-v0.0.printed")]
    url = open_page.replace("http", "ws", 1)
    with (
        pytest.raises(websockets.exceptions.ConnectionClosed, match="Version mismatch"),
        websockets.sync.client.connect(url, subprotocols=foreign, proxy=None) as socket,
    ):
        socket.recv(timeout=LIMIT_S)
    assert capfd.readouterr() == ("", "")


def test_a_request_that_is_none_prints_nothing(open_page: str, capfd: pytest.CaptureFixture[str]) -> None:
    for path, headers in [("/", {"Host": "[::1"}), ("/", {"Upgrade": "websocket"}), ("/%00", {}), ("//x/?y", {})]:
        get(open_page, path, **headers)
    assert capfd.readouterr() == ("", "")


def test_a_server_that_is_opened_in_another_way_is_not_left_unguarded() -> None:
    before = websockets.asyncio.server.serve
    with pytest.raises(RuntimeError, match="not guarded"), guarded("127.0.0.1"):
        pass
    assert websockets.asyncio.server.serve is before


@pytest.mark.parametrize("encoding", ["gzip", "identity"])
def test_the_page_is_ours(open_page: str, encoding: str) -> None:
    page = answer(open_page, **{"Accept-Encoding": encoding})[1]
    if encoding == "gzip":
        page = gzip.decompress(page)
    assert b"<title>companion</title>" in page
    assert page.count(b"<title>") == 1
    assert page.index(b"companionCopyLink") < page.index(b"</head>")
    assert b'<div id="root">' in page, "and viser's"


def test_a_page_learns_whether_companion_is_there(open_page: str, closed_page: str) -> None:
    assert get(open_page, "/companion-alive").status == 204
    assert get(closed_page, "/companion-alive").status == 403


def test_an_address_may_ask_for_an_instant_and_an_imu() -> None:
    """Of what there is, and of nothing else; the page itself is served without it."""
    with warnings.catch_warnings(), Viewer([make_flight()], recompute, examine, port=0) as viewer:
        for site, t in (("cross-site", 105.0), ("same-origin", 110.0)):
            assert get(viewer.url, f"/companion-remembered?t={t}", **{"Sec-Fetch-Site": site}).status == 204
        wait_for(lambda: viewer.player.time == 110.0, "what the page showed last")
        answer = get(viewer.url, "/?t=120.5&imu=SCALED_IMU2&websocket=ws://evil.example")
        assert (answer.status, answer.headers["Location"]) == (303, "./")
        wait_for(lambda: viewer.player.time == 120.5, "the instant")
        wait_for(lambda: viewer.controller.scene.imu.label.text.startswith("SCALED_IMU2"), "the IMU")
        for path in ("/?t=nan", "/?t=1e999", "/?t=%00&imu=NONE", "/?imu=" + "x" * 5000):
            assert get(viewer.url, path).status == 303
        assert get(viewer.url, "/?t=130", **{"Sec-Fetch-Dest": "image"}).status == 303
        assert get(viewer.url, "/companion-remembered?t=140", **{"Sec-Fetch-Site": "same-origin"}).status == 204
        assert get(viewer.url, "/?t=125").status == 303
        wait_for(lambda: viewer.player.time == 125.0, "what came before has changed nothing, and the picture least")
