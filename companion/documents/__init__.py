"""Results as JSON documents (docs/json.md)."""

from companion.documents.analysis import analysis_document, contrast_document, incident_document
from companion.documents.document import SCHEMA, Document, encode, info_document, series_document
from companion.documents.sensors import estimate_document, lanes_document, noise_document, preflight_document
