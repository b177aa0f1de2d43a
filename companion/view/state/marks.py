"""Instants of a flight that have a name: texts of the vehicle, arming, findings of the analysis."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Literal

from companion.model import Event, Flight, StatusText
from companion.present import Rgb, palette

MarkKind = Literal["finding", "arming", "mode", "trouble", "text", "anchor"]


@dataclass(frozen=True, slots=True)
class Mark:
    """A named instant. The label is untrusted text: it is escaped where it becomes markup."""

    t: float  # s, boot clock
    label: str
    kind: MarkKind = "text"


COLOURS: dict[MarkKind, Rgb] = {
    "finding": palette.DIFFERENCE,
    "arming": palette.AXES[1],
    "mode": palette.AXES[2],
    "trouble": palette.AXES[0],
    "text": palette.CURSOR,
    "anchor": palette.mix(palette.CURSOR, (255, 255, 255), 0.4),
}

MOST_LABELS = 60  # characters of a label that are shown
_ARMING = re.compile(r"\b(dis)?arm(ed|ing)?\b", re.IGNORECASE)
_MODE = re.compile(r"\bmode\b", re.IGNORECASE)
_WARNING = 4  # MAV_SEVERITY_WARNING; smaller is worse


def text_marks(flight: Flight) -> list[Mark]:
    """Texts and events of the vehicle, sorted by time."""
    texts = [Mark(text.t, text.text, _kind(text)) for text in flight.texts]
    return sorted([*texts, *map(_event_mark, flight.events)], key=lambda mark: mark.t)


def _event_mark(event: Event) -> Mark:
    if event.kind == "mode":
        return Mark(event.t, f"mode {event.text}", "mode")
    kinds: dict[str, MarkKind] = {"armed": "arming", "disarmed": "arming", "error": "trouble"}
    return Mark(event.t, event.text, kinds.get(event.kind, "text"))


def short(label: str) -> str:
    """A label as it fits in a list: one line, printable, cut where it is too long."""
    line = "".join(c if c.isprintable() else " " for c in label).strip() or "(no words)"
    return line if len(line) <= MOST_LABELS else line[: MOST_LABELS - 1] + "…"


def strip(marks: Sequence[Mark], low: float, high: float, part: tuple[float, float] | None = None) -> str:
    """Ticks between two times as HTML, their words at the pointer (title) and, where there is room, below.

    Anchors are small and without words. `part`: what is played, where that is not all.
    """
    if not high > low:
        return ""

    def share(t: float) -> float:
        return 100.0 * (t - low) / (high - low)

    ticks, words = [], []
    if part is not None:
        left, right = share(part[0]), share(part[1])
        ticks.append(
            f'<div style="position:absolute;left:{left:.2f}%;width:{right - left:.2f}%;height:100%;'
            f'background:{palette.css(palette.CONTROLS)};opacity:0.35"></div>'
        )
    free_from = -1.0  # per cent: where the last word below ended
    for mark in sorted(marks, key=lambda mark: mark.t):
        if not low <= mark.t <= high:
            continue
        at, colour, text = share(mark.t), palette.css(COLOURS[mark.kind]), short(mark.label)
        small = mark.kind == "anchor"
        margin, width, height = ("6px 4px 0", 1, "4px") if small else ("0 3px", 3, "100%")
        ticks.append(
            f'<div title="{mark.t:.1f} s: {escape(text)}" style="position:absolute;left:calc({at:.2f}% - 4px);'
            f'width:9px;height:100%"><div style="margin:{margin};width:{width}px;height:{height};background:{colour}">'
            "</div></div>"
        )
        room = (len(text) + 2) * _CHARACTER
        start = max(min(at, 100.0 - room), 0.0)
        if start > free_from and not small:
            words.append(f'<span style="position:absolute;left:{start:.2f}%;white-space:nowrap">{escape(text)}</span>')
            free_from = start + room
    return (
        f'<div style="position:relative;height:10px;background:rgba(130,130,130,0.12)">{"".join(ticks)}</div>'
        f'<div class="companion-words" style="position:relative;height:1.3em;font-size:0.72em;overflow:hidden">'
        f"{''.join(words)}</div>"
    )


_CHARACTER = 1.5  # per cent of the strip's width that a letter takes: 6.2 of 414 pixels


def _kind(text: StatusText) -> MarkKind:
    if _ARMING.search(text.text):
        return "arming"
    if _MODE.search(text.text):
        return "mode"
    return "trouble" if text.severity <= _WARNING else "text"
