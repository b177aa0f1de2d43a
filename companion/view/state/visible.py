"""What is shown and hidden again and again, at every instant of a replay."""

from __future__ import annotations

from typing import Protocol


class Hideable(Protocol):
    """A node of the scene, or a control."""

    visible: bool


def show(thing: Hideable, visible: bool) -> None:
    """Show or hide it; nothing is sent to the browsers where it is so already."""
    if thing.visible != visible:
        thing.visible = visible
