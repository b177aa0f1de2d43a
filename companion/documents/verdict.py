"""The verdict in the JSON documents."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict

import msgspec

from companion.analysis import Cause, Finding, Sensitivity, Verdict


class FindingObject(msgspec.Struct, frozen=True):
    """Something that stands out."""

    kind: str
    side: str
    severity: str
    start_s: float
    end_s: float
    evidence: str
    advice: str


class CauseObject(msgspec.Struct, frozen=True):
    """What is wrong, in numbers: SI, boot clock; `end_s` is null where it lasts to the end."""

    kind: str
    side: str
    onset_s: float
    end_s: float | None
    onset_sigma_s: float | None
    sensor: str
    axis: str
    size: float | None
    sigma: float | None
    unit: str
    probability: float | None
    side_probability: float | None
    rival: str
    rival_probability: float | None
    imu: int | None
    consequences: tuple[str, ...]


class FlightVerdictObject(msgspec.Struct, frozen=True):
    """The answer for one flight of several in a log."""

    start_s: float
    end_s: float
    status: str
    summary: str
    cause: CauseObject | None = None


class VerdictObject(msgspec.Struct, frozen=True):
    """The answer."""

    status: str
    summary: str
    findings: list[FindingObject]
    cause: CauseObject | None = None
    detectable: Mapping[str, float] = {}  # rad/s, m/s², rad, m
    not_judged: tuple[str, ...] = ()
    probability: Mapping[str, float] = {}  # by side, "nobody" among them
    flights: list[FlightVerdictObject] = []  # each by itself, where the log holds several


def verdict_object(verdict: Verdict, could: Sensitivity | None = None) -> VerdictObject:
    """The verdict of an examination, and what the flight could have shown; None where it was not examined."""
    return VerdictObject(
        status=verdict.status,
        summary=verdict.summary,
        findings=[finding_object(f) for f in verdict.findings],
        cause=_cause_object(verdict.cause),
        detectable={} if could is None else could.smallest,
        not_judged=() if could is None else could.not_judged,
        probability=dict(verdict.probability),
        flights=[
            FlightVerdictObject(one.start_s, one.end_s, one.status, one.summary, _cause_object(one.cause))
            for one in verdict.flights
        ],
    )


def _cause_object(cause: Cause | None) -> CauseObject | None:
    return None if cause is None else CauseObject(**asdict(cause))


def finding_object(f: Finding) -> FindingObject:
    """A finding, without the numbers behind it."""
    return FindingObject(f.kind, f.side, f.severity, f.start_s, f.end_s, f.evidence, f.advice)
