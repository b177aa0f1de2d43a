"""Results as JSON documents (docs/json.md)."""

from companion.documents.document import (
    SCHEMA,
    Document,
    analysis_document,
    contrast_document,
    encode,
    estimate_document,
    incident_document,
    info_document,
    lanes_document,
    noise_document,
    preflight_document,
    series_document,
)
