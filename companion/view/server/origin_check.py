"""Who may connect, and what a browser may send.

A page that this server has sent, and programs; where a token is required, who has it.
Any web page can make its visitor's browser open a WebSocket to 127.0.0.1, and a name that an attacker owns can be made
to mean 127.0.0.1 (DNS rebinding). The first shows in the `Origin` header, the second in `Host`, and a browser lets no
page change either. A page of viser connects to whatever server its address names (`?websocket=`) and runs what that one
sends: no page is served under an address with a query. What an address may request (`?t=100&imu=RAW_IMU`) is
passed to the view thread, which looks it up, and the page is served without it.

The page that is served is viser's with our title, icon and what viser cannot do by itself: page_head.js and
dark_names.js. It sends few kinds of messages, with numbers that are numbers; viser takes any message of any type from
any client and believes what is in it: a canvas of no height divides by zero, NaN ends up in every picture, a request to
share publishes the page on the internet, and upload parts stay in memory.
"""

from __future__ import annotations

import contextlib
import functools
import gzip
import hmac
import http
import http.cookies
import ipaddress
import logging
import math
import re
import socket
import threading
from collections.abc import Awaitable, Callable, Iterator
from importlib.resources import files
from typing import Annotated, Any, Literal
from urllib.parse import parse_qs, quote, urlsplit

import msgspec
import viser
import websockets.asyncio.server
from msgspec import Meta
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from companion.present import palette

MOST_BYTES = 1 << 16
MOST_PICTURE_BYTES = 1 << 25
_MOST_PIXELS = 1 << 25  # 8K and a little: a small PNG may claim to be of any size, and is unpacked to it
_MOST = 1e9  # m, pixels, s: nothing in a picture is larger
_LONGEST = 256  # characters of a name or a choice
_SEVERAL = 16  # numbers in one control
_LEAST = 1e-9  # of what is positive, and of the length of a direction: nothing is divided by less
_PNG = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR"

Number = Annotated[float, Meta(ge=-_MOST, le=_MOST)]  # which NaN is not
Positive = Annotated[float, Meta(gt=_LEAST, le=_MOST)]
Pixels = Annotated[int, Meta(gt=0, le=int(_MOST))]
Name = Annotated[str, Meta(max_length=_LONGEST)]
Numbers = Annotated[list[Number], Meta(max_length=_SEVERAL)]
Vector = tuple[Number, Number, Number]
Quaternion = tuple[Number, Number, Number, Number]


class _Whole(msgspec.Struct, forbid_unknown_fields=True):
    """Has its fields, and no others."""


class _Camera(_Whole, tag="ViewerCameraMessage"):
    wxyz: Quaternion
    position: Vector
    look_at: Vector
    up_direction: Vector
    fov: Annotated[float, Meta(gt=_LEAST, lt=math.pi)]
    near: Positive
    far: Positive
    image_height: Pixels
    image_width: Pixels

    def __post_init__(self) -> None:
        _check(math.hypot(*self.wxyz) > _LEAST and math.hypot(*self.up_direction) > _LEAST)


class _Updates(_Whole):
    value: bool | Number | Name | Numbers | None


class _Update(_Whole, tag="GuiUpdateMessage"):
    uuid: Name
    updates: _Updates


class _Command(_Whole, tag="CommandTriggerMessage"):
    uuid: Name


class _Click(_Whole, tag="ScenePointerMessage"):
    event_type: Literal["click"]
    ray_origin: Vector
    ray_direction: Vector
    screen_pos: tuple[tuple[Number, Number]]
    modifier: None

    def __post_init__(self) -> None:
        _check(math.hypot(*self.ray_direction) > _LEAST)


class _Picture(_Whole, tag="GetRenderResponseMessage"):
    """The canvas that was requested, a PNG of a bounded size; viser drops one that was not requested."""

    payload: bytes
    render_uuid: Name

    def __post_init__(self) -> None:
        size = self.payload[len(_PNG) : len(_PNG) + 8]
        _check(self.payload.startswith(_PNG) and len(size) == 8)
        _check(0 < int.from_bytes(size[:4]) * int.from_bytes(size[4:]) <= _MOST_PIXELS)


def _check(right: bool) -> None:
    if not right:
        raise ValueError


KINDS = frozenset(one.__struct_config__.tag for one in (_Camera, _Update, _Command, _Click, _Picture))
"""All that is received: what the controls of the pages make a browser send. A new kind of control may need another."""
_MESSAGE = msgspec.msgpack.Decoder(_Camera | _Update | _Command | _Click | _Picture)
_LONG_MESSAGE = msgspec.msgpack.Decoder(_Picture)  # nothing is built of what is none, whatever its length


def accepted(raw: object) -> bool:
    """Whether a message is one that the page sends, and whole."""
    if not isinstance(raw, bytes) or len(raw) > MOST_PICTURE_BYTES:
        return False
    try:
        (_MESSAGE if len(raw) <= MOST_BYTES else _LONG_MESSAGE).decode(raw)
    except (ValueError, TypeError, RecursionError):  # msgspec.DecodeError is a ValueError
        return False
    return True


_ALIVE = "/companion-alive"
"""Requested by an open page, to know whether companion is still there."""
_REMEMBERED = "/companion-remembered"
"""Requested by a page that has just been opened, with the instant and the IMU that it showed last."""
_OWN_PAGE = "Companion-Page"
"""A header that our page sends with it. Another site's page would have to ask first, and is not answered."""
_TITLE = re.compile(rb"<title>.*?</title>", re.DOTALL)
_ICON = re.compile(rb'<link\s+rel="icon".*?/>', re.DOTALL)
_log = logging.getLogger(__name__)
_log_of_connections = logging.getLogger(f"{__name__}.connections")
_log_of_connections.propagate = False  # a request that is none is no traceback in a terminal
_log_of_connections.addHandler(logging.NullHandler())

_MOST_BROWSERS = 32
_PROTOCOL_ERROR, _TRY_AGAIN_LATER = 1002, 1013  # WebSocket close codes
_COOKIE_DAYS = 30
_HEADERS = {
    "Content-Security-Policy": "frame-ancestors 'none'",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
_patching = threading.Lock()

Visited = Callable[[str, str, bool], None]
"""Called with the instant and the IMU that are requested, "" for none, and whether a page only remembers them."""
Handler = Callable[[ServerConnection], Awaitable[None]]
Answer = Callable[[ServerConnection, Request], Response | None]


def own_names(host: str) -> frozenset[str]:
    """The names, besides plain addresses, under which a page of a server at `host` may be called."""
    return frozenset(name.lower() for name in ("localhost", host, socket.gethostname(), socket.getfqdn()) if name)


def is_own_page(host: str | None, origin: str | None, names: frozenset[str]) -> bool:
    """Whether a request with these `Host` and `Origin` headers comes from a page of our own, or from a program.

    An address in numbers cannot be rebound, so any is right: the port may be forwarded from another machine. Programs
    send no `Origin`; browsers always do when they open a WebSocket.
    """
    try:
        name = urlsplit(f"//{host or ''}").hostname or ""
    except ValueError:
        return False
    if name not in names and not _is_number(name):
        return False
    return origin is None or (origin.startswith(("http://", "https://")) and urlsplit(origin).netloc == host)


@contextlib.contextmanager
def guarded(host: str, token: str = "", visited: Visited = lambda _t, _imu, _again: None) -> Iterator[None]:
    """Guard the viser server that is made inside, at `host`. Raises RuntimeError when viser makes none as it did.

    token: required of whoever connects; "" for none. viser 1.1 has no hook for requests: what it calls to open its
    WebSocket server is replaced meanwhile.
    """
    opened: list[bool] = []
    with _patching:
        serve: Any = websockets.asyncio.server.serve

        def guarded_serve(handler: Handler, *places: Any, process_request: Answer, **options: Any) -> Any:
            opened.append(True)
            options |= {"max_size": MOST_PICTURE_BYTES + 1, "logger": _log_of_connections, "server_header": None}
            return serve(
                _filtered(handler),
                *places,
                process_request=_checked(process_request, own_names(host), token, visited),
                process_response=_marked,
                **options,
            )

        websockets.asyncio.server.serve = guarded_serve  # type: ignore[assignment, misc]
        try:
            yield
        finally:
            websockets.asyncio.server.serve = serve  # type: ignore[misc]
    if not opened:
        raise RuntimeError(f"viser {viser.__version__} opens its server in another way than 1.1: it is not guarded")


def _checked(answer: Answer, names: frozenset[str], token: str, visited: Visited) -> Answer:
    """The answer to a request: a refusal, or what viser answers."""

    def is_right(given: str) -> bool:
        return not token or hmac.compare_digest(given.encode(errors="replace"), token.encode())

    def answered(connection: ServerConnection, request: Request) -> Response | None:
        headers, address = request.headers, urlsplit(request.path)
        if not is_own_page(headers.get("Host"), headers.get("Origin"), names):
            return connection.respond(http.HTTPStatus.FORBIDDEN, "companion serves only its own page.\n")
        query = parse_qs(address.query)
        given, t, imu = (query.get(name, [""])[-1] for name in ("token", "t", "imu"))
        cookie = f"companion-{connection.local_address[1]}"
        if not any(map(is_right, (given, _cookie(headers, cookie), _bearer(headers)))):
            return connection.respond(
                http.HTTPStatus.FORBIDDEN, "Open the whole address that companion has printed, with the token in it.\n"
            )
        if address.path in (_ALIVE, _REMEMBERED):
            # No other site's page moves what is shown. Browsers send Sec-Fetch-Site over http to this computer alone.
            site = headers.get("Sec-Fetch-Site", "same-origin" if _OWN_PAGE in headers else "")
            if address.path == _REMEMBERED and site == "same-origin":
                visited(t, imu, True)
            return connection.respond(http.HTTPStatus.NO_CONTENT, "")
        if not address.query or headers.get("Upgrade") == "websocket":
            return _ours(answer(connection, request))
        # Only what a person opens: no picture or frame of another site's page moves what is shown.
        if headers.get("Sec-Fetch-Dest", "document") == "document":
            visited(t, imu, False)
        there = connection.respond(http.HTTPStatus.SEE_OTHER, "")
        there.headers["Location"] = "./"
        if token:
            age = f"Max-Age={86400 * _COOKIE_DAYS}"
            there.headers["Set-Cookie"] = f"{cookie}={token}; {age}; HttpOnly; SameSite=Lax; Path=/"
        return there

    return answered


def _filtered(handler: Handler) -> Handler:
    """Let viser serve pages of its own version, of whose messages it receives those that the page sends."""
    present: set[ServerConnection] = set()
    protocol = f"viser-v{viser.__version__}"

    async def filtered(connection: ServerConnection) -> None:
        if connection.subprotocol != protocol:
            await connection.close(_PROTOCOL_ERROR, f"Version mismatch. Server: {viser.__version__}")
            return
        if len(present) >= _MOST_BROWSERS:
            await connection.close(_TRY_AGAIN_LATER, "too many pages are open")
            return
        present.add(connection)
        _receive_only_what_is_accepted(connection)
        try:
            await handler(connection)
        finally:
            present.discard(connection)

    return filtered


def quieten(server: viser.ViserServer) -> None:
    """What viser's own handlers fail at is for who develops, and no traceback in a terminal."""

    def note(_: object, context: dict[str, Any]) -> None:
        _log.debug("in the server: %s", context.get("message"), exc_info=context.get("exception"))

    server.get_event_loop().set_exception_handler(note)


def _receive_only_what_is_accepted(connection: Any) -> None:
    """Let viser receive no message but those that the page sends."""
    receive = connection.recv

    async def recv() -> bytes:
        while True:
            raw: bytes = await receive()
            if accepted(raw):
                return raw
            _log.debug("a message of a browser was dropped (%d bytes)", len(raw))

    connection.recv = recv


def _ours(there: Response | None) -> Response | None:
    """viser's page with what is ours in it; everything else as it is."""
    if there is None or there.status_code != http.HTTPStatus.OK:
        return there
    if not there.headers.get("Content-Type", "").startswith("text/html"):
        return there
    there.body = _dressed(bytes(there.body), there.headers.get("Content-Encoding", "identity"))
    del there.headers["Content-Length"]
    there.headers["Content-Length"] = str(len(there.body))
    return there


def _marked(_: ServerConnection, __: Request, response: Response) -> None:
    """Every answer says that no other page may show it in a frame."""
    response.headers.update(_HEADERS)


def _cookie(headers: Headers, name: str) -> str:
    """The value of a cookie; "" when the browser sends none, or what is no cookie."""
    try:
        cookie = http.cookies.SimpleCookie("; ".join(headers.get_all("Cookie"))).get(name)
    except http.cookies.CookieError:
        return ""
    return cookie.value if cookie else ""


def _bearer(headers: Headers) -> str:
    """What a program sends in `Authorization: Bearer TOKEN`."""
    scheme, _, token = (headers.get("Authorization") or "").partition(" ")
    return token if scheme.lower() == "bearer" else ""


def _is_number(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


@functools.lru_cache(maxsize=4)
def _dressed(body: bytes, encoding: str) -> bytes:
    """viser's page with our title, icon and script. encoding: "gzip" or "identity", of `body` and of what comes back.

    Raises RuntimeError for a page that has not what viser 1.1's has.
    """
    plain = gzip.decompress(body) if encoding == "gzip" else body
    scripts = b"".join(script_of(name).encode() for name in ("dark_names.js", "page_head.js"))
    icon = f'<link rel="icon" href="data:image/svg+xml,{quote(_icon())}" />'.encode()
    for pattern, ours in ((_TITLE, b"<title>companion</title>"), (_ICON, icon)):
        match = pattern.search(plain)
        if match is None:
            raise RuntimeError("viser's page has no title or icon where 1.1 has it")
        plain = plain[: match.start()] + ours + plain[match.end() :]
    plain = plain.replace(b"<head>", b"<head>" + scripts, 1)
    return gzip.compress(plain) if encoding == "gzip" else plain


def script_of(name: str) -> str:
    """A script of ours, to be put into the head of a page."""
    return f"<script>{(files('companion.view.server') / name).read_text(encoding='utf-8')}</script>"


def _icon() -> str:
    """Two paths that part, in the colours of IMU and autopilot."""
    lines = (("M4 28C12 24 14 10 28 5", palette.AUTOPILOT), ("M4 28C14 26 20 22 28 20", palette.IMU))
    drawn = "".join(
        f'<path d="{path}" fill="none" stroke="{palette.css(colour)}" stroke-width="5" stroke-linecap="round"/>'
        for path, colour in lines
    )
    return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32">{drawn}</svg>'
