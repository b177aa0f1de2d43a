"""A session on a link in a thread of its own: whoever looks at it neither waits for it nor makes it wait."""

from __future__ import annotations

import threading
import time
from collections import deque

from companion.links import Report, Session
from companion.mavlink import Frames

_REPORT_S = 0.25
_MOST_HELD = 6000  # receipts that nobody has fetched: a minute of a busy link

Receipt = tuple[Frames, float]
"""What arrived together, and when, s UNIX."""


class Attachment:
    """Steps a session until `close`, which gives the vehicle its intervals back.

    A resource: close it, or use it in a `with` block. What goes wrong in the thread is raised by `check`.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._receipts: deque[Receipt] = deque(maxlen=_MOST_HELD)
        self._stopping = threading.Event()
        self._failure: BaseException | None = None
        self.restored = True  # after `close`: whether the vehicle has confirmed that its intervals are as before
        self._said: deque[str] = deque()
        self.report: Report = session.report()  # how the session stands, a quarter of a second ago at most
        self._arrived = threading.Event()
        session.listen(self._take)
        self._thread = threading.Thread(target=self._run, name="companion-link", daemon=True)
        self._thread.start()

    @property
    def alive(self) -> bool:
        """Whether the link is still listened to."""
        return self._thread.is_alive()

    def wait(self, timeout_s: float) -> None:
        """Wait until something has arrived since the last `fetch`, no longer than so many s."""
        self._arrived.wait(timeout_s)

    def fetch(self) -> list[Receipt]:
        """What has arrived since the last time. For one thread."""
        self._arrived.clear()
        return [self._receipts.popleft() for _ in range(len(self._receipts))]

    def notices(self) -> list[str]:
        """The sentences for the user since the last time. For one thread."""
        return [self._said.popleft() for _ in range(len(self._said))]

    def check(self) -> None:
        """Raise what has ended the thread, if anything: InputError where the link carries no MAVLink."""
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure

    def close(self) -> None:
        """Leave the vehicle as it was found; as long as `Session.leave` takes. A second call does nothing."""
        self._stopping.set()
        self._thread.join()

    def __enter__(self) -> Attachment:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _take(self, frames: Frames, received: float) -> None:
        self._receipts.append((frames, received))
        self._arrived.set()

    def _run(self) -> None:
        session = self._session
        try:
            due = 0.0
            while not self._stopping.is_set():
                session.step()
                now = time.monotonic()
                if now >= due or session.reported:
                    due = now + _REPORT_S
                    session.beside(self._tell)
            self.restored = session.leave()
            session.beside(self._tell)
        except BaseException as error:  # noqa: BLE001 - handed to `check`, which raises it in the main thread
            self._failure = error

    def _tell(self) -> None:
        self._said.extend(self._session.reported)
        self._session.reported.clear()
        self.report = self._session.report()
