"""The verdict above the picture: one sentence, in the colour of its status."""

from __future__ import annotations

from html import escape

from companion.present import Rgb, clause, palette, words
from companion.view.panels.controls import NARROW, NARROW_WINDOW, SIDE

COLOURS: dict[str, Rgb] = {
    "consistent": palette.GOOD,
    "imu_suspect": palette.BAD,
    "autopilot_suspect": palette.BAD,
    "insufficient_data": palette.DOUBTFUL,
    "starting": palette.CONTROLS,  # this and the next: of a live verdict
    "lost": palette.BAD,
}
_STYLE = (  # over the picture, between the panels; on a phone the first thing of the sheet
    f"<style>.companion-banner{{position:fixed;z-index:4;top:8px;left:{SIDE + 16}px;right:{SIDE + 16}px}}"
    ".companion-banner{padding:8px 14px;border-radius:4px;color:#fff;font-size:20px;line-height:1.25;font-weight:600;"
    "pointer-events:none;"
    "box-shadow:0 1px 4px rgba(0,0,0,.3)}"
    ".companion-banner span{text-wrap:balance;display:-webkit-box;-webkit-box-orient:vertical;"
    "-webkit-line-clamp:3;overflow:hidden}"
    "@media (max-width:1150px){.companion-banner{font-size:16px}}"
    f"{NARROW_WINDOW}{{.companion-banner{{left:{NARROW + 16}px;right:{NARROW + 16}px}}}}"
    "@media (max-width:36em){.companion-banner{position:static;margin:0 0 6px;border-radius:0;font-size:16px}"
    ".companion-banner span{-webkit-line-clamp:5}}</style>"
)


def banner(status: str, sentence: str, *, stale: bool = False) -> str:
    """The verdict as HTML. status: of `Verdict`; sentence: untrusted text. stale: it is of old data, and is dimmed."""
    return _banner(
        f"{palette.SIGNS.get(status, '')} {words(status).upper()} – {clause(sentence)}", colour_of(status, stale=stale)
    )


def colour_of(status: str, *, stale: bool = False) -> Rgb:
    """In which a verdict stands: grey where it is none any more, or not yet."""
    return palette.CONTROLS if stale else COLOURS.get(status, palette.CONTROLS)


def waiting(sentence: str) -> str:
    """The same while there is no verdict: why not, in words. Untrusted text."""
    return _banner(sentence, palette.CONTROLS)


def _banner(text: str, colour: Rgb) -> str:
    colours = f"background:{palette.css(colour)}"
    whole = escape(text).replace(" ± ", "&nbsp;±&nbsp;")  # a line must not end between a value and its error
    return f'{_STYLE}<div class="companion-banner" style="{colours}"><span>{whole}</span></div>'
