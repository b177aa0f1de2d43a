"""A page as a resource: a server, the one thread that turns what stands behind it, and their end."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from types import TracebackType
from typing import Generic, Protocol, Self, TypeVar

import viser

from companion.view.scene.scene import Scene
from companion.view.server.web_server import close_server, find_address, open_server
from companion.view.state import events
from companion.view.viewport import Viewport

_log = logging.getLogger(__name__)
_MOST_FAILED = 10  # turns, one behind the other


class Turned(Protocol):
    """What stands behind a page. All of it runs in the view thread."""

    def handle(self, event: events.Event) -> None:
        """Do what a control of the page asks for."""

    def turn(self, now: float, dt: float) -> None:
        """Draw: at `now`, s of a steady clock, `dt` s after the last time."""

    def wait(self) -> None:
        """Wait until there is something new to draw, for some milliseconds at most. Called when a turn is due."""

    def close(self) -> None:
        """End whatever works beside the view thread."""

    viewport: Viewport


Behind = TypeVar("Behind", bound=Turned)


class Page(Generic[Behind]):
    """A web page. A resource: close it, or use it in a `with` block.

    build: makes what stands behind the page, once the server is up. or_next: where the port is taken, the next that is
    free. token: to be asked for on 127.0.0.1 too. Raises
    InputError for an address that is none.
    """

    def __init__(
        self,
        host: str,
        port: int,
        rate_hz: float,
        build: Callable[[viser.ViserServer, events.Post], Behind],
        *,
        or_next: bool = True,
        token: bool = False,
    ) -> None:
        self._address = find_address(host, port, or_next=or_next, token=token)
        self._events: queue.SimpleQueue[events.Event] = queue.SimpleQueue()
        self._server = open_server(self._address, lambda *asked: self._events.put(events.Visit(*asked)))
        self._address = replace(self._address, port=self._server.get_port())
        self._stopping = threading.Event()
        self._closed = False
        self._failure: BaseException | None = None
        self._failed = 0
        self._period = 1.0 / rate_hz
        try:
            self._behind = build(self._server, self._events.put)
        except BaseException:
            close_server(self._server)
            raise

        @self._server.on_client_connect
        async def _(client: viser.ClientHandle) -> None:
            self._events.put(events.Joined(client.client_id))

        @self._server.on_client_disconnect
        async def _(client: viser.ClientHandle) -> None:
            self._events.put(events.Left(client.client_id))

        self._thread = threading.Thread(target=self._loop, name="companion-view", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """The port that is really used."""
        return self._address.port

    @property
    def url(self) -> str:
        """What to open in a browser on this machine."""
        return self._address.url

    @property
    def warning(self) -> str | None:
        """A sentence for the user when others can reach the page, else None."""
        return self._address.warning

    @property
    def browsers(self) -> int:
        """How many pages are open."""
        return len(self._behind.viewport.browsers)

    @property
    def scene(self) -> Scene:
        """The world. To be read: where the drones are and how they stand."""
        return self._behind.viewport.scene

    @property
    def pose_updates(self) -> int:
        """How often both poses have been written since the start."""
        return self._behind.viewport.pose_updates

    @property
    def stopped(self) -> bool:
        """Whether the page is at its end, also because of an error in the view thread."""
        return self._stopping.is_set()

    def run(self, until: Callable[[], bool] = lambda: False) -> None:
        """Serve until `until()`, `stop`, Ctrl-C, or an error in the view thread, which is raised here."""
        try:
            while not self._stopping.wait(0.2) and not until():
                pass
        except KeyboardInterrupt:
            pass
        finally:
            self.close()
        self._reraise()

    def stop(self) -> None:
        """Make `run` return; may be called from any thread."""
        self._stopping.set()

    def close(self) -> None:
        """Stop the view thread, the workers and the server. A second call does nothing."""
        self._stopping.set()
        if self._closed:
            return
        self._closed = True
        self._thread.join()
        self._behind.close()
        close_server(self._server)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
        if error is None:
            self._reraise()

    def post(self, event: events.Event) -> None:
        """Do what a control of the page would do."""
        self._events.put(event)

    def _reraise(self) -> None:
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure

    def _attempt(self, event: events.Event) -> None:
        """Do what a control of a page asks for, if it can be done: no browser ends the page for all."""
        try:
            self._behind.handle(event)
        except Exception as error:  # noqa: BLE001
            _log.warning("dropped: %s (%s: %s)", event, type(error).__name__, error)
            _log.debug("dropped", exc_info=error)

    def _turn(self, now: float, dt: float) -> None:
        """Draw. What fails once may be mended by the next sample; what fails again and again is raised."""
        try:
            self._behind.turn(now, dt)
            self._failed = 0
        except Exception as error:
            self._failed += 1
            if self._failed == _MOST_FAILED:
                raise
            _log.warning("not drawn: %s: %s", type(error).__name__, error)
            _log.debug("not drawn", exc_info=error)

    def _loop(self) -> None:
        before = time.monotonic()
        try:
            while not self._stopping.is_set():
                now = time.monotonic()
                # What changes together has to arrive together: a chart with a line too many for its data fails.
                with self._behind.viewport.atomic():
                    while not self._events.empty():
                        self._attempt(self._events.get())
                    self._turn(now, now - before)
                before = now
                self._stopping.wait(max(0.0, self._period - (time.monotonic() - now)))
                self._behind.wait()
        except BaseException as error:  # noqa: BLE001 - handed to `run`, which raises it in the main thread
            self._failure = error
            self._stopping.set()
