"""Results as JSON documents (docs/json.md)."""

from companion.documents import schema
from companion.documents.build import analysis_document, encode, info_document, unexamined_document, vehicle_object
from companion.documents.difference import contrast_document
from companion.documents.estimate import estimate_document
from companion.documents.noise import noise_document
from companion.documents.verdict import FindingObject

__all__ = [
    "FindingObject",
    "analysis_document",
    "contrast_document",
    "encode",
    "estimate_document",
    "info_document",
    "noise_document",
    "schema",
    "unexamined_document",
    "vehicle_object",
]
