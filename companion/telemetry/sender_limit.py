"""Who is listened to on a link where more speak than there can be: ids are free, and may all be made up."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from companion.mavlink import Frames

_MOST_SENDERS = 64  # that are all listened to
_MOST_IN_A_CROWD = 16  # where there are more: those with the most frames
_LEAST_SHARE = 0.005  # of the frames, that such a one has: a vehicle at 250 Hz beside 50,000 made-up frames/s
_ROUND = 2000  # frames between two counts
_FADED = 0.5  # frames: half of a count is forgotten at each of the next


class Crowd:
    """Lets the frames of at most so many senders through; up to 64, and there is no crowd, all of them."""

    def __init__(self) -> None:
        self._counts = np.zeros(1 << 16)  # by sysid << 8 | compid, fading
        self._heard = self._counts > 0
        self._chosen: npt.NDArray[np.bool_] | None = None  # by the same; None: everybody
        self._frames = 0  # since the last count

    def admit(self, frames: Frames) -> Frames:
        """Those of the frames whose senders are listened to."""
        if not len(frames):
            return frames
        sender = frames.sysid.astype(np.intp) << 8 | frames.compid
        np.add.at(self._counts, sender, 1.0)
        self._frames += len(frames)
        someone_new = not self._heard[sender].all()
        self._heard[sender] = True
        if someone_new and self._chosen is None and self._heard.sum() > _MOST_SENDERS:
            self._choose()
        elif self._frames >= _ROUND:
            self._count_again()
        return frames if self._chosen is None else frames.select(self._chosen[sender])

    def _count_again(self) -> None:
        self._choose()
        self._frames = 0
        self._counts *= 0.5
        self._counts[self._counts < _FADED] = 0.0
        self._heard = self._counts > 0

    def _choose(self) -> None:
        if self._heard.sum() <= _MOST_SENDERS:
            self._chosen = None
            return
        most = np.argpartition(self._counts, -_MOST_IN_A_CROWD)[-_MOST_IN_A_CROWD:]
        self._chosen = np.zeros(len(self._counts), np.bool_)
        self._chosen[most[self._counts[most] >= _LEAST_SHARE * self._counts.sum()]] = True
