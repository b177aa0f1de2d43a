"""The pages as resources: the replay of a log, and a vehicle on a link. Each a server and one view thread."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Generic, Self, TypeVar

import viser

from companion.model import Flight, InputError
from companion.view.controller import Controller
from companion.view.live_controller import TURN_HZ, LiveController
from companion.view.panels.controls import Call, Post
from companion.view.replay_controller import ReplayController
from companion.view.server.web_server import Address, close_server, find_address, open_server
from companion.view.state.live import Feed
from companion.view.state.player import Player
from companion.view.state.trajectory import Examine, Offer, Recompute, ReplayChoice

POSE_HZ = 30.0
_SOONEST_S = 0.01  # from one turn to the next, however fast a browser calls
_log = logging.getLogger(__name__)
_MOST_FAILED = 10  # turns, one behind the other

Behind = TypeVar("Behind", bound=Controller)


class Page(Generic[Behind]):
    """A web page. A resource: close it, or use it in a `with` block.

    build: makes what stands behind the page, once the server is up.
    """

    def __init__(self, address: Address, rate_hz: float, build: Callable[[viser.ViserServer, Post], Behind]) -> None:
        self._calls: queue.SimpleQueue[Call] = queue.SimpleQueue()
        self._called = threading.Event()  # there is a call, or it is stopped
        self._server = open_server(
            address, lambda t, imu, again: self.post(lambda: self.controller.visit(t, imu, again=again))
        )
        address = replace(address, port=self._server.get_port())  # the one that is really used
        self.port = address.port
        self.url = address.url  # what to open in a browser on this machine
        self.warning = address.warning  # a sentence for the user when others can reach the page, else None
        self._stopping = threading.Event()
        self._closed = False
        self._failure: BaseException | None = None
        self._failed = 0
        self._period = 1.0 / rate_hz
        try:
            self.controller = build(self._server, self.post)
        except BaseException:
            close_server(self._server)
            raise

        @self._server.on_client_connect
        async def _(client: viser.ClientHandle) -> None:
            self.post(lambda: self.controller.join(client.client_id))

        @self._server.on_client_disconnect
        async def _(client: viser.ClientHandle) -> None:
            self.post(lambda: self.controller.browsers.leave(client.client_id))

        self._thread = threading.Thread(target=self._loop, name="companion-view", daemon=True)
        self._thread.start()

    def post(self, call: Call) -> None:
        """Do what a control of the page would do, without waiting for the next turn."""
        self._calls.put(call)
        self._called.set()

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
        self._called.set()
        if self._closed:
            return
        self._closed = True
        self._thread.join()
        self.controller.close()
        close_server(self._server)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        self.close()
        if error is None:
            self._reraise()

    def _reraise(self) -> None:
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure

    def _attempt(self, call: Call) -> None:
        """Do what a control of a page requests, if it can be done: no browser ends the page for all."""
        try:
            call()
        except Exception as error:  # noqa: BLE001
            _log.warning("dropped: %s (%s: %s)", call, type(error).__name__, error)
            _log.debug("dropped", exc_info=error)

    def _turn(self, now: float, dt: float) -> None:
        """Draw. What fails once may be mended by the next sample; what fails again and again is raised."""
        try:
            self.controller.turn(now, dt)
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
                self._called.clear()
                with self.controller.atomic():
                    while not self._calls.empty():
                        self._attempt(self._calls.get())
                    self._turn(now, now - before)
                before = now
                self._called.wait(max(0.0, self._period - (time.monotonic() - now)))
                self._stopping.wait(max(0.0, _SOONEST_S - (time.monotonic() - now)))
                self.controller.wait()
        except BaseException as error:  # noqa: BLE001 - handed to `run`, which raises it in the main thread
            self._failure = error
            self._stopping.set()


class Viewer(Page[ReplayController]):
    """A replay in the browser. A resource, see `Page`.

    The first dead reckoning is done in the constructor, so that a flight that cannot be shown raises there
    (CompanionError), before anything is served. The analysis result comes while it is looked at.

    or_next: where the port is taken, the next that is free. token: required on 127.0.0.1 too. Raises InputError for an
    address that is none.
    """

    def __init__(
        self,
        flights: Sequence[Flight],
        recompute: Recompute,
        examine: Examine,
        *,
        flight: int = 0,
        choice: ReplayChoice | None = None,
        offer: Offer | None = None,
        host: str = "127.0.0.1",
        port: int = 8080,
        or_next: bool = True,
        token: bool = False,
    ) -> None:
        if not flights:
            raise InputError("There is no flight to show.")
        chosen = flights[flight]
        requested = choice or ReplayChoice()
        first = requested if requested.imu else replace(requested, imu=chosen.default_imu)
        display = recompute(chosen, first)
        super().__init__(
            find_address(host, port, or_next=or_next, token=token),
            POSE_HZ,
            lambda server, post: ReplayController(
                server, tuple(flights), recompute, examine, offer or Offer(), chosen, first, display, post
            ),
        )

    @property
    def player(self) -> Player:
        """The play clock. To be read; only the view thread moves it."""
        return self.controller.player


class LiveViewer(Page[LiveController]):
    """A link in the browser. A resource, see `Page`.

    feed: belongs to the view thread from now on. window_s: how far charts and trails reach back. token: required on
    127.0.0.1 too. Raises InputError for an address that is none.
    """

    def __init__(
        self, feed: Feed, *, window_s: float = 600.0, host: str = "127.0.0.1", port: int = 8080, token: bool = False
    ) -> None:
        address = find_address(host, port, token=token)
        super().__init__(address, TURN_HZ, lambda server, post: LiveController(server, feed, window_s, post))
