"""Results as JSON documents (docs/json.md)."""

from companion.documents import schema
from companion.documents.build import analysis_document, encode, info_document, vehicle_object

__all__ = ["analysis_document", "encode", "info_document", "schema", "vehicle_object"]
