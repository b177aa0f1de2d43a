"""Several logs in one .bin, one behind the other, as a tool or a person has joined them: the records of each boot."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from companion.logs import Records
from companion.model import Array
from companion.telemetry.clock import REBOOT_FALL_S, Clock, reboots

_DECLARATION = "FMT"  # what a log begins with


def boots(messages: dict[str, Records]) -> list[dict[str, Records]]:
    """The records of each boot: a new one begins where the clock of the commonest falls and stays.

    The records are taken over: where there are several boots the dictionary is empty afterwards.
    """
    timed = [one for one in messages.values() if one.layout.clock and len(one)]
    if not timed:
        return [messages]
    clock = max(timed, key=len)
    t = clock.t
    if not (np.diff(t) < -REBOOT_FALL_S).any():  # as of nearly all logs
        return [messages]
    starts = reboots(Clock(clock.offset, t, np.zeros(len(t))))
    borders = [0, *(_border(messages, clock, t, first) for first in starts), np.iinfo(np.int64).max]
    several = []
    for edges in pairwise(borders):
        cut = {name: one.select(slice(*np.searchsorted(one.offset, edges).tolist())) for name, one in messages.items()}
        several.append({name: one for name, one in cut.items() if len(one)})
    messages.clear()
    return several


def _border(messages: Mapping[str, Records], clock: Records, t: Array, first: int) -> int:
    """Where in the file the boot begins whose first record of the clock that is.

    What stands before it is of this boot from the first declaration on, and from the first time that is nearer to it.
    """
    after, begin = clock.offset[first - 1], int(clock.offset[first])
    border = begin
    for one in messages.values():
        between = slice(*np.searchsorted(one.offset, (after + 1, begin)).tolist())
        places = one.offset[between]
        if one.layout.clock:
            own = one.select(between).t
            places = places[np.abs(own - t[first]) < np.abs(own - t[first - 1])]
        elif one.name != _DECLARATION:
            continue
        border = min(border, int(places.min(initial=begin)))
    return border
