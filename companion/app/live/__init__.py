"""Live is the batch in small pieces: a link heard in a thread of its own, and both poses of what it carries, now."""

from companion.app.live.attachment import Attachment
from companion.app.live.judge import HORIZON_S, Judge, Judging, NothingYetError
from companion.app.live.judges import Judges
from companion.app.live.pace import PAUSE_S, Pace
from companion.app.live.replay import LiveReplay, Present
from companion.app.live.watch import Watch

__all__ = [
    "HORIZON_S",
    "PAUSE_S",
    "Attachment",
    "Judge",
    "Judges",
    "Judging",
    "LiveReplay",
    "NothingYetError",
    "Pace",
    "Present",
    "Watch",
]
