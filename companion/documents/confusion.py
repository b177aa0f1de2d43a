"""The confusion matrix of faults in `companion analyze --json` (docs/json.md)."""

from __future__ import annotations

from companion.documents.document import Document, of
from companion.estimation import ConfusionMatrix, kind_of


def confusion_part(matrix: ConfusionMatrix | None) -> Document | None:
    """None where it was not requested, or no best estimate could be made."""
    if matrix is None:
        return None
    faults = [
        {
            "kind": row.kind,
            "side": kind_of(row.kind).side,
            "shape": row.shape,
            "lasts_s": row.lasts or None,
            "unit": kind_of(row.kind).unit,
            **of(row, "detectable", "identifiable", "called"),
            "undetected": {
                "tilt_rad": row.tilt,
                "heading_rad": row.heading,
                "velocity_mps": row.velocity,
                "position_m": row.position,
            },
        }
        for row in matrix.rows
    ]
    return {"draws": matrix.draws, "faults": faults, "not_shown": matrix.not_shown}
