"""The verdict above the picture."""

from __future__ import annotations

from typing import get_args

import pytest

from companion.present import palette
from companion.verdict.verdict import Status
from companion.view.panels.markup import COLOURS, banner, swatch

WHITE: palette.Rgb = (255, 255, 255)
DARK: palette.Rgb = (36, 36, 36)
WORDS: dict[palette.Rgb, palette.Rgb] = {WHITE: (0, 0, 0), DARK: (201, 201, 201)}
"""Panel of the page → the words on it."""
BRAND_DRAWN: palette.Rgb = (92, 105, 123)  # what viser makes of the brand's colour on a light page
LEAST = 4.5  # WCAG 2.1, 1.4.3


def contrast(one: palette.Rgb, other: palette.Rgb) -> float:
    """Contrast ratio of two colours, 1 to 21 (WCAG 2.1, 1.4.3): 4.5 is the least for text."""
    light, dark = sorted((_luminance(one), _luminance(other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def _luminance(colour: palette.Rgb) -> float:
    r, g, b = ((c / 255 / 12.92) if c <= 10 else ((c / 255 + 0.055) / 1.055) ** 2.4 for c in colour)
    return 0.2126 * r + 0.7152 * g + 0.0722 * b


@pytest.mark.parametrize("colour", [*COLOURS.values(), *palette.SEVERITIES.values(), palette.BRAND, BRAND_DRAWN])
def test_white_is_read_on_buttons_badges_and_banners(colour: palette.Rgb) -> None:
    assert contrast(colour, WHITE) >= LEAST


@pytest.mark.parametrize("panel", WORDS)
def test_words_on_panels_and_bands_are_read(panel: palette.Rgb) -> None:
    words = WORDS[panel]
    trouble = palette.TROUBLE if panel == WHITE else palette.TROUBLE_ON_DARK
    assert contrast(words, panel) >= LEAST
    assert contrast(palette.mix(panel, words, palette.QUIET), panel) >= LEAST
    assert contrast(trouble, panel) >= LEAST
    band = palette.mix(panel, palette.BAND, palette.BAND_OPACITY)
    for colour in palette.MODES:
        assert contrast(words, palette.mix(band, colour, palette.MODES_OPACITY)) >= LEAST


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
    spot, edge = palette.mix(DARK, palette.AUTOPILOT, 0.6), palette.AUTOPILOT
    assert contrast(edge, DARK) > 1.4 * contrast(spot, DARK)


def test_texts_of_the_vehicle_stay_texts() -> None:
    assert "<img" not in banner("imu_suspect", "<img src=x>") + banner("", "<img src=x>")


def test_contrast_is_that_of_wcag() -> None:
    assert contrast((0, 0, 0), WHITE) == pytest.approx(21.0)
    assert contrast((118, 118, 118), WHITE) == pytest.approx(4.54, abs=0.01)  # the lightest grey that passes
