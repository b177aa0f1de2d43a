"""Live is the batch in small pieces: a link heard in a thread of its own, and both poses of what it carries, now."""

from companion.live.attachment import Attachment
from companion.live.opinion import HORIZON_S, Alarm, Band, Judge, Judging, Opinion
from companion.live.pace import Pace
from companion.live.replay import LiveReplay, Present
from companion.live.watch import Watch

__all__ = [
    "HORIZON_S",
    "Alarm",
    "Attachment",
    "Band",
    "Judge",
    "Judging",
    "LiveReplay",
    "Opinion",
    "Pace",
    "Present",
    "Watch",
]
