"""The HTML file that a page is written to: its sections, style, charts and data, and no request to anybody."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files

from companion.present import details, text
from companion.report.charts import Charts, plotly_js

_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob:; style-src 'unsafe-inline'; "
    "img-src data: blob:; connect-src data: blob:; font-src data:; worker-src blob:; "
    "base-uri 'none'; form-action 'none'"
)
"""No address may be loaded from or sent to. Scripts are the page's own; the player's compiles WebAssembly."""


def sheet(title: str, head: str, sections: Sequence[Section], charts: Charts, data: Mapping[str, str]) -> str:
    """A whole page. title: text; head: HTML above the contents; data: JSON that the page carries, by its id."""
    documents = {**data, "figures": charts.json()}
    carried = [
        f'<script type="application/json" id="{name}">{_inert(json)}</script>' for name, json in documents.items()
    ]
    scripts = "\n".join([*carried, f'<script type="application/gzip" id="plotly">{plotly_js()}</script>'])
    contents = "".join(f'<a href="#{section.anchor}">{text(section.title)}</a>' for section in sections)
    bodies = "".join(map(_section, sections))
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="referrer" content="no-referrer">'
        f'<meta name="color-scheme" content="light dark"><title>{text(title)}</title>'
        f"<style>{_own('page.css')}</style></head><body>{head}<nav>{contents}</nav><main>{bodies}</main>"
        '<noscript><p class="warning">The charts need JavaScript; the tables are complete.</p></noscript>'
        f"{scripts}<script>{_own('page.js')}</script></body></html>\n"
    )


def _section(one: Section) -> str:
    if one.folded:
        return f'<section id="{one.anchor}" class="folded">{details(one.title, one.body)}</section>'
    return f'<section id="{one.anchor}"><h2>{text(one.title)}</h2>{one.body}</section>'


def _inert(json: str) -> str:
    """JSON that cannot end the element that it stands in."""
    return json.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _own(name: str) -> str:
    """A file beside this module."""
    return (files("companion.report") / name).read_text(encoding="utf-8")


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a page."""

    anchor: str
    title: str
    body: str  # HTML
    folded: bool = False  # on screen, until it is opened
