"""What leaves the page: the picture over the page's background, and a replay that needs no server."""

from __future__ import annotations

import numpy as np

from companion.model import Flight
from companion.view import ReplayChoice
from companion.view.export import over, replay_page
from tests.view.circles import recompute


def test_what_is_see_through_shows_the_page_behind() -> None:
    rgba = np.array([[[10, 20, 30, 255], [10, 20, 30, 0], [0, 0, 0, 128]]], dtype=np.uint8)
    np.testing.assert_array_equal(over(rgba, 255)[0], [[10, 20, 30], [255, 255, 255], [127, 127, 127]])


def test_the_page_is_one_file_that_asks_nobody(flight: Flight) -> None:
    html = replay_page(recompute(flight, ReplayChoice()), flight)
    assert html.lstrip().lower().startswith("<!doctype html>")
    assert "__VISER_EMBED_DATA__" in html
    assert len(html) < 12e6
