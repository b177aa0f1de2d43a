"""A flight without what was measured in some stretches of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import TypeVar

import numpy as np

from companion.model.flight import Flight
from companion.model.tracks import Sampled

Track = TypeVar("Track", bound=Sampled)


def without(flight: Flight, spans: Sequence[tuple[float, float]]) -> Flight:
    """The flight as if no sensor had read anything within spans (s, boot clock), and the estimator had told nothing.

    What the vehicle said, did and was asked for stays.
    """
    if not spans:
        return flight

    def outside(track: Track) -> Track:
        kept = np.ones(len(track), np.bool_)
        for begin, end in spans:
            kept &= (track.t < begin) | (track.t >= end)
        columns = {field.name: getattr(track, field.name) for field in fields(track)}  # type: ignore[arg-type]
        arrays = {n: v[kept] for n, v in columns.items() if isinstance(v, np.ndarray) and len(v) == len(kept)}
        return replace(track, **arrays)  # type: ignore[type-var]

    return replace(
        flight,
        imus={name: outside(track) for name, track in flight.imus.items()},
        attitude=None if flight.attitude is None else outside(flight.attitude),
        position=None if flight.position is None else outside(flight.position),
        gps=tuple(map(outside, flight.gps)),
        compasses=tuple(map(outside, flight.compasses)),
        barometers=tuple(map(outside, flight.barometers)),
        airspeeds=tuple(map(outside, flight.airspeeds)),
        ranges=tuple(map(outside, flight.ranges)),
        flows=tuple(map(outside, flight.flows)),
    )
