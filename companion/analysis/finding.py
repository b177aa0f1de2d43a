"""A finding: something that stands out in a flight."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from companion.analysis.reference import BoolArray
from companion.model import Array

IntArray = npt.NDArray[np.intp]

Side = Literal["imu", "autopilot", "data"]
Severity = Literal["info", "warning", "error"]


@dataclass(frozen=True, slots=True)
class Cause:
    """What is wrong, in numbers: SI, boot clock."""

    kind: str
    side: Side
    onset_s: float
    end_s: float | None = None  # None: it lasts to the end
    onset_sigma_s: float | None = None
    sensor: str = ""  # "gyro", "accel", "gps", "compass", "barometer"; "" where it is none, or none alone
    axis: str = ""  # "x", "y", "z" of the body; "" where it is not one alone
    size: float | None = None  # length of the vector, at its greatest
    sigma: float | None = None
    unit: str = ""
    rival: str = ""  # kind of the next best explanation; "" where none was near
    rival_worse: float | None = None  # log-likelihood by which it explains less
    consequences: tuple[str, ...] = ()  # what it did to the autopilot's estimate, in words


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that stands out."""

    kind: str
    side: Side  # whom it speaks against
    severity: Severity  # an error decides the verdict; a warning may explain it; info is said
    start_s: float  # boot clock
    end_s: float
    evidence: str
    advice: str
    headline: str = ""  # the evidence in one clause; "" where that is one
    cause: Cause | None = None
    undecided: bool = False  # either may be wrong: it accuses nobody, and nobody is cleared


def by_severity(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Errors first, then warnings, then what is only said; each in order of time."""
    order = get_args(Severity)[::-1]
    return tuple(sorted(findings, key=lambda f: (order.index(f.severity), f.start_s)))


def setting(px4: str, ardupilot: str, autopilot: str) -> str:
    """The name of a setting at the autopilot at hand; both where that is neither."""
    known = {"PX4": px4, "ARDUPILOTMEGA": ardupilot}
    return known.get(autopilot, f"{ardupilot} (ArduPilot), {px4} (PX4)")


def digits(value: Array, decimals: int) -> str:
    """The components of a vector in words."""
    return ", ".join(f"{v:.{decimals}f}" for v in value)


def run_edges(flags: BoolArray) -> tuple[IntArray, IntArray]:
    """First and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return edges[::2], edges[1::2] - 1


def runs(flags: BoolArray) -> Iterator[tuple[int, int]]:
    """The same, run by run."""
    yield from zip(*(edge.tolist() for edge in run_edges(flags)), strict=True)
