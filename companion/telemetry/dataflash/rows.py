"""What all records of an ArduPilot log share: several sensors of a kind, the time of a sample, and whether it is sound.

Source: ArduPilot `AP_Logger/LogStructure.h`, and its tags before 4.0 for the names of old.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from companion.logs import Records
from companion.model import Array
from companion.telemetry.timestamps import ON_BOARD, left_out, off_course

_FIX_3D = 3
_HAPPENINGS = ("PARM", "EV", "ERR", "MODE", "MSG")  # hold from then on: whatever the time, it counts
_STALE_S = 1.0  # a sample's own time that lies further from the record's is none


def sources(records: Mapping[str, Records], names: tuple[str, ...]) -> Iterator[tuple[int, str, Records]]:
    """Instance, what viewers call it ("GPS[1]"), and its records: by an instance column, in older logs by the name."""
    for number, name in enumerate(names):
        if name in records:
            for instance in records[name].instances or (number,):
                yield int(instance), f"{names[0]}[{instance}]", records[name].instance(instance)


def sample_time(one: Records, field: str) -> Array:
    """(N,) s: when each sample was taken, by a column of whole ms or µs; where that is absurd, when it was logged.

    Both count in a uint32 that wraps.
    """
    if not one.layout.has_numbers(field):
        return one.t
    unit = 1e-6 if field == "S" else 1e-3
    wrap = 2.0**32 * unit
    age = np.mod(one.t - one[field].astype(np.float64) * unit, wrap)
    age = np.where(age > wrap / 2, age - wrap, age)
    return np.where((np.abs(age) < _STALE_S) & (one[field] != 0), one.t - age, one.t)


def sound(one: Records) -> npt.NDArray[np.bool_]:
    """(N,) whether the driver vouches for a sample; older logs do not say."""
    flag = next((name for name in ("Health", "H") if one.layout.has_numbers(name)), None)
    return np.ones(len(one), np.bool_) if flag is None else np.asarray(one[flag] != 0)


def with_times(records: Mapping[str, Records]) -> tuple[dict[str, Records], list[str]]:
    """The same, each with its times, without those that leave the flight's course; and notes on these.

    Before 2015 PARM, EV, ERR, MODE and MSG have no time, and get that of their neighbours; until ArduCopter 3.1 no
    record has one, and the GPS's own is taken. Nothing is left where it has none either.
    """
    if not any(one.layout.clock for one in records.values()):
        return _by_gps(records)
    times = {name: one.t for name, one in records.items() if one.layout.clock}
    apart = off_course(times, ON_BOARD)
    notes = left_out(times, apart)
    timed = {
        name: replace(records[name], given=t) if name not in apart else records[name].select(~apart[name])
        for name, t in times.items()
    }
    timed = {name: one for name, one in timed.items() if len(one)}
    if not timed:
        return {}, notes
    clock = max(timed.values(), key=len)
    bare = {
        name: replace(one, given=np.interp(one.offset, clock.offset, clock.t))
        for name, one in records.items()
        if not one.layout.clock and one.rows.dtype.names
    }
    return {name: (timed | bare)[name] for name in records if name in timed or name in bare}, notes


def _by_gps(records: Mapping[str, Records]) -> tuple[dict[str, Records], list[str]]:
    """Records on the clock of the GPS from its first fix on, and a note: samples between the first fix and the last."""
    gps = records.get("GPS")
    if gps is None or not gps.layout.has_numbers("Time", "Status"):
        return {}, []
    t, fixed = gps["Time"] * 1e-3, gps["Status"] >= _FIX_3D
    gps = gps.select(fixed & (t >= np.maximum.accumulate(np.where(fixed, t, -np.inf))))
    if len(gps) < 2:
        return {}, []
    since = (gps["Time"] - gps["Time"][0]) * 1e-3

    def timed(one: Records) -> Records:
        inside = (one.offset >= gps.offset[0]) & (one.offset <= gps.offset[-1])
        one = one.select(inside | (one.name in _HAPPENINGS))
        return replace(one, given=np.interp(one.offset, gps.offset, since))

    within = {name: timed(one) for name, one in records.items() if one.rows.dtype.names}
    return within, ["no record has a time (ArduCopter 3.1 and older): that is the GPS's, in s since its first fix"]
