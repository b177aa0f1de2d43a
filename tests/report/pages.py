"""Reports made for tests, and what is in them."""

from __future__ import annotations

import json
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

from plotly import graph_objects

from companion.cli import main
from tests.recordings import BUNDLED

DEMO = str(BUNDLED / "copter-demo-100hz.tlog")


def report(log: str | Path, path: Path, *more: str) -> str:
    """The page that the command writes."""
    assert main(["report", str(log), "-o", str(path), *more]) == 0
    return path.read_text(encoding="utf-8")


class Contents(HTMLParser):
    """Cells of tables that have an id, contents of scripts that have one, sections, and every element's name."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tables: dict[str, list[list[str]]] = {}
        self.scripts: dict[str, str] = {}
        self.sections: dict[str, str] = {}  # id → its words
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self._table: list[list[str]] | None = None
        self._script: str | None = None
        self._section = ""
        self.feed(html)

    @property
    def figures(self) -> list[Any]:
        """The charts. Raises ValueError where one is none to plotly."""
        return [graph_objects.Figure(figure).to_dict() for figure in json.loads(self.scripts["figures"])]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        name = dict(attrs).get("id")
        self.elements.append((tag, dict(attrs)))
        if tag == "table":
            self._table = self.tables.setdefault(name, []) if name else None
        elif tag == "tr" and self._table is not None:
            self._table.append([])
        elif tag in ("td", "th") and self._table is not None:
            self._table[-1].append("")
        elif tag == "script":
            self._script = name or "without id"
        elif tag == "section" and name:
            self._section = name
            self.sections[name] = ""

    def handle_endtag(self, tag: str) -> None:
        if tag == "table":
            self._table = None
        elif tag == "script":
            self._script = None
        elif tag == "section":
            self._section = ""

    def handle_data(self, data: str) -> None:
        if self._script is not None:
            self.scripts[self._script] = self.scripts.get(self._script, "") + data
            return
        if self._section:
            self.sections[self._section] += data
        if self._table and self._table[-1]:
            self._table[-1][-1] += data
