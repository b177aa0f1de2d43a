"""The verdict above the picture."""

from __future__ import annotations

from typing import get_args

import pytest

from companion.analysis.verdict import Status
from companion.present import palette
from companion.view.panels.markup import COLOURS, banner, swatch

WHITE = (255, 255, 255)


PANELS = (palette.LIGHT, palette.DARK)
LEAST = 4.5  # WCAG 2.1, 1.4.3


@pytest.mark.parametrize(
    "colour", [*COLOURS.values(), *palette.SEVERITIES.values(), palette.BRAND, palette.BRAND_DRAWN]
)
def test_white_is_read_on_buttons_badges_and_banners(colour: palette.Rgb) -> None:
    assert palette.contrast(colour, WHITE) >= LEAST


@pytest.mark.parametrize("panel", PANELS)
def test_words_on_panels_and_bands_are_read(panel: palette.Rgb) -> None:
    words = palette.WORDS[panel]
    trouble = palette.TROUBLE if panel == palette.LIGHT else palette.TROUBLE_ON_DARK
    assert palette.contrast(words, panel) >= LEAST
    assert palette.contrast(palette.mix(panel, words, palette.QUIET), panel) >= LEAST
    assert palette.contrast(trouble, panel) >= LEAST
    band = palette.mix(panel, palette.BAND, palette.BAND_OPACITY)
    for colour in palette.MODES:
        assert palette.contrast(words, palette.mix(band, colour, palette.MODES_OPACITY)) >= LEAST


@pytest.mark.parametrize("status", get_args(Status))
def test_every_status_has_a_sign_and_a_colour_on_which_white_is_read(status: str) -> None:
    assert palette.SIGNS[status]
    assert status in COLOURS
    assert palette.SIGNS[status] in banner(status, "They agree.")


def test_a_line_does_not_end_between_a_value_and_its_error() -> None:
    markup = banner("imu_suspect", "accelerometer x bias 2.99 ± 0.02 m/s².", "98 % of 46 windows inside the 95 % bound")
    assert "2.99&nbsp;±&nbsp;0.02&nbsp;m/s²" in markup
    assert "98&nbsp;% of 46 windows inside the 95&nbsp;% bound" in markup


def test_what_is_seen_through_has_an_edge_that_a_dark_page_does_not_swallow() -> None:
    assert f"border:2px solid {palette.css(palette.AUTOPILOT)}" in swatch(palette.AUTOPILOT, 0.6)
    spot, edge = palette.mix(palette.DARK, palette.AUTOPILOT, 0.6), palette.AUTOPILOT
    assert palette.contrast(edge, palette.DARK) > 1.4 * palette.contrast(spot, palette.DARK)


def test_texts_of_the_vehicle_stay_texts() -> None:
    assert "<img" not in banner("imu_suspect", "<img src=x>") + banner("", "<img src=x>")


def test_contrast_is_that_of_wcag() -> None:
    assert palette.contrast((0, 0, 0), WHITE) == pytest.approx(21.0)
    assert palette.contrast((118, 118, 118), WHITE) == pytest.approx(4.54, abs=0.01)  # the lightest grey that passes
