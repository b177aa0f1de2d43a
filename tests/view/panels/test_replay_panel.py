"""The numbers of the instant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from companion.view import ReplayChoice
from companion.view.panels.controls import Controls
from companion.view.panels.replay_panel import Panel
from tests.view.circles import make_flight, recompute


class Dropdown:
    """Stands for viser's."""

    value = ""

    def on_update(self, _: Callable[..., object]) -> None:
        """Nothing is heard."""


class Gui:
    """Stands for viser's: keeps the pieces of markup in order."""

    def __init__(self) -> None:
        self.markup: list[SimpleNamespace] = []

    def add_html(self, content: str) -> SimpleNamespace:
        self.markup.append(SimpleNamespace(content=content))
        return self.markup[-1]

    def add_dropdown(self, *_: object, **__: object) -> Dropdown:
        return Dropdown()


def test_the_expected_error_is_a_length() -> None:
    """Root mean square of a vector whose axes have 1, 2 and 2 m."""
    flight, gui = make_flight(), Gui()
    display = recompute(flight, ReplayChoice())
    sample = replace(display.at(display.start + 5.0), covariance=np.diag([1.0, 4.0, 4.0]), position_m=2.5)
    shown: Any = gui
    Panel(Controls(shown, lambda _: None), [flight], lambda _: None).show(sample, display, 10.0)
    (numbers,) = (piece.content for piece in gui.markup if "Position error" in piece.content)
    assert "expected 1σ 3.00 m" in numbers
    assert "2.50 m" in numbers
