"""The web server under the view: where it may listen, and keeping it quiet."""

from __future__ import annotations

import contextlib
import ipaddress
import secrets
import socket
import warnings
from collections.abc import Iterator
from dataclasses import dataclass

import rich
import viser

from companion.model import InputError
from companion.view.server.origin_check import Visited, guarded, quieten

PORTS_TRIED = 100
_HOSTS = "Use 127.0.0.1 for this machine alone, 0.0.0.0 for every network that it is in, or one of its own addresses."


@dataclass(frozen=True, slots=True)
class Address:
    """A place to listen that was free a moment ago."""

    host: str
    port: int
    loopback: bool
    token: str = ""  # that whoever connects has to know; "" for none

    @property
    def url(self) -> str:
        """What to type into the browser on this machine."""
        host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(self.host, self.host)
        where = f"http://[{host}]:{self.port}" if ":" in host else f"http://{host}:{self.port}"
        return f"{where}/?token={self.token}" if self.token else where

    @property
    def warning(self) -> str | None:
        """The warning to print when others can reach this address too."""
        if self.loopback:
            return None
        return (
            f"Everybody who can reach {self.host}:{self.port} and has the token of its address sees this flight and "
            "can work the controls. Nothing is encrypted: who listens on the network has the token. Safer: leave "
            "--host at 127.0.0.1 and forward the port from your own machine with "
            f"ssh -L {self.port}:127.0.0.1:{self.port} user@host"
        )


def find_address(host: str, port: int, *, or_next: bool = True, token: bool = False) -> Address:
    """The first free port from `port` (0: any) upwards on `host`, or that one alone. Raises InputError for none.

    A token is made up where others than this machine can connect, and on 127.0.0.1 when it is requested (`token`).

    viser has to be spared this: it tries every port on every error, for an address that does not exist too, and
    then waits for ever.
    """
    if not 0 <= port <= 65535:
        raise InputError(f"Port {port} does not exist: choose one from 1 to 65535, or 0 for any free one.")
    try:
        if not host:
            raise OSError("the name is empty")
        addresses = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError, ValueError) as error:
        raise InputError(f"The host {host!r} cannot be resolved ({error}). {_HOSTS}") from error
    places = {(family, str(address[0])) for family, _, _, _, address in addresses}
    for family, address in places:
        if not _bindable(family, address, 0):
            raise InputError(f"{host!r} is {address}, which is not an address of this machine. {_HOSTS}")
    last = min(port + PORTS_TRIED, 65536) - 1 if port and or_next else port
    for candidate in range(port, last + 1):
        if all(_bindable(family, address, candidate) for family, address in places):
            loopback = all(ipaddress.ip_address(address.split("%")[0]).is_loopback for _, address in places)
            return Address(host, candidate, loopback, new_token() if token or not loopback else "")
    ports = f"No port from {port} to {last} can" if last > port else f"Port {port} cannot"
    raise InputError(
        f"{ports} be opened on {host}: taken, or not open to you (below 1024). Choose another, or 0 for any."
    )


def new_token() -> str:
    """What nobody guesses."""
    return secrets.token_hex(24)


def _bindable(family: int, address: str, port: int) -> bool:
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        # As the server will do it: a port that a closed connection still lingers on counts as free.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            probe.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        try:
            probe.bind((address, port))
        except OSError:
            return False
        return True


def open_server(address: Address, visited: Visited = lambda _t, _imu, _again: None) -> viser.ViserServer:
    """Start viser's server there, without its banner, and guarded: see `guarded`.

    visited: called, in the server's event loop, with what an address that is opened requests, `?t=...&imu=...`, or what
    a page remembers.
    """
    with _quiet(), guarded(address.host, address.token, visited):
        # A page may be closed between two writes, and it does not miss what it is not sent.
        warnings.filterwarnings("ignore", message="Queued a .* on a closed connection")
        server = viser.ViserServer(host=address.host, port=address.port, label="companion", verbose=False)
    quieten(server)
    return server


def close_server(server: viser.ViserServer) -> None:
    """Stop it, without its farewell."""
    with _quiet():
        server.stop()


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """viser prints through rich's global console whatever `verbose` is; our stdout belongs to results."""
    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before
