"""Results as JSON documents (docs/json.md)."""

from companion.documents import schema
from companion.documents.build import analysis_document, encode, info_document, unexamined_document, vehicle_object
from companion.documents.contrast import contrast_document

__all__ = [
    "analysis_document",
    "contrast_document",
    "encode",
    "info_document",
    "schema",
    "unexamined_document",
    "vehicle_object",
]
