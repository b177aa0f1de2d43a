"""What a browser changes is heard, though the page sets the same input meanwhile."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from types import SimpleNamespace
from typing import Any

import pytest

from companion.view.panels.controls import Controls, write


class Handle:
    """An input as viser has it: it takes what a browser says, and tells its listener in a second step."""

    def __init__(self, value: Any) -> None:
        self.value = value
        self._changed: Callable[[Any], Awaitable[None]] | None = None

    def on_update(self, changed: Callable[[Any], Awaitable[None]]) -> None:
        self._changed = changed

    def tell(self) -> None:
        assert self._changed is not None
        asyncio.run(self._changed(SimpleNamespace(client_id=1)))  # type: ignore[arg-type]


@pytest.fixture
def received() -> tuple[Handle, list[Any]]:
    """An input that shows 1, and what it is changed to, call by call."""
    handle, values, gui = Handle(1.0), list[Any](), SimpleNamespace()
    Controls(gui, lambda call: call()).on_change(handle, values.append)  # type: ignore[arg-type]
    write(handle, 1.0)
    return handle, values


@pytest.mark.parametrize("written", [(1.0,), (1.5, 2.0)], ids=["what was asked for before", "the time while it plays"])
def test_what_is_written_before_a_change_is_told_does_not_take_its_place(
    received: tuple[Handle, list[Any]], written: tuple[float, ...]
) -> None:
    handle, values = received
    handle.value = 4.0
    for value in written:
        write(handle, value)
    handle.tell()
    assert values == [4.0]
    assert handle.value == 4.0, "and it is shown"


def test_a_change_that_was_heard_may_be_taken_back(received: tuple[Handle, list[Any]]) -> None:
    handle, values = received
    for said in (4.0, 5.0, 4.0):
        handle.value = said
        handle.tell()
        write(handle, 1.0)
        assert handle.value == 1.0
        assert values[-1] == said


def test_what_others_have_set_is_no_change_of_a_browser(received: tuple[Handle, list[Any]]) -> None:
    """As a list sets itself to the first of its options, where it shows none of them."""
    handle, values = received
    handle.value = 7.0
    write(handle, 2.0)
    handle.value = 3.0
    handle.tell()
    assert values == [3.0]
