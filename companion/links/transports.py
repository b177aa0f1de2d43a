"""What a link is called, and its bytes over UDP, TCP and serial lines (pyserial), which come back after it went.

Sockets of our own and not pymavlink's `mavutil`, although it has all of these kinds: there a second program binds a
taken UDP port without an error and steals the packets (SO_REUSEADDR), the end of a TCP peer is never noticed by
`tcpin`, a reconnecting `tcp` sleeps inside `recv`, failures are printed on stdout, and reads stop at the size of one
message.
"""

from __future__ import annotations

import contextlib
import errno
import re
import select
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, Protocol, TypeVar

from companion.model import InputError, nearest_word

Kind = Literal["udpin", "udpout", "tcp", "tcpin", "serial"]

_DEFAULT_BAUD = 115_200
"""What USB flight controllers ignore and most telemetry ports of the boards use; SiK radios are set to 57600."""

_NETWORK = re.compile(r"(udpin|udpout|udp|tcpin|tcp):(?:(.*):)?(\d+)")
_KINDS: dict[str, Kind] = {"udpin": "udpin", "udpout": "udpout", "udp": "udpin", "tcpin": "tcpin", "tcp": "tcp"}
_PLACE = re.compile(r"(.*:)?\d+")
_SERIAL = re.compile(r"(?:serial:)?(/.+?|COM\d+)(?::(\d+))?", re.IGNORECASE)
_MEANT = re.compile(r"(udp|tcp)\w*(:|$)|serial:|/dev/(tty|serial/|cu|rfcomm)|COM\d+(:|$)", re.IGNORECASE)
_FORMS = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT or a device like /dev/ttyACM0:115200"


@dataclass(frozen=True, slots=True)
class Address:
    """Where a link goes."""

    kind: Kind
    host: str = ""  # a name or number; for the kinds that wait for others, the own address to wait at
    port: int = 0
    device: str = ""  # of a serial link
    baud: int = _DEFAULT_BAUD

    def __str__(self) -> str:
        return f"{self.device}:{self.baud}" if self.kind == "serial" else f"{self.kind}:{self.host}:{self.port}"

    @property
    def bytes_per_second(self) -> float | None:
        """What a serial line carries (8N1: ten bits a byte); None for a network."""
        return self.baud / 10 if self.kind == "serial" else None


def is_link(text: str) -> bool:
    """Whether a word on the command line is meant as a link, not as a file."""
    return _MEANT.match(text) is not None


def meant_link(text: str) -> str:
    """The link that was probably meant: udp:14550 for upd:14550. "" where it does not look like one."""
    scheme, _, rest = text.partition(":")
    near = nearest_word(scheme, _KINDS) if _PLACE.fullmatch(rest) else ""
    return f"{near}:{rest}" if near else ""


def parse_address(text: str) -> Address:
    """The address that a text names. `udp:` is `udpin:`, as in pymavlink. Raises InputError for one that is none."""
    if match := _NETWORK.fullmatch(text):
        kind, host, port = match[1], match[2] or "", int(match[3])
        if not 0 <= port <= 65535:
            raise InputError(f"{text} has no port between 0 and 65535.")
        if not port and kind in ("udpout", "tcp"):
            raise InputError(f"{text} names no port to send to: 0 is none.")
        if not host:
            host = "0.0.0.0" if kind in ("udp", "udpin", "tcpin") else "127.0.0.1"
        return Address(_KINDS[kind], host.strip("[]"), port)
    if match := _SERIAL.fullmatch(text):
        if not (baud := int(match[2] or _DEFAULT_BAUD)):
            raise InputError(f"{text} names no baud rate: 0 is none.")
        return Address("serial", device=match[1], baud=baud)
    meant = meant_link(text)
    raise InputError(f"{text!r} is not a link: " + (f"did you mean {meant}?" if meant else f"use {_FORMS}."))


_BACK_OFF_S = (0.2, 5.0)  # between attempts to come back: the first, doubled each time up to the last


class NotThereError(InputError):
    """What a link goes to is not there: a host, a device, a program. It may come later."""


class Port(Protocol):
    """A two-way stream of bytes. Reading and writing never block and never raise for a peer that has gone."""

    @property
    def problem(self) -> str:
        """Why nothing can be received at present, "" if something can."""

    @property
    def busy(self) -> bool:
        """Whether somebody is there who took nothing of what was written last."""

    def wait(self, timeout_s: float) -> bool:
        """Wait until there is something to read, at most `timeout_s`; tries to come back if the peer has gone."""

    def read(self) -> bytes:
        """What has arrived, b"" for nothing."""

    def write(self, data: bytes) -> bool:
        """Send all of it, or nothing: False when there is nobody to send to, or when the peer takes nothing now."""

    def close(self) -> None:
        """Give the port back."""


Connection = TypeVar("Connection")


class _BackOff:
    """When to try again: ever later, until something is received (`ssh -L` takes each connection, and closes it)."""

    def __init__(self) -> None:
        self.received()

    def received(self) -> None:
        """What is there speaks: when it has gone, try at once."""
        self._pause, self._next = _BACK_OFF_S[0], 0.0

    def attempt(self, connect: Callable[[], Connection], timeout_s: float) -> Connection | None:
        """Try to come back; None where that fails, or after a sleep where it is too early for it."""
        if (left := self._next - time.monotonic()) > 0:
            time.sleep(min(timeout_s, left))
            return None
        try:
            return connect()
        except (OSError, ValueError):  # pyserial's are both
            return None
        finally:
            self._next = time.monotonic() + self._pause
            self._pause = min(2 * self._pause, _BACK_OFF_S[1])


_READ = 65_536  # bytes, taken once for all: `recv` takes so much anew for every datagram, and shreds the heap
_AT_ONCE = 1 << 20  # bytes taken in one read: more waits in the kernel
_BUFFER = 1 << 22  # bytes asked of the kernel, so that a busy moment loses no datagram
_PEERS = 32  # that are remembered at most
_PEER_S = 30.0  # a UDP peer that has been silent for longer is not answered any more
_CONNECT_S = 3.0
_ANSWERS_S = 5.0  # a vehicle that is there sends a heartbeat each second
_RECONNECT_S = 0.5
_LAST_WORDS_S = 0.5  # for the rest of a message, when closing

_GONE = {"TCP_KEEPIDLE": 5, "TCP_KEEPINTVL": 2, "TCP_KEEPCNT": 3, "TCP_USER_TIMEOUT": 11_000}
"""After 11 s without a sign of the other computer (s, s, times, ms): the connection is over, and made anew."""


class UdpPort:
    """`udpin`: hears whoever sends to it and answers those. `udpout`: speaks first, to one peer."""

    def __init__(self, address: Address) -> None:
        family, where = _resolve(address, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        self._fixed = where if address.kind == "udpout" else None
        self._peers: dict[Any, float] = {}  # address → when it was received last
        self._received = False  # whether anybody ever was
        self._spoke: float | None = None  # s of `time.monotonic()`, when it has first sent something
        self.busy = False
        self._room = memoryview(bytearray(_READ))
        if address.kind == "udpin":
            _bind(self._socket, where, address)
        self.address = self._socket.getsockname()

    @property
    def problem(self) -> str:
        if self._received:
            return ""
        if self._fixed is None or self._spoke is None or time.monotonic() - self._spoke < _ANSWERS_S:
            return "nobody has sent anything yet"
        return "nothing comes back: nobody is there, or the port has another partner (each port of PX4 has one alone)"

    def wait(self, timeout_s: float) -> bool:
        return bool(select.select([self._socket], [], [], timeout_s)[0])

    def read(self) -> bytes:
        pieces: list[bytes] = []
        size = 0
        while size < _AT_ONCE:
            try:
                count, peer = self._socket.recvfrom_into(self._room)
            except BlockingIOError:
                break
            except ConnectionError:  # "port unreachable" came back for something that was sent
                continue
            self._peers[peer] = time.monotonic()
            self._received = True
            if len(self._peers) > _PEERS:
                self._peers.pop(min(self._peers, key=self._peers.__getitem__))
            pieces.append(bytes(self._room[:count]))
            size += count
        return b"".join(pieces)

    def write(self, data: bytes) -> bool:
        now = time.monotonic()
        self._peers = {peer: t for peer, t in self._peers.items() if now - t < _PEER_S}
        sent = self.busy = False
        for peer in [self._fixed] if self._fixed else list(self._peers):
            try:
                self._socket.sendto(data, peer)
                sent = True
                self._spoke = self._spoke or now
            except BlockingIOError:
                self.busy = True
            except OSError:  # a network that is down comes back, or shows as silence
                pass
        return sent

    def close(self) -> None:
        self._socket.close()


class TcpPort:
    """`tcp`: connects, and again when the peer has closed. `tcpin`: waits for a peer; a new one takes the old one's
    place."""

    def __init__(self, address: Address) -> None:
        self._listener: socket.socket | None = None
        self._socket: socket.socket | None = None
        self._rest = b""  # of a message that the kernel has taken a part of
        self._room = memoryview(bytearray(_READ))
        self._retry = _BackOff()
        self._address = address
        self._to = _resolve(address, socket.SOCK_STREAM)
        self._asking: threading.Thread | None = None  # what has become of the host's address
        if address.kind == "tcpin":
            self._listener = socket.socket(self._to[0], socket.SOCK_STREAM)
            # or its own last session is in the way
            self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            _bind(self._listener, self._to[1], address)
            self._listener.listen(1)
            self._listener.setblocking(False)
            self.address = self._listener.getsockname()
        else:
            try:
                self._socket = self._connect(_CONNECT_S)
            except OSError as error:
                raise NotThereError(
                    f"nothing answers at {address} ({_reason(error)}): start the vehicle or simulator first, and check "
                    "host and port."
                ) from None
            self.address = self._socket.getsockname()

    @property
    def problem(self) -> str:
        if self._socket is not None:
            return ""
        return "nobody has connected" if self._listener else "the peer has closed the connection; trying again"

    @property
    def busy(self) -> bool:
        return bool(self._rest)

    def wait(self, timeout_s: float) -> bool:
        if self._socket is None and self._listener is None:
            self._socket = self._retry.attempt(self._reconnect, timeout_s)
            if self._socket is None:
                return False
        waiting = [end for end in (self._socket, self._listener) if end is not None]
        ready = select.select(waiting, [], [], timeout_s)[0]
        if self._listener is not None and self._listener in ready:
            self._accept(self._listener)
        return bool(ready)

    def read(self) -> bytes:
        pieces: list[bytes] = []
        size = 0
        while self._socket is not None and size < _AT_ONCE:
            try:
                count = self._socket.recv_into(self._room)
            except BlockingIOError:
                break
            except OSError:
                count = 0
            if not count:
                self._hang_up()
                break
            pieces.append(bytes(self._room[:count]))
            size += count
            self._retry.received()
        return b"".join(pieces)

    def write(self, data: bytes) -> bool:
        if not self._flush():
            return False
        self._rest = data
        self._flush()
        return self._socket is not None

    def close(self) -> None:
        if self._socket is not None and self._rest:
            with contextlib.suppress(OSError):  # the peer does not read, or has gone
                self._socket.settimeout(_LAST_WORDS_S)
                self._socket.sendall(self._rest)
        self._hang_up()
        if self._listener is not None:
            self._listener.close()

    def _reconnect(self) -> socket.socket:
        try:
            return self._connect(_RECONNECT_S)
        except OSError:
            if self._asking is None or not self._asking.is_alive():  # beside the link: a name server may be silent
                self._asking = threading.Thread(target=self._resolve_anew, name="companion-name", daemon=True)
                self._asking.start()
            raise

    def _resolve_anew(self) -> None:
        with contextlib.suppress(InputError):  # no network, no name server
            self._to = _resolve(self._address, socket.SOCK_STREAM)

    def _connect(self, timeout_s: float) -> socket.socket:
        family, where = self._to
        end = socket.socket(family, socket.SOCK_STREAM)
        try:
            end.settimeout(timeout_s)
            end.connect(where)
            if end.getsockname() == end.getpeername():  # with itself, and whoever wants to listen there no longer can
                raise ConnectionRefusedError(errno.ECONNREFUSED, "nobody listens")
        except OSError:
            end.close()
            raise
        _prepare(end)
        return end

    def _accept(self, listener: socket.socket) -> None:
        with contextlib.suppress(OSError):  # it has gone again
            end, _ = listener.accept()
            self._hang_up()
            _prepare(end)
            self._socket = end

    def _flush(self) -> bool:
        """Whether nothing is left of what was begun: half a message would spoil the next one too."""
        if self._socket is None:
            return False
        try:
            while self._rest:
                self._rest = self._rest[self._socket.send(self._rest) :]
        except BlockingIOError:  # the peer does not read
            return False
        except OSError:
            self._hang_up()
        return self._socket is not None

    def _hang_up(self) -> None:
        self._rest = b""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _resolve(address: Address, kind: socket.SocketKind) -> tuple[socket.AddressFamily, Any]:
    try:
        resolved = socket.getaddrinfo(address.host, address.port, type=kind)
    except OSError as error:
        raise NotThereError(f"the host of {address} cannot be found ({_reason(error)}): check its name.") from None
    # "localhost" is often ::1 first, and 127.0.0.1 is where vehicles and simulators are
    family, _, _, _, where = min(resolved, key=lambda one: one[0] != socket.AF_INET)
    return family, where


def _bind(end: socket.socket, where: Any, address: Address) -> None:
    try:
        end.bind(where)
    except OSError as error:
        end.close()
        if error.errno == errno.EADDRINUSE:
            raise InputError(
                f"port {address.port} is taken: another program (a ground station?) listens at {address}. Stop it, or "
                "let it forward to another port."
            ) from None
        raise NotThereError(
            f"{address} cannot be listened at ({_reason(error)}): use an address of this computer."
        ) from None


def _prepare(end: socket.socket) -> None:
    end.setblocking(False)
    end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    # A peer that lost its power or its Wi-Fi says no farewell, and would be waited for a quarter of an hour.
    end.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in _GONE.items():
        if hasattr(socket, name):  # not on every system
            end.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


def _reason(error: OSError) -> str:
    return "no answer" if isinstance(error, TimeoutError) else error.strerror or str(error)


_WAIT_S = 0.05  # that a read waits for its first byte


class SerialPort:
    """A serial device, which may be unplugged and plugged in again."""

    def __init__(self, address: Address) -> None:
        import serial  # noqa: PLC0415  (only who has a cable needs it)

        self._library: Any = serial
        self._address = address
        self._retry = _BackOff()
        self._first = b""  # read while waiting
        self.busy = False
        try:
            self._serial: Any = self._open()
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise NotThereError(_why_not(address, error)) from None

    @property
    def problem(self) -> str:
        return "" if self._serial is not None else f"{self._address.device} has gone; waiting for it to come back"

    def wait(self, timeout_s: float) -> bool:
        if self._serial is None:
            self._serial = self._retry.attempt(self._open, timeout_s)
            if self._serial is None:
                return False
        if timeout_s < _WAIT_S:
            time.sleep(timeout_s)
            self._first = self._first or self._take()
            return bool(self._first)
        # pyserial's own waiting, because Windows cannot select on a serial line.
        until = time.monotonic() + timeout_s
        while self._serial is not None and not self._first:
            self._first = self._take(1)
            if time.monotonic() >= until:
                break
        return bool(self._first)

    def read(self) -> bytes:
        data, self._first = self._first + self._take(), b""
        return data

    def write(self, data: bytes) -> bool:
        self.busy = False
        if self._serial is None:
            return False
        try:
            self._serial.write(data)
        except self._library.SerialTimeoutException:  # the line is full; a request is sent again
            self.busy = True
            return False
        except OSError:
            self.close()
        return self._serial is not None

    def close(self) -> None:
        if self._serial is not None:
            with contextlib.suppress(OSError):  # it has gone already
                self._serial.close()
            self._serial = None

    def _open(self) -> Any:
        return self._library.Serial(
            self._address.device, self._address.baud, timeout=_WAIT_S, write_timeout=0.2, exclusive=True
        )

    def _take(self, count: int | None = None) -> bytes:
        """So many bytes, waiting a moment for them; None: those that are there."""
        if self._serial is None:
            return b""
        try:
            count = self._serial.in_waiting if count is None else count
            data = bytes(self._serial.read(count)) if count else b""
        except (OSError, TypeError):  # TypeError: pyserial's file descriptor became None under it
            self.close()
            return b""
        if data:
            self._retry.received()
        return data


def _why_not(address: Address, error: OSError | ValueError) -> str:
    number = getattr(error, "errno", None)
    if number == errno.ENOENT:
        return f"there is no device {address.device}: plug the vehicle in, and look for it with: ls /dev/tty*"
    if number == errno.EACCES:
        return f"no permission for {address.device}: add yourself to its group (often dialout), then log in again."
    if number in (errno.EBUSY, errno.EAGAIN) or "lock" in str(error):
        return f"{address.device} is taken: another program has it open. Close that program."
    if isinstance(error, ValueError):
        return f"{address.device} cannot run at {address.baud} baud ({error})."
    return f"{address.device} cannot be opened ({error})."
