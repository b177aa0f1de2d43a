"""The play clock: which instant of the flight is shown, how fast it moves, and what the controls of time do to it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import assert_never

from companion.view.state import events
from companion.view.state.marks import Mark, neighbour
from companion.view.state.sample import Footage

SLOWEST, FASTEST = 0.1, 50.0  # times real time


class Player:
    """A clock over the interval `[first, last]` of a flight's boot clock, s, or over a part `[start, end]` of it.

    It has no clock of its own: whoever owns it calls `advance` with the seconds that have passed in the room.
    Whatever is done, `first <= start <= time <= end <= last`.
    """

    def __init__(self, first: float, last: float) -> None:
        self.playing = False
        self.loop = False
        self.backwards = False
        self._speed = 1.0
        self.first = self.start = self.time = first
        self.last = self.end = last
        self.load(first, last)

    def load(self, first: float, last: float, time: float | None = None) -> None:
        """Take another interval, at `time` as near as it allows (default: its start); speed and loop are kept.

        With a `time` it is the same flight reckoned anew, and the part stays as far as it still lies within.
        """
        if not (math.isfinite(first) and math.isfinite(last) and first <= last):
            raise ValueError(f"a play interval needs finite bounds in order, got [{first}, {last}]")
        low = first if time is None or self.start <= self.first else self.start
        high = last if time is None or self.end >= self.last else self.end
        self.first, self.last = first, last
        self.choose_part(low, high)
        self.seek(self.start if time is None else time)

    def choose_part(self, low: float, high: float) -> None:
        """Stay between two times, in either order; no part at all is the whole."""
        if math.isfinite(low) and math.isfinite(high):
            low, high = (min(max(t, self.first), self.last) for t in sorted((low, high)))
            whole = low >= high
            self.start, self.end = (self.first, self.last) if whole else (low, high)
            self.seek(self.time)

    @property
    def is_part(self) -> bool:
        """Whether less than the whole is played."""
        return self.start > self.first or self.end < self.last

    @property
    def duration(self) -> float:
        """Length of the part that is played, s."""
        return self.end - self.start

    @property
    def speed(self) -> float:
        """Flight seconds per second of the room, always within 0.1 ... 50."""
        return self._speed

    @speed.setter
    def speed(self, value: float) -> None:
        if math.isfinite(value):
            self._speed = min(max(value, SLOWEST), FASTEST)

    def toggle(self) -> None:
        """Play or pause. Play at the end starts over, as every player does."""
        if not self.playing and self.time == self._goal:
            self.time = self.end if self.backwards else self.start
        self.playing = not self.playing

    def seek(self, time: float) -> None:
        """Go to `time`, or to the nearest bound. Something that is no number is ignored."""
        if math.isfinite(time):
            self.time = min(max(time, self.start), self.end)

    def go(self, time: float) -> None:
        """Pause and go to `time`, or to the nearest bound."""
        self.playing = False
        self.seek(time)

    def advance(self, dt: float) -> None:
        """Let `dt` seconds of the room pass. Where the part ends: pause there, or start over when looping."""
        if not self.playing or not 0 < dt < math.inf:
            return
        step = dt * self._speed
        time = self.time - step if self.backwards else self.time + step
        if time > self.start if self.backwards else time < self.end:
            self.time = time
        elif self.loop and self.duration > 0:
            # Rounding may put the remainder on the bound itself.
            self.seek(self.start + (time - self.start) % self.duration)
        else:
            self.time, self.playing = self._goal, False

    @property
    def _goal(self) -> float:
        return self.start if self.backwards else self.end


def move(player: Player, event: events.Move, film: Footage, marks: Sequence[Mark]) -> None:
    """Do what `event` asks. A jump to where nothing is leaves the clock alone."""
    match event:
        case events.Toggle():
            player.toggle()
        case events.SetSpeed(speed):
            player.speed = speed
        case events.SetLoop(loop):
            player.loop = loop
        case events.SetBackwards(backwards):
            player.backwards = backwards
        case events.SetPart(edge):
            low = player.time if edge == "from" else player.first if edge == "whole" else player.start
            high = player.time if edge == "to" else player.last if edge == "whole" else player.end
            player.choose_part(low, high)
        case events.Seek(t):
            player.seek(t)  # scrubbing does not stop the play
        case events.SeekShare(share):
            player.seek(player.start + share * player.duration)
        case _:
            target = _target(player, event, film, marks)
            if target is not None:
                player.go(target)


def instant(text: str) -> float | None:
    """Seconds that an address asks for; None for what is no time."""
    try:
        seconds = float(text)
    except ValueError:
        return None
    return seconds if math.isfinite(seconds) else None


def _target(
    player: Player,
    event: events.Goto,
    film: Footage,
    marks: Sequence[Mark],
) -> float | None:
    match event:
        case events.Step(seconds):
            return player.time + seconds
        case events.StepSample(samples):
            return film.sample_from(player.time, samples)
        case events.Jump(to, forward):
            times = film.replay.anchors.tolist() if to == "anchor" else [mark.t for mark in marks]
            inside = [t for t in times if player.start <= t <= player.end]
            return neighbour(inside, player.time, forward=forward)
        case events.JumpToMark(index):
            return marks[index].t if 0 <= index < len(marks) else None
        case events.JumpToFinding(index):
            of_findings = film.insight.marks if film.insight else ()
            return of_findings[index].t if 0 <= index < len(of_findings) else None
        case _:
            assert_never(event)
