"""What is sent to the browsers, and how often: only what has changed."""

from __future__ import annotations

from typing import Any


def update(thing: Any, **values: object) -> None:
    """Set properties of a node or a control; nothing is sent to the browsers where they are so already."""
    for name, value in values.items():
        if getattr(thing, name) != value:
            setattr(thing, name, value)


class Cadence:
    """When each of several things is due again. rates: Hz of each, by its name."""

    def __init__(self, **rates: float) -> None:
        self._rates = rates
        self._due = dict.fromkeys(rates, 0.0)

    def __call__(self, what: str, now: float) -> bool:
        """Whether it is due at `now`, s; if so, it has been taken."""
        if now < self._due[what]:
            return False
        self._due[what] = now + 1.0 / self._rates[what]
        return True

    def at_once(self, *what: str) -> None:
        """These are due at the next look; none named: all."""
        self._due.update(dict.fromkeys(what or self._rates, 0.0))

    def wait(self, what: str, until: float) -> None:
        """This is not due before."""
        self._due[what] = until
