"""What faults would be called in a flight, in the JSON documents."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from companion.estimation import ConfusionMatrix, kind_of


class UndetectedObject(msgspec.Struct, frozen=True):
    """What a fault of the detectable size does to the best estimate, at most."""

    tilt_rad: float
    heading_rad: float
    velocity_mps: float
    position_m: float


class InjectedObject(msgspec.Struct, frozen=True):
    """One kind of fault in the middle of the flight."""

    kind: str
    side: str
    shape: str
    lasts_s: float | None  # that it grows for; null for a step
    unit: str
    detectable: float
    identifiable: float | None
    called: Mapping[str, float]  # kind, or none → share of the data sets, at the detectable size
    undetected: UndetectedObject


class ConfusionObject(msgspec.Struct, frozen=True):
    """The confusion matrix."""

    draws: int
    faults: list[InjectedObject]
    not_shown: tuple[str, ...]


def confusion_object(matrix: ConfusionMatrix | None) -> ConfusionObject | None:
    """None where it was not asked for, or no best estimate could be made."""
    if matrix is None:
        return None
    faults = [
        InjectedObject(
            kind=row.kind,
            side=kind_of(row.kind).side,
            shape=row.shape,
            lasts_s=row.lasts or None,
            unit=kind_of(row.kind).unit,
            detectable=row.detectable,
            identifiable=row.identifiable,
            called=row.called,
            undetected=UndetectedObject(row.tilt, row.heading, row.velocity, row.position),
        )
        for row in matrix.rows
    ]
    return ConfusionObject(matrix.draws, faults, matrix.not_shown)
