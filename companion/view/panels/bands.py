"""What lasted: flight modes, armed or not, findings, and how high it flew, as bands under the slider of time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise

import numpy as np

from companion.model import Array, Flight, words
from companion.present import Rgb, palette
from companion.view.state.marks import Mark, MarkKind, short
from companion.view.state.trajectory import DisplayTrajectory

HEIGHT = 34  # pixels
PROFILE_POINTS = 200  # of the altitude
_MARK_CHARACTER = 1.5  # per cent of the strip's width that a letter takes: 6.2 of 414 pixels
_CHARACTER = 0.85  # per cent of the band's width that a letter takes: 5.4 of 640 pixels


COLOURS: dict[MarkKind, Rgb] = {
    "finding": palette.DIFFERENCE,
    "arming": palette.AXES[1],
    "mode": palette.AXES[2],
    "trouble": palette.AXES[0],
    "text": palette.CURSOR,
    "anchor": palette.mix(palette.CURSOR, (255, 255, 255), 0.4),
}


@dataclass(frozen=True, slots=True)
class Span:
    """Something that lasted. The label is untrusted."""

    start_s: float  # boot clock
    end_s: float
    label: str
    severity: str = ""  # of a finding


@dataclass(frozen=True, slots=True, eq=False)
class Bands:
    """All that lies under the slider."""

    modes: tuple[Span, ...] = ()
    armed: tuple[Span, ...] = ()
    findings: tuple[Span, ...] = ()
    height: tuple[Array, Array] | None = None  # (N,) s, boot clock, and (N,) m above the lowest


def bands(flight: Flight, display: DisplayTrajectory) -> Bands:
    """Those of a flight: modes and arming as the vehicle announced them, findings once the analysis has come."""
    modes = _until_next([(e.t, e.text) for e in flight.events if e.kind == "mode"], display.end)
    switched = [(e.t, e.kind) for e in flight.events if e.kind in ("armed", "disarmed")]
    armed = [span for span in _until_next(switched, display.end) if span.label == "armed"]
    if switched and switched[0][1] == "disarmed":  # it was armed before the log began
        armed.insert(0, Span(display.start, switched[0][0], "armed"))
    findings = display.result.assessment.verdict.findings if display.result else ()
    spans = tuple(Span(f.start_s, f.end_s, f"{words(f.kind)}: {f.evidence}", f.severity) for f in findings)
    height = None
    if display.replay.has_position:
        some = np.unique(np.linspace(0, len(display.replay.t) - 1, PROFILE_POINTS).round().astype(np.intp))
        down = display.replay.position_ref[some, 2]
        height = (display.replay.t[some], down.max() - down)
    return Bands(tuple(modes), tuple(armed), spans, height)


def outside(spans: Iterable[Span], low: float, high: float) -> str:
    """How many findings lie before or after what is replayed, in words; "" for none."""
    spans = list(spans)
    before, after = sum(s.end_s < low for s in spans), sum(s.start_s > high for s in spans)
    parts = [f"{n} {where}" for n, where in ((before, "before it begins"), (after, "after it ends")) if n]
    if not parts:
        return ""
    noun = "finding lies" if before + after == 1 else "findings lie"
    return f"{before + after} {noun} outside the replay: {', '.join(parts)}."


def markup(shown: Bands, low: float, high: float) -> str:
    """The bands between two times, as HTML of `HEIGHT` pixels; their words as text."""
    if not high > low:
        return ""

    def place(span: Span) -> tuple[float, float]:
        left = 100 * (max(span.start_s, low) - low) / (high - low)
        return left, 100 * (min(span.end_s, high) - low) / (high - low) - left

    rows = [_profile(shown.height, low, high)]
    for i, span in enumerate(shown.modes):
        if span.end_s > low and span.start_s < high:
            left, width = place(span)
            words = span.label if len(span.label) * _CHARACTER < width else ""
            rows.append(_box(left, width, 0, 12, (*palette.MODES[i % 2], palette.MODES_OPACITY), words))
    armed = [span for span in shown.armed if span.end_s > low and span.start_s < high]
    rows += [_box(*place(span), 12, 3, (*palette.AXES[1], 0.9)) for span in armed]
    # The worst last: it lies on top.
    for span in sorted(shown.findings, key=lambda s: ("info", "warning", "error").index(s.severity)):
        if span.end_s >= low and span.start_s <= high:
            opacity = 0.25 if span.severity == "info" else 0.75
            rows.append(_box(*place(span), 17, HEIGHT - 17, (*palette.SEVERITIES[span.severity], opacity)))
    return (
        f'<div class="companion-bands" style="position:relative;height:{HEIGHT}px;overflow:hidden;'
        f'background:rgba{(*palette.BAND, palette.BAND_OPACITY)}">{"".join(rows)}</div>'
    )


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
        room = (len(text) + 2) * _MARK_CHARACTER
        start = max(min(at, 100.0 - room), 0.0)
        if start > free_from and not small:
            words.append(f'<span style="position:absolute;left:{start:.2f}%;white-space:nowrap">{escape(text)}</span>')
            free_from = start + room
    return (
        f'<div style="position:relative;height:10px;background:rgba(130,130,130,0.12)">{"".join(ticks)}</div>'
        f'<div class="companion-words" style="position:relative;height:1.3em;font-size:0.72em;overflow:hidden">'
        f"{''.join(words)}</div>"
    )


def _until_next(changes: Sequence[tuple[float, str]], end: float) -> list[Span]:
    """Each state lasts until the next begins; the last one to the end."""
    ordered = sorted(changes, key=lambda change: change[0])
    spans = [Span(t, after, label) for (t, label), (after, _) in pairwise([*ordered, (end, "")])]
    return [span for span in spans if span.end_s > span.start_s]


def _box(left: float, width: float, top: int, height: int, colour: tuple[int, int, int, float], text: str = "") -> str:
    r, g, b, opacity = colour
    return (
        f'<div style="position:absolute;left:{left:.2f}%;width:max({width:.2f}%,3px);top:{top}px;height:{height}px;'
        f"background:rgba({r},{g},{b},{opacity});font-size:10px;line-height:{height}px;padding-left:2px;"
        f'box-sizing:border-box;white-space:nowrap;overflow:hidden;text-overflow:ellipsis">{escape(text)}</div>'
    )


def _profile(height: tuple[Array, Array] | None, low: float, high: float) -> str:
    """The altitude as a pale hill, the highest point at the top."""
    if height is None or height[1].max() <= 0:
        return ""
    x, y = 100 * (height[0] - low) / (high - low), 100 - 92 * height[1] / height[1].max()
    points = " ".join(f"{a:.2f},{b:.1f}" for a, b in zip(x.tolist(), y.tolist(), strict=True))
    return (
        '<svg viewBox="0 0 100 100" preserveAspectRatio="none" '
        'style="position:absolute;inset:0;width:100%;height:100%">'
        f'<polygon points="{x[0]:.2f},100 {points} {x[-1]:.2f},100" fill="rgba(130,130,130,0.28)"/></svg>'
    )
