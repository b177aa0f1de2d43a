"""Live is the batch in small pieces: a link heard in a thread of its own, and both poses of what it carries, now."""

from companion.app.live.attachment import Attachment
from companion.app.live.live_verdict import HORIZON_S, Alarm, Band, Judge, Judging, LiveVerdict
from companion.app.live.pace import PAUSE_S, Pace
from companion.app.live.replay import LiveReplay, Present
from companion.app.live.watch import Watch

__all__ = [
    "HORIZON_S",
    "PAUSE_S",
    "Alarm",
    "Attachment",
    "Band",
    "Judge",
    "Judging",
    "LiveReplay",
    "LiveVerdict",
    "Pace",
    "Present",
    "Watch",
]
