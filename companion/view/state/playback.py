"""What the controls of time do to the play clock. Knows no viser."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import assert_never

from companion.view.state import events
from companion.view.state.marks import Mark, neighbour
from companion.view.state.player import Player
from companion.view.state.sample import Footage


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
            found = film.insight.marks if film.insight else ()
            return found[index].t if 0 <= index < len(found) else None
        case _:
            assert_never(event)
