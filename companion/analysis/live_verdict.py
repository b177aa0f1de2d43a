"""What is said of a vehicle at one moment while it is listened to: the verdict now, how old it is, and all alarms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from companion.analysis.finding import Cause
from companion.constants import check

Band = tuple[tuple[float, float, float, float], ...]
"""Time since an anchor, s, and 1σ of what the error is expected to be then: attitude °, velocity m/s, position m."""

State = Literal["consistent", "imu_suspect", "autopilot_suspect", "insufficient_data", "starting", "lost", "stale", ""]
"""A verdict; the estimator aligns or a flight has just begun; control was lost; the data are old; nothing yet."""


@dataclass(frozen=True, slots=True)
class Alarm:
    """A time in which somebody was suspect."""

    status: State
    text: str  # as it was said last, when most was known
    first: float  # s UNIX, of the newest data when it was said first
    last: float  # ... and last
    when: str = ""  # the same in words, by the clock of the computer


@dataclass(frozen=True, slots=True)
class LiveVerdict:
    """What is to be said at one moment. All text is untrusted."""

    status: State  # when its data were new
    text: str
    newest: float = 0.0  # s UNIX, when the newest data that it rests on arrived; 0: it rests on none
    vehicle: str = ""
    alarms: tuple[Alarm, ...] = ()  # since the session began; the newest last
    expected: Band = ()  # empty where it cannot be said
    was_consistent: bool = False  # whether it ever was, since then
    age_s: float = 0.0  # of its data, when it is read
    silent: bool = False  # whether nothing comes on the link then
    cause: Cause | None = None  # of an alarm

    @property
    def is_stale(self) -> bool:
        """Whether it says nothing of now."""
        return bool(self.newest) and (self.silent or self.age_s > check.STALE_S)

    @property
    def now(self) -> tuple[State, str]:
        """The state that holds now, and why: one of old data says as of when it held."""
        if not self.is_stale:
            return self.status, self.text
        return "stale", f"as of {self.age_s:.0f} s ago: {self.text}"

    @property
    def so_far(self) -> tuple[State, str]:
        """The verdict on the session up to now, and why: the first alarm, and what was after it."""
        if not self.alarms:
            return ("consistent", "no alarm so far") if self.was_consistent else ("", "nothing is known yet")
        lines = [f"{a.when}: {a.text}" for a in self.alarms]
        more = f" ({len(lines) - 2} more)" if len(lines) > 2 else ""
        return self.alarms[0].status, "; ".join(dict.fromkeys([lines[0], lines[-1]])) + more
