"""The worker that makes pictures and pages while the view goes on, and hands them to the browser that asked."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

import viser

from companion.errors import CompanionError
from companion.view import export

PICTURE, PAGE, REPORT = "companion.png", "companion-replay.html", "companion-report.html"


class Saver:
    """One worker; what is asked of it is done in turn."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="companion-save")
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
        """Drop what waits and end the worker."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _submit(self, client: viser.ClientHandle, name: str, make: Callable[[], bytes]) -> None:
        def work() -> str | None:
            try:
                client.send_file_download(name, make(), save_immediately=True)
            except (RuntimeError, TimeoutError, CompanionError) as error:  # the browser has gone, or did not answer
                return f"{name} could not be saved: {error}"
            return None

        self._running.append(self._pool.submit(work))
