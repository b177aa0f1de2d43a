"""Who may connect: our own page and programs, and nobody else's page; and what a browser may say."""

from __future__ import annotations

import contextlib
import gzip
import http.client
import struct
import time
import warnings
from collections.abc import Iterator
from urllib.parse import urlsplit

import pytest
import viser
import websockets
import websockets.asyncio.server
import websockets.exceptions
import websockets.sync.client
from hypothesis import given
from hypothesis import strategies as st

from companion.model import Flight
from companion.view import Viewer
from companion.view.server.origin_check import MOST_BYTES, MOST_PICTURE_BYTES, accepted, guarded, is_own_page, own_names
from tests.view.browser_messages import CAMERA, Message, pack
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


def test_a_page_on_a_network_goes_back_to_what_it_showed() -> None:
    """There browsers send no Sec-Fetch-Site: the page names itself in a header that no other site's can send."""
    with warnings.catch_warnings(), Viewer([make_flight()], recompute, examine, port=0) as viewer:
        assert b'"Companion-Page"' in answer(viewer.url)[1]
        for header in ({}, {"Sec-Fetch-Site": "cross-site", "Companion-Page": "1"}):
            assert get(viewer.url, "/companion-remembered?t=105", **header).status == 204
        assert get(viewer.url, "/companion-remembered?t=110", **{"Companion-Page": "1"}).status == 204
        wait_for(lambda: viewer.player.time == 110.0, "what the page showed last")


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


CLICK: Message = {
    "type": "ScenePointerMessage", "event_type": "click", "ray_origin": [1.0, 2.0, 3.0], "modifier": None,
    "ray_direction": [0.0, 0.6, 0.8], "screen_pos": [[0.5, 0.5]],
}  # fmt: skip
NAN, INF = float("nan"), float("inf")
HOSTILE: list[Message] = [
    CAMERA | {"image_height": 0}, CAMERA | {"image_width": -1}, CAMERA | {"image_height": 1e300},
    CAMERA | {"look_at": [0.0, 0.0, NAN]}, CAMERA | {"position": [INF, 0.0, 0.0]}, CAMERA | {"position": [1.0]},
    CAMERA | {"wxyz": [0.0, 0.0, 0.0, 0.0]}, CAMERA | {"wxyz": [1e-200, 0.0, 0.0, 0.0]}, CAMERA | {"near": 5e-324},
    CAMERA | {"up_direction": [0.0, 0.0, 1e-300]}, CAMERA | {"fov": 0.0}, CAMERA | {"fov": "1"},
    CAMERA | {"near": None},
    {"type": "ViewerCameraMessage"}, {"type": "GuiUpdateMessage", "uuid": "x", "updates": {"value": NAN}},
    {"type": "GuiUpdateMessage", "uuid": "x", "updates": {"content": "<script>"}},
    {"type": "GuiUpdateMessage", "uuid": 7, "updates": {"value": 1}},
    {"type": "GuiUpdateMessage", "uuid": "x", "updates": {"value": "x" * 10_000}},
    {"type": "ShareUrlRequest"}, {"type": "GetRenderResponseMessage", "payload": b"x"},
    {"type": "FileTransferStartUpload", "source_component_uuid": "x", "transfer_uuid": "y", "filename": "z",
     "mime_type": "", "part_count": 1 << 40, "size_bytes": 1 << 60},
    {"type": "FileTransferPart", "source_component_uuid": "x", "transfer_uuid": "y", "part_index": 0, "content": b"0"},
    CLICK | {"event_type": "rect-select"}, CLICK | {"ray_origin": None}, CLICK | {"ray_direction": [0.0, 0.0, 0.0]},
    CLICK | {"ray_direction": [NAN, 0.0, 1.0]}, CLICK | {"screen_pos": []}, CLICK | {"modifier": "shift"},
    {"type": ["unhashable"]}, {"type": None}, {},
]  # fmt: skip


@pytest.mark.parametrize("message", HOSTILE)
def test_what_no_page_sends_is_dropped(message: Message) -> None:
    assert not accepted(pack(message))


def test_what_pages_send_is_heard() -> None:
    assert accepted(pack(CAMERA))
    assert accepted(pack(CLICK))
    assert accepted(pack({"type": "CommandTriggerMessage", "uuid": "a"}))
    for value in (True, 3, 2.5, "Free", [1.0, 2.0], None):
        assert accepted(pack({"type": "GuiUpdateMessage", "uuid": "a", "updates": {"value": value}}))


def picture(width: int, height: int, body: bytes = b"") -> bytes:
    header = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", width, height)
    return pack({"type": "GetRenderResponseMessage", "payload": header + body, "render_uuid": "a"})


def test_a_picture_that_was_asked_for_is_heard() -> None:
    assert accepted(picture(1280, 800))
    assert accepted(picture(3840, 2160, b"x" * 20_000_000))


@pytest.mark.parametrize(
    "raw",
    [
        picture(1 << 20, 1 << 20),
        picture(0, 5),
        picture(10, 10, b"x" * MOST_PICTURE_BYTES),
        pack({"type": "GetRenderResponseMessage", "payload": b"GIF89a" + b"x" * MOST_BYTES, "render_uuid": "a"}),
        pack({"type": "GetRenderResponseMessage", "payload": b"\x89PNG", "render_uuid": "a"}),
        pack({"type": "FileTransferPart", "content": b"x" * MOST_BYTES}),
    ],
    ids=["a bomb", "no pixels", "too long", "no PNG", "no header", "an upload"],
)
def test_a_picture_of_no_bounded_size_is_dropped(raw: bytes) -> None:
    assert not accepted(raw)


@given(st.binary(max_size=200))
def test_any_bytes_get_an_answer(raw: bytes) -> None:
    accepted(raw)


@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.integers(-(2**63), 2**64 - 1) | st.text(max_size=9),
        lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=9), inner, max_size=4),
    )
)
def test_any_field_of_a_camera_may_be_anything(value: object) -> None:
    for name in CAMERA:
        accepted(pack(CAMERA | {name: value}))


def test_too_long_or_too_deep_is_dropped() -> None:
    assert not accepted(b"\x91" * 20_000)
    assert not accepted(pack(CAMERA | {"x": b"0" * MOST_BYTES}))
    assert not accepted("text")


def test_no_message_ends_the_page(flight: Flight, capfd: pytest.CaptureFixture[str]) -> None:
    def attack(url: str) -> None:
        version = websockets.Subprotocol(f"viser-v{viser.__version__}")
        with websockets.sync.client.connect(url, subprotocols=[version], proxy=None, max_size=None) as socket:
            for message in (*map(pack, HOSTILE), b"", b"\xc1", b"\x91" * 20_000, pack(CAMERA)):
                socket.send(message)
            socket.send("text")
            socket.send(pack({"type": "GuiUpdateMessage", "uuid": "none", "updates": {"value": "x"}}))
            time.sleep(0.5)

    with Viewer([flight], recompute, examine, port=0) as viewer:
        attack(viewer.url.replace("http", "ws", 1))
        before = viewer.controller.pose_updates

        def goes_on() -> bool:
            viewer.player.playing = True
            return viewer.controller.pose_updates > before

        wait_for(goes_on, "the page plays on")
        assert not viewer.stopped
    out, err = capfd.readouterr()
    assert "Traceback" not in out + err
