"""HTML from data. Text from vehicles, logs and file names is untrusted: nothing becomes markup but through here."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from urllib.parse import quote

from companion.present.formats import short
from companion.present.tables import Table

Row = Sequence[object]


@dataclass(frozen=True, slots=True)
class Link:
    """A cell that leads to a file beside the page."""

    words: str
    path: str  # relative, with /


def link(to: Link) -> str:
    """HTML of a link."""
    return f'<a href="./{text(quote(to.path))}">{text(to.words)}</a>'


def text(value: object) -> str:
    """A value as HTML text, good in an attribute too: escaped, printable, valid in UTF-8."""
    return html.escape(sanitised(value))


def sanitised(value: object) -> str:
    """A value as text without what a terminal or a page would obey, valid in UTF-8."""
    plain = str(value).encode("utf-8", "replace").decode()
    return "".join(c if c.isprintable() or c in _KEPT else "\N{REPLACEMENT CHARACTER}" for c in plain)


def table(
    headings: Sequence[str],
    rows: Iterable[Row],
    *,
    name: str = "",
    words: int = 1,
    groups: Sequence[tuple[str, int]] = (),
    sortable: bool = False,
) -> str:
    """A table whose first `words` columns are words and whose others are numbers. Cells are escaped.

    name: its id; groups: a row above the headings, each cell with the number of columns that it spans; sortable: by a
    click on a heading, and with a field that leaves the rows that have its words (page.js).
    """

    def line(tag: str, row: Row) -> str:
        cells = (
            f"<{tag}{'' if i < words else _RIGHT}>{link(cell) if isinstance(cell, Link) else text(cell)}</{tag}>"
            for i, cell in enumerate(row)
        )
        return f"<tr>{''.join(cells)}</tr>"

    above = "".join(f'<th colspan="{span}" class="group">{text(title)}</th>' for title, span in groups)
    head = (f"<tr>{above}</tr>" if above else "") + line("th", headings)
    body = "".join(line("td", row) for row in rows)
    kinds = [kind for kind, is_one in (("facts", words == len(headings)), ("sortable", sortable)) if is_one]
    identity = (f' id="{text(name)}"' if name else "") + (f' class="{" ".join(kinds)}"' if kinds else "")
    return f'<div class="wide"><table{identity}><thead>{head}</thead><tbody>{body}</tbody></table></div>'


def html_table(of: Table, name: str) -> str:
    """A table of results, its numbers to three digits."""
    rows = ([short(cell) if isinstance(cell, float | None) else cell for cell in row] for row in of.rows)
    groups = [(group, len(places)) for group, places in of.groups]
    titles = [column.title for column in of.columns]
    has_groups = any(group for group, _ in groups)
    return table(titles, rows, name=name, groups=groups if has_groups else ())


def details(summary: str, body: str) -> str:
    """A part that is folded up on screen; `summary` is escaped, `body` is HTML."""
    return f"<details><summary>{text(summary)}</summary>{body}</details>"


def paragraph(words: str, kind: str = "") -> str:
    """Escaped text as a paragraph."""
    return f'<p class="{text(kind)}">{text(words)}</p>' if kind else f"<p>{text(words)}</p>"


_KEPT = "\n\N{NO-BREAK SPACE}"  # neither is printable to Python
_RIGHT = ' class="number"'
