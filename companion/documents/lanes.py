"""`companion lanes --json` (docs/json.md)."""

from __future__ import annotations

from companion.analysis import Lanes, LaneSpan
from companion.app.recording import Source
from companion.documents.document import Document, document, flight_head, of
from companion.estimation import BestEstimate
from companion.model import Flight


def lanes_document(source: Source, flight: Flight, best: BestEstimate, lanes: Lanes) -> Document:
    """A flight's lanes against its best estimate."""
    judged = {
        **flight_head(flight),
        "imu": best.imu.source,
        "lanes": [
            {**of(one, "name", "core", "source", "imu"), "start_s": float(one.t[0]), "end_s": float(one.t[-1])}
            for one in lanes.lanes
        ],
        "flown": [] if lanes.in_use is None else [{"t_s": t, "core": core} for t, core in lanes.in_use.changes],
        "switches": [
            {
                "t_s": one.t,
                **of(one, "before", "after", "judgement", "probability", "end_s"),
                "quantity": one.quantity or None,
                **of(one, "before_size", "after_size", "sigma", "reset_s", "why"),
            }
            for one in lanes.switches
        ],
        "spans": [_span(one) for one in lanes.spans],
        "notes": lanes.notes,
    }
    return document(source, [judged])


def _span(span: LaneSpan) -> Document:
    return {**of(span, "what", "start_s", "end_s", "flown", "right", "readers"), "lanes": span.lanes}
