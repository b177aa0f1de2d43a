"""The viewer as a resource: a server, the thread that turns its stage, and their end."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from types import TracebackType

import viser

from companion.errors import CompanionError, InputError
from companion.tracks import Flight
from companion.view import events
from companion.view.choice import Recompute, ReplayChoice, attempt
from companion.view.player import Player
from companion.view.scene import Scene
from companion.view.server import close_server, find_address, open_server
from companion.view.stage import Stage

POSE_HZ = 30.0


class Viewer:
    """A replay in the browser. A resource: close it, or use it in a `with` block.

    The first reckoning is done in the constructor, so that a flight that cannot be shown raises there
    (CompanionError), before anything is served.
    """

    def __init__(
        self,
        flights: Sequence[Flight],
        recompute: Recompute,
        *,
        flight: int = 0,
        choice: ReplayChoice | None = None,
        host: str = "127.0.0.1",
        port: int = 8080,
    ) -> None:
        if not flights:
            raise InputError("There is no flight to show.")
        chosen = flights[flight]
        choice = choice or ReplayChoice()
        if choice.imu is None:
            choice = replace(choice, imu=chosen.default_imu)
        first = attempt(recompute, chosen, choice)
        if isinstance(first.result, CompanionError):
            raise first.result
        self._address = find_address(host, port)
        self._server = open_server(self._address)
        self._address = replace(self._address, port=self._server.get_port())
        self._events: queue.SimpleQueue[events.Event] = queue.SimpleQueue()
        self._stopping = threading.Event()
        self._closed = False
        self._failure: BaseException | None = None
        self._stage = Stage(self._server, tuple(flights), recompute, first, first.result, self._events.put)

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
    def player(self) -> Player:
        """The play clock. To be read; only the view thread moves it."""
        return self._stage.player

    @property
    def scene(self) -> Scene:
        """The world. To be read: where the drones are and how they stand."""
        return self._stage.scene

    @property
    def browsers(self) -> int:
        """How many pages are open."""
        return self._stage.browsers

    @property
    def pose_updates(self) -> int:
        """How often both poses have been written since the start."""
        return self._stage.pose_updates

    def run(self) -> None:
        """Serve until `stop`, Ctrl-C, or an error in the view thread, which is raised here."""
        try:
            while not self._stopping.wait(0.5):
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
        """Stop the view thread, the worker and the server. A second call does nothing."""
        self._stopping.set()
        if self._closed:
            return
        self._closed = True
        self._thread.join()
        self._stage.close()
        close_server(self._server)

    def __enter__(self) -> Viewer:
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

    def _loop(self) -> None:
        before = time.monotonic()
        try:
            while not self._stopping.is_set():
                now = time.monotonic()
                while not self._events.empty():
                    self._stage.handle(self._events.get())
                self._stage.turn(now, now - before)
                before = now
                self._stopping.wait(max(0.0, 1.0 / POSE_HZ - (time.monotonic() - now)))
        except BaseException as error:  # noqa: BLE001 - handed to `run`, which raises it in the main thread
            self._failure = error
            self._stopping.set()
