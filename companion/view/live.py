"""The live page as a resource."""

from __future__ import annotations

from companion.view.live_controller import LOOK_HZ, LiveController
from companion.view.page import Page
from companion.view.state.feed import Feed


class LiveViewer(Page[LiveController]):
    """A link in the browser. A resource, see `Page`.

    feed: belongs to the view thread from now on. window_s: how far charts and trails reach back.
    """

    def __init__(
        self, feed: Feed, *, window_s: float = 600.0, host: str = "127.0.0.1", port: int = 8080, token: bool = False
    ) -> None:
        super().__init__(
            host, port, LOOK_HZ, lambda server, post: LiveController(server, feed, window_s, post), token=token
        )

    @property
    def newest(self) -> float:
        """The boot time, s, of the pose that was written last."""
        return self._behind.newest

    @property
    def held(self) -> bool:
        """Whether the picture is held while the recording goes on."""
        return self._behind.held
