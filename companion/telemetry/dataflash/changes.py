"""What an ArduPilot log announces: resets and changes of core of its EKF, and parameters set in flight.

Sources: ArduPilot `AP_NavEKF3_Logging.cpp` (XKF4), `AP_Logger.h` (LogEvent).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from companion.logs import Records
from companion.model import EstimatorReset, ParameterChange, ResetKind, StatusText
from companion.telemetry import events
from companion.telemetry.dataflash.cores import Flew, imu_of_core, of_cores, primary_cores

_EVENTS: Mapping[int, tuple[ResetKind, str]] = {60: ("height", "EKF height reset"), 62: ("heading", "EKF yaw reset")}
_SAME_S = 0.5  # an event and a text of the same kind within it are one reset


def resets(
    records: Mapping[str, Records], texts: Sequence[StatusText], parameters: Mapping[str, float], mine: Flew
) -> tuple[EstimatorReset, ...]:
    """All that are announced of the EKF that flew, in order of time, each once."""
    announced = [
        *_by_text(texts, parameters, mine),
        *_by_event(records),
        *_by_offset(records, mine),
        *_lanes(records, mine),
    ]
    kept: list[EstimatorReset] = []
    for one in sorted(announced, key=lambda reset: reset.t):
        again = any(
            one.kind == other.kind
            and one.t - other.t < _SAME_S
            and (one.core is None or other.core in (None, one.core))
            for other in kept[-8:]
        )
        if not again:
            kept.append(one)
    return tuple(kept)


def _by_text(texts: Sequence[StatusText], parameters: Mapping[str, float], mine: Flew) -> Iterator[EstimatorReset]:
    """Texts name the IMU of a core."""
    cores = {imu: core for core in range(8) if (imu := imu_of_core(core, mine.prefix, parameters)) is not None}
    for reset in events.text_resets(texts):
        core = reset.core
        yield reset if core is None or reset.kind == "lane" else replace(reset, core=cores.get(core, core))


def _by_event(records: Mapping[str, Records]) -> Iterator[EstimatorReset]:
    if "EV" in records and records["EV"].layout.has_numbers("Id"):
        for t, number in zip(records["EV"].t.tolist(), records["EV"]["Id"].tolist(), strict=True):
            if number in _EVENTS:
                yield EstimatorReset(t, *_EVENTS[number])


def _by_offset(records: Mapping[str, Records], mine: Flew) -> Iterator[EstimatorReset]:
    """XKF4.OFN and OFE: by how much the position was reset last, m."""
    for core, one in of_cores(records, f"{mine.prefix}F4").items():
        if not one.layout.has_numbers("OFN", "OFE") or len(one) < 2:
            continue
        offset = one.columns("OFN", "OFE")
        for i in (np.flatnonzero(np.diff(offset, axis=0).any(axis=1)) + 1).tolist():
            if np.isfinite(offset[i]).all():
                size = float(np.linalg.norm(offset[i]))
                yield EstimatorReset(float(one.t[i]), "position", f"EKF position reset of {size:.2f} m", core)


def _lanes(records: Mapping[str, Records], mine: Flew) -> Iterator[EstimatorReset]:
    """Changes of XKF4.PI."""
    if (one := primary_cores(records, mine.prefix)) is not None:
        words = "the EKF's primary core is {core}, and was {before}"
        yield from events.lane_changes(one.t, one["PI"].astype(np.int64), words)


def parameter_changes(records: Mapping[str, Records]) -> tuple[ParameterChange, ...]:
    """PARM that says another value than before: all are written once where the log begins."""
    if "PARM" not in records:
        return ()
    one = records["PARM"]
    return events.parameter_changes(one["Name"].tolist(), one.t, one["Value"].astype(np.float64))
