"""Frames collected chunk by chunk, as the columns of each message type, written once and in place."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.mavlink import Dialect, Frames, Index, MessageLayout, Messages, gather_rows, grouped, log_time

_MARGIN = 1.05  # of the expected number of messages
_LEAST = 64

_HEADER: dict[str, npt.DTypeLike] = {
    "offset": np.int64, "log_time": np.float64, "sysid": np.uint8, "compid": np.uint8, "seq": np.uint8,
    "crc": np.uint16,
}  # fmt: skip


class Collected:
    """The frames of a file so far. names: the message types whose rows are gathered (None: all).

    Room is made for as many messages as the file will have if it goes on as it began; memory that is never written
    is never used. So nothing is copied a second time, which would cost a tenth of all time and twice the memory.
    """

    def __init__(self, dialect: Dialect, names: Collection[str] | None) -> None:
        self._dialect = dialect
        self._names = names
        self._types: dict[str, _Type] = {}
        self.count = 0
        self.first_log_time = self.last_log_time = math.nan  # s UNIX, of those that can be believed

    def add(self, frames: Frames, share: float) -> None:
        """Take over what `frames` holds; their bytes are not kept. share: how much of the file has been read, 0 to 1.

        0 where that is not known.
        """
        self.count += len(frames)
        times = log_time(frames.stamp)
        believable = np.isfinite(times)
        if believable.any():
            self.last_log_time = float(times[len(times) - 1 - int(np.argmax(believable[::-1]))])
            if math.isnan(self.first_log_time):
                self.first_log_time = float(times[int(np.argmax(believable))])
        for layout, index in grouped(frames, self._dialect):
            wanted = self._names is None or layout.name in self._names
            if layout.name not in self._types:
                self._types[layout.name] = _Type(layout, wanted=wanted)
            self._types[layout.name].add(frames, index, times, share)

    def messages(self) -> dict[str, Messages]:
        """Everything by message name, in order of first appearance."""
        ordered = sorted(self._types.values(), key=lambda one: int(one.columns["offset"][0]))
        return {one.layout.name: one.messages() for one in ordered}


class _Type:
    """The messages of one type, in arrays with room for more."""

    def __init__(self, layout: MessageLayout, *, wanted: bool) -> None:
        self.layout = layout
        self.columns: dict[str, npt.NDArray[Any]] = {name: np.empty(0, dtype) for name, dtype in _HEADER.items()}
        if wanted:
            self.columns["rows"] = np.empty((0, layout.max_length), np.uint8)
        self._count = 0

    def add(self, frames: Frames, index: Index, times: npt.NDArray[np.float64], share: float) -> None:
        begin, end = self._count, self._count + len(index)
        if end > len(self.columns["offset"]):
            self._make_room(end, share)
        for name in _HEADER:
            values = times if name == "log_time" else getattr(frames, name)
            # "clip", for every index is one: NumPy then writes in place.
            np.take(values, index, out=self.columns[name][begin:end], mode="clip")
        if "rows" in self.columns:
            gather_rows(frames, index, self.layout, out=self.columns["rows"][begin:end])
        self._count = end

    def messages(self) -> Messages:
        header = {name: self.columns[name][: self._count] for name in _HEADER}
        if "rows" not in self.columns:
            return Messages(layout=self.layout, **header, rows=np.empty(0, self.layout.dtype))
        rows = self.columns["rows"][: self._count].view(self.layout.dtype)[:, 0]
        return Messages(layout=self.layout, **header, rows=rows)

    def _make_room(self, needed: int, share: float) -> None:
        expected = needed / share * _MARGIN if share > 0 else 0.0
        room = int(max(_LEAST, 2 * needed if needed > expected else expected))
        for name, old in self.columns.items():
            new = np.empty((room, *old.shape[1:]), old.dtype)
            new[: self._count] = old[: self._count]
            self.columns[name] = new
