"""The HTML file that a page is written to: its sections, style, charts and data, and no request to anybody."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files

from companion.present import text
from companion.report.charts import Charts

_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob:; style-src 'unsafe-inline'; "
    "img-src data: blob:; connect-src data: blob:; font-src data:; worker-src blob:; "
    "base-uri 'none'; form-action 'none'"
)
"""No address may be loaded from or sent to. Scripts are the page's own; the player's compiles WebAssembly."""


def sheet(title: str, head: str, sections: Sequence[Section], charts: Charts, data: Mapping[str, str]) -> str:
    """A whole page. title: text; head: HTML above the contents; data: JSON that the page carries, by its id."""
    carried = [(name, "application/json", _inert(json)) for name, json in data.items()]
    carried += [
        ("figures", "application/json", _inert(charts.json())),
        ("plotly", "application/gzip", charts.library()),
    ]
    scripts = "\n".join(f'<script type="{kind}" id="{name}">{content}</script>' for name, kind, content in carried)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="referrer" content="no-referrer">'
        f'<meta name="color-scheme" content="light dark"><title>{text(title)}</title>'
        f"<style>{_own('page.css')}</style></head><body>{head}{_contents(sections)}<main>"
        f'{"".join(map(_section, sections))}</main><noscript><p class="warning">The charts need JavaScript; the tables '
        f"are complete.</p></noscript>{scripts}<script>{_own('page.js')}</script></body></html>\n"
    )


def _section(section: Section) -> str:
    return f'<section id="{section.anchor}"><h2>{text(section.title)}</h2>{section.body}</section>'


def _contents(sections: Sequence[Section]) -> str:
    links = "".join(f'<a href="#{section.anchor}">{text(section.title)}</a>' for section in sections)
    return f"<nav>{links}</nav>"


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
