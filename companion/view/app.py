"""The replay of a log in the browser."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from companion.model import CompanionError, Flight, InputError
from companion.view.page import Page
from companion.view.replay_controller import ReplayController
from companion.view.state.choice import Examine, Offer, Recompute, ReplayChoice
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
            token=token,
        )

    @property
    def player(self) -> Player:
        """The play clock. To be read; only the view thread moves it."""
        return self._behind.player
