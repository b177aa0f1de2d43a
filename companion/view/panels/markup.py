"""The markup of the panels: the verdict's banner, words, tables. "text" is escaped here; all else is markup already."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from html import escape

from companion.present import Rgb, palette
from companion.view.panels.controls import NARROW, SIDE, style

PALE = f"opacity:{palette.QUIET}"
"""Of a row or a word that says less than the others."""

COLOURS: dict[str, Rgb] = {
    "consistent": palette.GOOD,
    "imu_suspect": palette.BAD,
    "autopilot_suspect": palette.BAD,
    "insufficient_data": palette.DOUBTFUL,
    "starting": palette.CONTROLS,  # this and the next: of a live verdict
    "lost": palette.BAD,
}
_STYLE = style("banner.css", side=SIDE + 16, narrow=NARROW + 16)


def banner(status: str, head: str, detail: str = "", beside: str = "", *, stale: bool = False) -> str:
    """The verdict as HTML: a sentence, beside it how sure it is, below it what it rests on. All untrusted text.

    status: of `Verdict`, or a live one; "" while there is none, and the sentence says why not. stale: it is of old
    data, and is dimmed.
    """
    sign = palette.SIGNS.get(status)
    sure = f" <em>{unbroken(beside)}</em>" if beside else ""
    more = f"<small>{unbroken(detail)}</small>" if detail else ""
    return (
        f'{_STYLE}<div class="companion-banner" style="background:{palette.css(colour_of(status, stale=stale))}">'
        f"<span>{unbroken(f'{sign} {head}' if sign else head)}{sure}</span>{more}</div>"
    )


def colour_of(status: str, *, stale: bool = False) -> Rgb:
    """In which a verdict stands: grey where it is none any more, or not yet."""
    return palette.CONTROLS if stale else COLOURS.get(status, palette.CONTROLS)


_BEFORE_UNIT = re.compile(r"(?<=\d) (?=(%|s|m|Hz|ms|m/s²?|mrad/s|µT)\b|%)")


def unbroken(text: str) -> str:
    """Escaped; no line ends between a value and its error or its unit."""
    return _BEFORE_UNIT.sub("&nbsp;", escape(text)).replace(" ± ", "&nbsp;±&nbsp;")


def swatch(colour: Rgb, opacity: float = 1.0, shape: str = "width:0.8em;height:0.8em;border-radius:50%") -> str:
    """A spot in a source's colour; one that can be seen through has an edge in it, which is seen on a dark page too."""
    return (
        f'<span style="display:inline-block;{shape};margin-right:0.5em;vertical-align:middle;box-sizing:border-box;'
        f'border:2px solid {palette.css(colour)};background:{palette.rgba(colour, opacity)}"></span>'
    )


def block(markup: str, style: str = "") -> str:
    """Words below each other."""
    return f'<div style="padding:0.2em 1em;font-size:0.8em;line-height:1.5;{style}">{markup}</div>'


def lines(rows: Iterable[str]) -> str:
    """One below the other."""
    return "".join(f"<div>{row}</div>" for row in rows)


def badge(text: str, colour: Rgb) -> str:
    """A word on a colour."""
    return (
        f'<span style="background:{palette.css(colour)};color:white;border-radius:0.3em;padding:0.1em 0.6em;'
        f'font-weight:700">{escape(text)}</span>'
    )


def trouble(text: str) -> str:
    """What goes wrong."""
    return f'<div style="color:var(--companion-trouble)">{escape(text)}</div>'


def row(cells: Iterable[object], style: str = "") -> str:
    """Of a table."""
    return f'<tr style="{style}">{"".join(f"<td>{cell}</td>" for cell in cells)}</tr>'


def wrapped(markup: str) -> str:
    """A cell in as many lines as it needs."""
    return f'<span style="white-space:normal">{markup}</span>'


def table(head: Sequence[str], rows: Iterable[str]) -> str:
    """The first column to the left, the others to the right, below a paler head."""
    top = row(head, PALE) if head else ""
    return (
        '<div style="padding:0.2em 1em;overflow-x:auto"><table class="companion-table" style="width:100%;'
        'font-size:0.76em;line-height:1.6;font-variant-numeric:tabular-nums;border-spacing:0">'
        f"{top}{''.join(rows)}</table></div>"
    )


def title(markup: str) -> str:
    """Above a table."""
    return f'<div style="padding:0.7em 1em 0.1em;font-size:0.85em;font-weight:600">{markup}</div>'
