"""Instants of a flight that have a name: texts of the vehicle, arming, findings of the analysis."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from companion.model import Event, Flight, StatusText

MarkKind = Literal["finding", "arming", "mode", "trouble", "text", "anchor"]


@dataclass(frozen=True, slots=True)
class Mark:
    """A named instant. The label is untrusted text: it is escaped where it becomes markup."""

    t: float  # s, boot clock
    label: str
    kind: MarkKind = "text"


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


def _kind(text: StatusText) -> MarkKind:
    if _ARMING.search(text.text):
        return "arming"
    if _MODE.search(text.text):
        return "mode"
    return "trouble" if text.severity <= _WARNING else "text"
