"""The pages as resources: the replay of a log, and a vehicle on a link."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from companion.model import CompanionError, Flight, InputError
from companion.view.live_controller import TURN_HZ, LiveController
from companion.view.page import Page
from companion.view.replay_controller import ReplayController
from companion.view.state.choice import Examine, Offer, Recompute, ReplayChoice
from companion.view.state.feed import Feed
from companion.view.state.player import Player
from companion.view.state.work import attempt

POSE_HZ = 30.0


class Viewer(Page[ReplayController]):
    """A replay in the browser. A resource, see `Page`.

    The first reckoning is done in the constructor, so that a flight that cannot be shown raises there
    (CompanionError), before anything is served. What the analysis says of it comes while it is looked at.
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
        choice = choice or ReplayChoice()
        if choice.imu is None:
            choice = replace(choice, imu=chosen.default_imu)
        first = attempt(recompute, chosen, choice)
        if isinstance(first.result, CompanionError):
            raise first.result
        film = first.result
        also = offer or Offer()
        super().__init__(
            host,
            port,
            POSE_HZ,
            lambda server, post: ReplayController(server, tuple(flights), recompute, examine, also, first, film, post),
            or_next=or_next,
            token=token,
        )

    @property
    def player(self) -> Player:
        """The play clock. To be read; only the view thread moves it."""
        return self._behind.player


class LiveViewer(Page[LiveController]):
    """A link in the browser. A resource, see `Page`.

    feed: belongs to the view thread from now on. window_s: how far charts and trails reach back.
    """

    def __init__(
        self, feed: Feed, *, window_s: float = 600.0, host: str = "127.0.0.1", port: int = 8080, token: bool = False
    ) -> None:
        super().__init__(
            host, port, TURN_HZ, lambda server, post: LiveController(server, feed, window_s, post), token=token
        )

    @property
    def newest(self) -> float:
        """The boot time, s, of the pose that was written last."""
        return self._behind.newest

    @property
    def held(self) -> bool:
        """Whether the picture is held while the recording goes on."""
        return self._behind.held
