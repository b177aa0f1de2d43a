"""What a run leaves in its folder: four Parquet tables and the page. Nothing is written where nothing has changed."""

from __future__ import annotations

import hashlib
import html
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from companion.app.destination import replacing
from companion.fleet.journal import printable
from companion.fleet.page import fleet_html
from companion.fleet.records import LogRecord
from companion.fleet.rows import COLUMNS, Rows, arrow_table, rows_of
from companion.fleet.search import FoundLog
from companion.model import InputError

PAGE = "fleet.html"
_STATE = b"state"


def write_results(folder: Path, logs: Sequence[tuple[FoundLog, LogRecord]], about: Mapping[str, str]) -> list[Path]:
    """Write tables and page, each replaced in one step; [] when they are there and say the same already.

    about: how the rows were made, said on the page and in the metadata of each table. Raises InputError when a library
    is missing or the folder cannot be written to.
    """
    import pyarrow.parquet as pq  # noqa: PLC0415  (an extra)

    known = [(printable(log.path), record) for log, record in logs]
    state = hashlib.sha256(msgspec.json.encode([known, about], order="sorted")).hexdigest()
    paths = [*(folder / f"{name}.parquet" for name in COLUMNS), folder / PAGE]
    if all(path.is_file() for path in paths) and _state_of(paths[0]) == state:
        return []
    rows = rows_of(logs)
    page = _page(rows, about)
    try:
        with replacing(paths[-1]) as draft:
            draft.write_text(page, encoding="utf-8")
        for name, path in zip(
            reversed([*COLUMNS]), reversed(paths[:-1]), strict=True
        ):  # "flights", with the state, last
            table = arrow_table(name, getattr(rows, name))
            with replacing(path) as draft:
                pq.write_table(table.replace_schema_metadata({**about, "state": state}), draft)
    except InputError as error:
        raise InputError(f"{error} What was examined is kept.") from None
    return paths


def _page(rows: Rows, about: Mapping[str, str]) -> str:
    """The page; where it cannot be drawn, one that says so: the tables are not lost for that."""
    try:
        return fleet_html(rows, [(name.replace("_", " "), value) for name, value in about.items()])
    except Exception as error:  # noqa: BLE001
        said = html.escape(f"{type(error).__name__}: {error}")
        return f"<!doctype html><title>Fleet</title><p>This page cannot be drawn ({said}). The tables are beside it."


def _state_of(path: Path) -> str | None:
    """What a table says that it was made of; None for a file that is none of ours."""
    import pyarrow as pa  # noqa: PLC0415
    import pyarrow.parquet as pq  # noqa: PLC0415

    try:
        metadata = pq.read_schema(path).metadata or {}
    except (OSError, pa.ArrowInvalid):
        return None
    return metadata.get(_STATE, b"").decode() or None
