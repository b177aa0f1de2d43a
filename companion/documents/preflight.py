"""`companion preflight --json` (docs/json.md)."""

from __future__ import annotations

from collections.abc import Sequence

from companion.analysis import Ageing, Preflight
from companion.app.recording import Source
from companion.documents.document import Document, document, flight_head, of
from companion.model import Flight


def preflight_document(source: Source, flight: Flight, result: Preflight, aged: Sequence[Ageing] = ()) -> Document:
    """The checks of a vehicle that stands, and those of its earlier flights beside them."""
    before = {(one.check.name, one.check.sensor): of(one, "before", "spread", "times", "changed") for one in aged}
    checked = {
        **flight_head(flight),
        **of(result, "outcome", "start_s", "end_s", "motors_off"),
        "checks": [
            {
                **of(one, "name", "sensor", "outcome", "size", "sigma", "limit", "unit", "probability"),
                **of(one, "autopilot", "autopilot_limit", "note", "uncorrected"),
                "history": before.get((one.name, one.sensor)),
            }
            for one in result.checks
        ],
        **of(result, "vehicle_reports", "missing"),
    }
    return document(source, [checked])
