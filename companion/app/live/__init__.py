"""Live is the batch in small pieces: a link received in a thread of its own, and both poses of what it carries, now."""

from companion.app.live.attachment import Attachment
from companion.app.live.judge import HORIZON_S, PAUSE_S, Judge, Judges, Judging, NothingYetError, Pace, new_stream
from companion.app.live.watch import LiveReplay, Watch
