"""Results as JSON documents (docs/json.md)."""

from companion.documents.analysis import analysis_document, contrast_document, incident_document
from companion.documents.document import SCHEMA, Document, encode
from companion.documents.estimate import estimate_document, lanes_document
from companion.documents.log import info_document, series_document
from companion.documents.sensors import noise_document, preflight_document
