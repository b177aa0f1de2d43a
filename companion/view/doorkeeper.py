"""Who may connect: a page that this server has sent, and programs. Not the page of another site in the same browser.

Any web page can make its visitor's browser open a WebSocket to 127.0.0.1, and a name that an attacker owns can be made
to mean 127.0.0.1 (DNS rebinding). The first shows in the `Origin` header, the second in `Host`, and a browser lets no
page change either.
"""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import socket
from typing import Any
from urllib.parse import urlsplit

import viser

from companion.view.client_messages import accepted

_log = logging.getLogger(__name__)

POLICY_VIOLATION = 1008  # WebSocket close code, RFC 6455


def own_names(host: str) -> frozenset[str]:
    """The names, besides plain addresses, under which a page of a server at `host` may be called."""
    return frozenset(name.lower() for name in ("localhost", host, socket.gethostname(), socket.getfqdn()) if name)


def is_own_page(host: str | None, origin: str | None, names: frozenset[str]) -> bool:
    """Whether a request with these `Host` and `Origin` headers comes from a page of our own, or from a program.

    An address in numbers cannot be rebound, so any is right: the port may be forwarded from another machine. Programs
    send no `Origin`; browsers always do when they open a WebSocket.
    """
    if host is None:
        return False
    name = _name(f"//{host}")
    if name is None or not (name in names or _is_number(name)):
        return False
    return origin is None or (origin.startswith(("http://", "https://")) and urlsplit(origin).netloc == host)


def admit_only_own_pages(server: viser.ViserServer, host: str) -> None:
    """Close the connection of every other before a single message is sent to it or heard from it.

    viser 1.1 has no hook for this, so two of its private attributes are used: the WebSocket server, which awaits its
    callbacks before it serves a connection, and the table of connections.
    """
    names = own_names(host)
    sockets: Any = server._websock_server

    async def check(websocket: Any) -> None:
        headers = websocket.request.headers
        if not is_own_page(headers.get("Host"), headers.get("Origin"), names):
            await websocket.close(POLICY_VIOLATION, "companion serves only its own page")

    async def joined(connection: Any) -> None:
        websocket = sockets._live_connections[connection.client_id]
        await check(websocket)
        _hear_only_what_is_accepted(websocket)

    sockets.on_client_connect(joined)
    server.get_event_loop().set_exception_handler(_note)
    for early in list(sockets._live_connections.values()):  # between the server's start and this line
        asyncio.run_coroutine_threadsafe(check(early), server.get_event_loop()).result(timeout=10)


def _hear_only_what_is_accepted(websocket: Any) -> None:
    """Let viser receive no message but those that the page sends."""
    receive = websocket.recv

    async def recv() -> bytes:
        while True:
            raw: bytes = await receive()
            if accepted(raw):
                return raw
            _log.debug("a message of a browser was dropped (%d bytes)", len(raw))

    websocket.recv = recv


def _note(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """What viser's own handlers fail at is for who develops, and no traceback in a terminal."""
    _log.debug("in the server: %s", context.get("message"), exc_info=context.get("exception"))


def _name(url: str) -> str | None:
    try:
        return urlsplit(url).hostname
    except ValueError:
        return None


def _is_number(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
