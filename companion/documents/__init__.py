"""Results as JSON documents (docs/json.md)."""

from companion.documents.analysis import analysis_document, contrast_document, unexamined_document
from companion.documents.document import SCHEMA, Document, encode
from companion.documents.estimate import estimate_document
from companion.documents.incident import incident_document
from companion.documents.info import info_document
from companion.documents.lanes import lanes_document
from companion.documents.noise import noise_document
from companion.documents.preflight import preflight_document
from companion.documents.series import series_document
