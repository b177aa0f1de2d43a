"""The checks before take-off: a section of the page of a vehicle that only stands."""

from __future__ import annotations

from companion.analysis import phases
from companion.app.sensors import preflight_of
from companion.model import DataError
from companion.present import html_table, paragraph, preflight_headline, preflight_table
from companion.report.html_page import Section
from companion.report.subject import Subject


def sections(subject: Subject) -> list[Section]:
    """One, where the vehicle stands and never leaves the ground; else none."""
    flight = subject.flight
    if any(part.kind in ("flight", "impact") for part in phases(flight)):
        return []
    try:
        result = preflight_of(flight)
    except DataError:
        return []
    body = paragraph(preflight_headline(result))
    body += "".join(paragraph(f"Not checked: {one}") for one in result.missing)
    body += "".join(paragraph(f"The vehicle says: {one}") for one in result.vehicle_reports)
    return [Section("preflight", "Before take-off", body + html_table(preflight_table(result), "checks"))]
