"""How to integrate: the settings that every integration takes, checked once, and what they mean for a track."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.model import ImuTrack
from companion.strapdown._methods import METHODS
from companion.strapdown._signal import MIDDLES, UNEVEN, uneven


@dataclass(frozen=True, slots=True)
class Scheme:
    """How to integrate: a method, the signal inside an interval, and the pieces that the interval is cut into."""

    method: str
    middle: str
    segments: int

    @property
    def looks_ahead(self) -> bool:
        """Whether an interval needs the sample after it: where a method looks inside an interval, and by the cubic."""
        return self.middle == "cubic" and (METHODS[self.method].looks_inside or self.segments > 1)

    def notes_on(self, imu: ImuTrack) -> tuple[str, ...]:
        """What a user must know about this scheme on this track that the numbers do not show."""
        notes = []
        if self.looks_ahead and len(imu) in (2, 3):
            shape = "the line" if len(imu) == 2 else "the parabola"
            notes.append(
                f"the cubic needs 4 samples and the track has {len(imu)}: {shape} through them was used instead"
            )
        if len(imu) < 2:
            return ()
        # Both bounds are cheap; only a track that breaks one is looked at step by step.
        dt = imu.t[1:] - imu.t[:-1]
        longest = dt.max()
        if self.looks_ahead and longest > UNEVEN * dt.min():
            notes.append(
                f"{int(uneven(dt).sum())} of {len(dt)} intervals are more than {UNEVEN:g} times as long as a neighbour "
                "(a hole, or a burst of samples): the signal is taken as a line there"
            )
        if np.abs(imu.gyro).max() * longest > np.pi / np.sqrt(3.0):
            rate = np.linalg.norm(imu.gyro, axis=1)
            fast = int((np.maximum(rate[:-1], rate[1:]) * dt > np.pi).sum())
            if fast:
                notes.append(
                    f"{fast} of {len(dt)} intervals turn by more than π: samples that far apart do not determine "
                    "the attitude; record at a higher rate or leave these intervals out"
                )
        return tuple(notes)


def scheme_for(method: str, middle: str, segments: int) -> Scheme:
    """The scheme with these settings. Raises ValueError if one of them is no good."""
    if method not in METHODS:
        raise ValueError(f"unknown method {method!r}: choose one of {', '.join(METHODS)}")
    if middle not in MIDDLES:
        raise ValueError(f"unknown middle {middle!r}: choose one of {', '.join(MIDDLES)}")
    if segments < 1:
        raise ValueError(f"segments must be 1 or more, got {segments}")
    return Scheme(method, middle, segments)


def require_samples(imu: ImuTrack) -> None:
    """Raises ValueError for a track without samples."""
    if len(imu) == 0:
        raise ValueError("the IMU track has no samples; an integration needs at least one")
