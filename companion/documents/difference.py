"""What `companion compare --json` prints, and how it is made of two examinations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict

import msgspec

from companion.analysis import Change, Contrast, Finding
from companion.app.examination import Examination
from companion.app.recording import Source
from companion.documents.build import analysis_document, drift_object
from companion.documents.schema import SCHEMA, Analysis, DriftObject
from companion.documents.verdict import FindingObject, finding_object


class ChangeObject(msgspec.Struct, frozen=True):
    """B's error as a multiple of A's, with its 95 % interval."""

    ratio: float
    low: float
    high: float | None  # null: too few windows to bound it
    paired: bool
    direction: str


class ContrastRowObject(msgspec.Struct, frozen=True):
    """One horizon."""

    horizon_s: float
    a: DriftObject
    b: DriftObject
    change: Mapping[str, ChangeObject]


class FigureChangeObject(msgspec.Struct, frozen=True):
    """A fitted error that both flights tell, SI."""

    name: str
    a: float
    b: float
    sigma: float
    differs: bool


class FindingChangesObject(msgspec.Struct, frozen=True):
    """Findings of kinds that only one of the two has, and the kinds that both have."""

    gone: list[FindingObject]
    new: list[FindingObject]
    kept: tuple[str, ...]


class ContrastDocument(msgspec.Struct, frozen=True, kw_only=True):
    """`companion compare --json`."""

    schema: int = SCHEMA
    a: Analysis
    b: Analysis
    same_flight: bool
    drift: list[ContrastRowObject]
    findings: FindingChangesObject
    calibration: list[FigureChangeObject]


def contrast_document(
    contrast: Contrast, a: tuple[Source, Examination], b: tuple[Source, Examination], *, same_flight: bool
) -> ContrastDocument:
    """Both analyses whole, and what differs."""
    return ContrastDocument(
        a=analysis_document(*a),
        b=analysis_document(*b),
        same_flight=same_flight,
        drift=[
            ContrastRowObject(
                row.a.horizon_s,
                drift_object(row.a, row.expected_a),
                drift_object(row.b, row.expected_b),
                {quantity: _change(change) for quantity, change in row.changes.items()},
            )
            for row in contrast.rows
        ],
        findings=FindingChangesObject(_findings(contrast.gone), _findings(contrast.new), contrast.kept),
        calibration=[FigureChangeObject(**asdict(f), differs=f.differs) for f in contrast.figures],
    )


def _change(change: Change) -> ChangeObject:
    return ChangeObject(change.ratio, change.low, change.high, change.paired, change.direction)


def _findings(findings: tuple[Finding, ...]) -> list[FindingObject]:
    return [finding_object(finding) for finding in findings]
