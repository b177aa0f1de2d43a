"""A flight without what was measured in some stretches of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from companion.model.flight import Flight
from companion.model.tracks import Track, rows


class Change(Protocol):
    """A function of a track of any kind to one of the same kind."""

    def __call__(self, track: Track, /) -> Track: ...


def with_tracks(flight: Flight, change: Change) -> Flight:
    """The flight with every track of its sensors and its estimate changed."""
    return replace(
        flight,
        imus={name: change(track) for name, track in flight.imus.items()},
        attitude=None if flight.attitude is None else change(flight.attitude),
        position=None if flight.position is None else change(flight.position),
        gps=tuple(map(change, flight.gps)),
        compasses=tuple(map(change, flight.compasses)),
        barometers=tuple(map(change, flight.barometers)),
        airspeeds=tuple(map(change, flight.airspeeds)),
        ranges=tuple(map(change, flight.ranges)),
        flows=tuple(map(change, flight.flows)),
    )


def without(flight: Flight, spans: Sequence[tuple[float, float]]) -> Flight:
    """The flight without the samples of sensors and estimate within spans (s, boot clock); messages and events stay."""
    if not spans:
        return flight

    def outside(track: Track) -> Track:
        kept = np.ones(len(track), np.bool_)
        for begin, end in spans:
            kept &= (track.t < begin) | (track.t >= end)
        return rows(track, kept)

    return with_tracks(flight, outside)
