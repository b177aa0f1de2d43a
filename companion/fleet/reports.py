"""The report of a flight, written by the worker that examined it into the folder of the results."""

from __future__ import annotations

import re
from pathlib import Path

from companion.app.destination import replacing
from companion.app.examination import Examination
from companion.app.recording import Recording
from companion.app.settings import Settings
from companion.model import InputError
from companion.report import report_html

_FOLDER = "reports"


def write_report(folder: Path, recording: Recording, examined: Examination, settings: Settings, digest: str) -> str:
    """Write it, and return its place in the folder: named after the log and its content.

    Raises InputError when plotly is not installed or the folder is not to be seen from here, OSError when the file
    cannot be written.
    """
    if not folder.is_dir():
        raise InputError(f"the folder {folder} is not here: reports need a file system that all workers share.")
    flight = examined.flight
    which = "" if len(recording.flights) == 1 else f"-{flight.vehicle.sysid}.{flight.vehicle.compid}-{flight.boot}"
    stem = re.sub(r"[^\w.-]+", "_", recording.source.path.stem, flags=re.ASCII)[:80]
    name = f"{_FOLDER}/{stem}-{digest[:10]}{which}.html"
    (folder / _FOLDER).mkdir(exist_ok=True)
    page = report_html(examined, recording.source, settings, command=f"companion report {recording.source.path.name}")
    with replacing(folder / name) as draft:
        draft.write_text(page, encoding="utf-8", errors="replace")
    return name
