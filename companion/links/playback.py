"""A recorded telemetry log on a link again, frame by frame at its own pace: for those who test clients.

This is the one place that sends what a log holds, which may be anything. So it never takes a serial port, and a session
with a vehicle, whose allow-list is in `requests`, has no way to it.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from companion.links.ports import Port
from companion.logs import Contents
from companion.mavlink import Decoder, Dialect, Frames, log_time
from companion.model import InputError

_STEP_S = 0.005  # the longest sleep: what the other side says is read and thrown away meanwhile
_SET_S = 3600.0  # a stamp that is further from the latest is of a clock that was set, or damage
_LATE_S = 0.5  # so far behind, the pace begins anew: a machine that was asleep does not send hours at once


@dataclass(slots=True)
class Played:
    """What went out, and what did not."""

    sent: Counter[str] = field(default_factory=Counter)  # message → frames
    unheard: int = 0  # frames that were due while nobody was there
    left_out: Counter[str] = field(default_factory=Counter)  # SYSID:COMPID → frames of senders that were not chosen
    bytes: int = 0


def play(
    path: Path,
    port: Port,
    dialect: Dialect,
    *,
    senders: Collection[tuple[int, int]] | None = None,
    speed: float = 1.0,
    stop: Callable[[], bool] = lambda: False,
) -> Played:
    """Send the frames of a .tlog as they are, byte for byte, at `speed` times the pace of its stamps, until `stop()`.

    senders: (sysid, compid) of those whose frames are sent; None for all. A peer that is there and does not read is
    waited for; the pace begins anew behind it, and where the log's clock was set by more than an hour. Other stamps
    that go back, and those that cannot be, are taken as the one before. Raises InputError for a log without stamps.
    """
    played = Played()
    pace: tuple[float, float] | None = None  # (clock, log time) s that stand for one another
    latest = -np.inf  # s, log time
    for t, who, name, frame in _frames(path, dialect):
        if stop():
            break
        if abs(t - latest) > _SET_S:
            pace, latest = None, t
        latest = max(latest, t)
        if senders is not None and who not in senders:
            played.left_out[f"{who[0]}:{who[1]}"] += 1
            continue
        now = time.monotonic()
        pace = pace or (now, latest)
        due = pace[0] + (latest - pace[1]) / speed
        if now - due > _LATE_S:
            pace = (now, latest)
        while not stop() and (left := due - time.monotonic()) > 0:
            _listen(port)
            time.sleep(min(left, _STEP_S))
        _listen(port)
        while not (went := port.write(frame)) and not port.problem and not stop():
            time.sleep(_STEP_S)
            _listen(port)
        if went:
            played.sent[name] += 1
            played.bytes += len(frame)
        elif not stop():
            played.unheard += 1
    return played


def _listen(port: Port) -> None:
    port.wait(0.0)
    port.read()


def _frames(path: Path, dialect: Dialect) -> Iterator[tuple[float, tuple[int, int], str, bytes]]:
    """Stamp in s (that of the one before where there is none), sender, name and bytes of every valid frame."""
    decoder = Decoder(dialect, stamped=True)
    contents = Contents(path)
    last: float | None = None

    def pieces() -> Iterator[Frames]:
        for chunk in contents.chunks():
            yield decoder.push(chunk)
        yield decoder.finish()

    for frames in pieces():
        if not len(frames):
            continue
        stamped = log_time(frames.stamp)
        known = np.isfinite(stamped)
        if last is None:  # what stands before the first stamp goes out with it
            if not known.any():
                raise InputError(
                    f"{path} has no time stamps, so that its pace is not known: name a telemetry log (.tlog)."
                )
            last = float(stamped[known][0])
        before = np.maximum.accumulate(np.where(known, np.arange(len(stamped)), -1))
        times = np.where(before < 0, last, stamped[before])
        last = float(times[-1])
        columns = (times, frames.sysid, frames.compid, frames.id, frames.start, frames.size)
        for t, sysid, compid, number, start, size in zip(*(column.tolist() for column in columns), strict=True):
            yield t, (sysid, compid), dialect.by_id[number].name, frames.data[start : start + size].tobytes()
