"""Dead reckoning of samples as they arrive: the same numbers as `dead_reckon` over all of them at once."""

from __future__ import annotations

import numpy as np

from companion.model import STANDARD_GRAVITY, ImuTrack, NavState, Trajectory, check_number
from companion.strapdown._methods import scheme_for
from companion.strapdown.dead_reckon import SAME_TIME, checked, run, start_index


class DeadReckoner:
    """Continues a dead reckoning with every chunk of samples, however the stream is cut.

    Linear, Euler and midpoint answer up to the newest sample. The cubic through four samples needs the one after an
    interval, so there the answer is one sample late (10 ms at 100 Hz) and never revised; the first answer needs four
    samples. `behind` is the number of samples that wait, and `finish` answers them as the end of a track, one-sided.

    start: the state at one of the samples of the first push. method, middle, segments, gravity: see `dead_reckon`,
    which also lists the errors.
    """

    def __init__(
        self,
        start: NavState,
        *,
        method: str = "rk4",
        middle: str = "cubic",
        segments: int = 1,
        gravity: float = STANDARD_GRAVITY,
    ) -> None:
        check_number("gravity", gravity)
        self._state = checked(start)
        self._scheme = scheme_for(method, middle, segments)
        self._gravity = gravity
        self._held = ImuTrack(np.empty(0), np.empty((0, 3)), np.empty((0, 3)))  # what coming intervals need
        self._keep = 0  # the first sample of `_held` that is still needed
        self._at = 0  # the sample of `_held` at which the state stands
        self._begun = False  # whether the start has been answered

    @property
    def state(self) -> NavState:
        """The newest answered state."""
        return self._state

    @property
    def behind(self) -> int:
        """Samples received and not yet answered: 1 with the cubic once it runs, else 0."""
        return max(len(self._held) - 1 - self._at, 0)

    def push(self, chunk: ImuTrack) -> Trajectory:
        """The states that the chunk makes known, none twice; the very first row is the start. May have no rows.

        Raises ValueError for samples not after those already pushed, and if the first push holds none at start.t.
        """
        held = _join(self._held, self._keep, chunk)
        at = self._at - self._keep
        if not self._begun and len(held):
            at = start_index(held, self._state)
        self._held, self._keep, self._at = held, 0, at
        last = len(held) - 1
        if self._scheme.looks_ahead:
            # The very first interval is one-sided, through the first four samples of the stream.
            last = last - 1 if self._at > 0 or len(held) >= 4 else 0
        return self._advance(last)

    def finish(self) -> Trajectory:
        """The states at the samples that still wait, with the last interval one-sided as at the end of a track."""
        return self._advance(len(self._held) - 1)

    def anchor(self, state: NavState) -> None:
        """Continue from another state at the time of `state`, e.g. from the autopilot's own estimate.

        Raises ValueError if it is for another time than the newest answer's, or not a valid start.
        """
        if abs(state.t - self._state.t) > SAME_TIME:
            raise ValueError(
                f"the reckoning stands at {self._state.t:.6f} s; an anchor at {state.t:.6f} s does not fit"
            )
        self._state = checked(state)

    def _advance(self, last: int) -> Trajectory:
        """The new states up to sample `last` of what is held; forgets what no coming interval needs."""
        held, first = self._held, self._at
        if len(held) == 0:
            return Trajectory(np.empty(0), np.empty((0, 4)), np.empty((0, 3)), np.empty((0, 3)))
        last, old = max(last, first), int(self._begun)  # the state's own row has been answered before
        q, v, p = run(held, first, last, self._state, self._gravity, self._scheme)
        self._state = NavState(float(held.t[last]), q[-1], v[-1], p[-1])
        self._begun = True
        # With the sample that waits the four that `finish` needs for its one-sided cubic.
        self._keep, self._at = max(last - 2, 0), last
        notes = self._scheme.notes_on(held) if last > first else ()
        return Trajectory(held.t[first + old : last + 1], q[old:], v[old:], p[old:], notes)


def _join(a: ImuTrack, keep: int, b: ImuTrack) -> ImuTrack:
    """The samples of `a` from `keep` on and those of `b` as one track. Raises ValueError if times do not increase."""
    if len(a) == 0:
        return b
    interval = None
    if a.interval is not None and b.interval is not None:
        interval = np.concatenate((a.interval[keep:], b.interval))
    return ImuTrack(
        np.concatenate((a.t[keep:], b.t)),
        np.concatenate((a.gyro[keep:], b.gyro)),
        np.concatenate((a.accel[keep:], b.accel)),
        b.source or a.source,
        interval=interval,
    )
