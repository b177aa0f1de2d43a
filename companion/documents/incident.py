"""`companion incident --json` (docs/json.md)."""

from __future__ import annotations

from companion.analysis import Incident
from companion.app.recording import Source
from companion.documents.document import Document, document, flight_head, of
from companion.model import Flight


def incident_document(source: Source, flight: Flight, incident: Incident) -> Document:
    """The seconds around an incident."""
    content = {
        **flight_head(flight),
        "moment": {"t_s": incident.moment.t, **of(incident.moment, "kind", "text")},
        **of(incident, "start_s", "end_s", "causes", "timeline", "imus", "tracking", "outputs", "missing"),
    }
    return document(source, [content])
