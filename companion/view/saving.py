"""The worker that makes pictures and pages while the view goes on, and hands them to the browser that asked."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future

import viser

from companion.model import CompanionError
from companion.view import export
from companion.view.state.worker import begin, leave

PICTURE, PAGE, REPORT = "companion.png", "companion-replay.html", "companion-report.html"


class Saver:
    """What is asked of it is done one at a time."""

    def __init__(self) -> None:
        self._turn = threading.Lock()
        self._running: list[Future[str | None]] = []

    def picture(self, client: viser.ClientHandle, *, dark: bool) -> None:
        """Send the browser what it shows, as PNG."""
        self._submit(client, PICTURE, lambda: export.picture(client, dark=dark))

    def page(self, client: viser.ClientHandle, name: str, make: Callable[[], str]) -> None:
        """Send the browser the page that `make` makes, as a file of this name."""
        self._submit(client, name, lambda: make().encode())

    def poll(self) -> str | None:
        """Why something could not be saved, once, in words. An error that is none of the browser's is raised here."""
        for done in [future for future in self._running if future.done()]:
            self._running.remove(done)
            trouble = done.result()
            if trouble is not None:
                return trouble
        return None

    def close(self) -> None:
        """What is being made has a moment to end."""
        leave(self._running)

    def _submit(self, client: viser.ClientHandle, name: str, make: Callable[[], bytes]) -> None:
        def work() -> str | None:
            try:
                with self._turn:
                    content = make()
                client.send_file_download(name, content, save_immediately=True)
            except (RuntimeError, TimeoutError, CompanionError) as error:  # the browser has gone, or did not answer
                return f"{name} could not be saved: {error}"
            return None

        self._running.append(begin("save", work))
