"""The strip under the slider of time, on its axis: modes, arming, findings, height, and one error beside its bound."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise

import numpy as np

from companion.model import Array, Flight
from companion.present import Rgb, capitalised, palette, severity_of, significant
from companion.view.state.moments import ERRORS, ErrorCurve, Mark, MarkKind, Moment, finding_label, short
from companion.view.state.sending import evenly, extremes
from companion.view.state.trajectory import DisplayTrajectory

HEIGHT = 116  # pixels
GUTTER = 3.6  # em at the left, for the numbers of the axes
PROFILE_POINTS = 200  # of the altitude
CURVE_POINTS = 400  # of the error
_TICKS = 8  # of time, at most about so many
_CHARACTER = 0.6  # per cent of the band's width that a letter takes: 5.4 of 900 pixels
_MODES, _ARMED, _FINDINGS, _HILL, _CURVE = ((0, 13), (13, 3), (18, 9), (29, 24), (56, 60))
"""Top and height of each row, pixels."""
_ROOM = 1.15  # times the largest of a curve, the height of its axis

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
    altitude: tuple[Array, Array] | None = None  # (N,) s, boot clock, and (N,) m above the origin


def bands(flight: Flight, display: DisplayTrajectory) -> Bands:
    """Those of a flight: modes and arming as the vehicle announced them, findings once the analysis has come."""
    modes = _until_next([(e.t, e.text) for e in flight.events if e.kind == "mode"], display.end)
    switched = [(e.t, e.kind) for e in flight.events if e.kind in ("armed", "disarmed")]
    armed = [span for span in _until_next(switched, display.end) if span.label == "armed"]
    if switched and switched[0][1] == "disarmed":  # it was armed before the log began
        armed.insert(0, Span(display.start, switched[0][0], "armed"))
    findings = display.result.assessment.verdict.findings if display.result else ()
    spans = tuple(Span(f.start_s, f.end_s, finding_label(f), f.severity) for f in findings)
    altitude = None
    if display.replay.has_position:
        some = evenly(len(display.replay.t), PROFILE_POINTS)
        altitude = (display.replay.t[some], -display.replay.position_ref[some, 2])
    return Bands(tuple(modes), tuple(armed), spans, altitude)


def outside(spans: Sequence[Span], low: float, high: float) -> str:
    """How many findings lie before or after what is replayed, in words; "" for none."""
    before, after = sum(s.end_s < low for s in spans), sum(s.start_s > high for s in spans)
    parts = [f"{n} {where}" for n, where in ((before, "before it begins"), (after, "after it ends")) if n]
    if not parts:
        return ""
    noun = "finding lies" if before + after == 1 else "findings lie"
    return f"{before + after} {noun} outside the replay: {', '.join(parts)}."


def markup(shown: Bands, low: float, high: float, curve: ErrorCurve, colour: Rgb, moment: Moment | None) -> str:
    """The strip between two times, as HTML of `HEIGHT` pixels; its words as text.

    curve: the error that is drawn, in the colour of its IMU; moment: what is pointed at.
    """
    if not high > low:
        return ""

    def place(span: Span) -> tuple[float, float]:
        left = 100 * (max(span.start_s, low) - low) / (high - low)
        return left, 100 * (min(span.end_s, high) - low) / (high - low) - left

    rows = [_profile(shown.altitude, low, high)]
    if moment is not None and moment.end_s > low and moment.onset_s < high:
        rows.append(_box(*place(Span(moment.onset_s, moment.end_s, "")), 0, HEIGHT, (*palette.DIFFERENCE, 0.16)))
    for i, span in enumerate(shown.modes):
        if span.end_s > low and span.start_s < high:
            left, width = place(span)
            name = span.label if len(span.label) * _CHARACTER < width else ""
            rows.append(_box(left, width, *_MODES, (*palette.MODES[i % 2], palette.MODES_OPACITY), name))
    armed = [span for span in shown.armed if span.end_s > low and span.start_s < high]
    rows += [_box(*place(span), *_ARMED, (*palette.AXES[1], 0.9)) for span in armed]
    # The worst last: it lies on top.
    for span in sorted(shown.findings, key=lambda s: ("info", "warning", "error").index(s.severity)):
        if span.end_s >= low and span.start_s <= high:
            opacity = 0.35 if span.severity == "info" else 0.85
            rows.append(_box(*place(span), *_FINDINGS, (*palette.SEVERITIES[span.severity], opacity)))
    rows.append(_curve(curve, low, high, colour))
    return (
        f'<div class="companion-bands" style="position:relative;height:{HEIGHT}px;'
        f'background:rgba{(*palette.BAND, palette.BAND_OPACITY)}">{"".join(rows)}</div>'
    )


def legend(shown: Bands, curve: ErrorCurve, colour: Rgb, moment: Moment | None) -> str:
    """What is drawn in which colour, in a line above the strip; as for `markup`."""

    def spot(of: Rgb, name: str, shape: str = "width:9px;height:9px") -> str:
        return (
            f'<span style="white-space:nowrap;margin-left:1em"><span style="display:inline-block;{shape};'
            f'background:{palette.css(of)};margin-right:0.35em"></span>{name}</span>'
        )

    line = "width:14px;height:3px;vertical-align:middle"
    rest = [spot(palette.SEVERITIES[s], severity_of(s)) for s in ("error", "warning", "info")
            if any(f.severity == s for f in shown.findings)]  # fmt: skip
    rest += [spot(palette.AXES[1], "armed", line)] if shown.armed else []
    rest += [spot(palette.BAND, "altitude", "width:9px;height:9px;opacity:.5")] if shown.altitude else []
    if moment is not None:
        name = "selected" if moment.of_finding else "worst window, in σ"
        rest.append(spot(palette.DIFFERENCE, name, "width:9px;height:9px;opacity:.4"))
    name, unit = f"{capitalised(ERRORS[curve.error].name)} error", ERRORS[curve.error].unit
    when = "since the anchor" if curve.horizon_s is None else f"after {curve.horizon_s:g} s"
    allowed = spot(palette.CURSOR, "allowed: 1σ, 3σ") if np.isfinite(curve.allowed).any() else ""
    return f"<div><b>{spot(colour, f'{name} {when}, {unit}', line)}</b>{allowed}{''.join(rest)}</div>"


def _curve(curve: ErrorCurve, low: float, high: float, colour: Rgb) -> str:
    """One error as a line over the area that is allowed, 1σ and 3σ, with the numbers of its axis."""
    inside = np.flatnonzero((curve.t >= low) & (curve.t <= high))
    if len(inside) < 2:
        return ""
    kept = inside[extremes((curve.values[inside], np.nan_to_num(curve.allowed[inside])), CURVE_POINTS)]
    t, values, allowed = curve.t[kept], curve.values[kept], np.nan_to_num(curve.allowed[kept])
    most = _ROOM * max(float(values.max()), float(np.median(allowed)), 1e-9)
    top, height = _CURVE
    x = 100 * (t - low) / (high - low)

    def line(of: Array) -> str:
        return _points(x, 100 - 100 * np.minimum(of / most, 1.0))

    areas = "".join(
        f'<polygon points="{x[0]:.2f},100 {line(times * allowed)} {x[-1]:.2f},100" '
        f'fill="{palette.rgba(palette.CURSOR, opacity)}"/>'
        for times, opacity in ((3.0, 0.16), (1.0, 0.26))
        if allowed.any()
    )
    drawn = (
        f'<polyline points="{line(values)}" fill="none" stroke="{palette.css(colour)}" '
        'stroke-width="1.8" vector-effect="non-scaling-stroke"/>'
    )
    return (
        _svg(*_CURVE, areas + drawn)
        + _number(significant(most / _ROOM), top + (1 - 1 / _ROOM) * height)
        + _number("0", top + height)
    )


def _number(text: str, y: float) -> str:
    """On an axis, left of the strip."""
    return (
        f'<div style="position:absolute;right:calc(100% + 4px);top:{y - 7:.0f}px;font-size:10px;line-height:14px;'
        f'white-space:nowrap;font-variant-numeric:tabular-nums">{escape(text)}</div>'
    )


def strip(marks: Sequence[Mark], low: float, high: float, part: tuple[float, float] | None = None) -> str:
    """Ticks between two times as HTML, their words at the pointer (title), and the axis of time below.

    Anchors are small and without words. `part`: what is played, where that is not all.
    """
    if not high > low:
        return ""

    def share(t: float) -> float:
        return 100.0 * (t - low) / (high - low)

    ticks = []
    if part is not None:
        left, right = share(part[0]), share(part[1])
        ticks.append(
            f'<div style="position:absolute;left:{left:.2f}%;width:{right - left:.2f}%;height:100%;'
            f'background:{palette.css(palette.CONTROLS)};opacity:0.35"></div>'
        )
    for mark in sorted(marks, key=lambda mark: mark.t):
        if not low <= mark.t <= high:
            continue
        colour, text = palette.css(COLOURS[mark.kind]), short(mark.label)
        small = mark.kind == "anchor"
        margin, width, height = ("6px 4px 0", 1, "4px") if small else ("0 3px", 3, "100%")
        ticks.append(
            f'<div title="{mark.t:.1f} s: {escape(text)}" style="position:absolute;'
            f"left:calc({share(mark.t):.2f}% - 4px);"
            f'width:9px;height:100%"><div style="margin:{margin};width:{width}px;height:{height};background:{colour}">'
            "</div></div>"
        )
    times = "".join(
        f'<span style="position:absolute;left:{share(t):.2f}%;transform:translateX(-50%);white-space:nowrap">{t:g}'
        f"{' s' if i == 0 else ''}</span>"
        for i, t in enumerate(time_ticks(low, high))
    )
    return (
        f'<div style="position:relative;height:10px;background:rgba(130,130,130,0.12)">{"".join(ticks)}</div>'
        f'<div style="position:relative;height:13px;font-size:10px;line-height:13px">{times}</div>'
    )


def time_ticks(low: float, high: float) -> list[float]:
    """Round times between two, s, at 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10((high - low) / _TICKS))
    step = next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power * _TICKS >= high - low)
    places = np.arange(np.ceil(low / step), np.floor(high / step) + 1.0)
    return list(np.clip(places * step, low, high).tolist())  # a product may be rounded to beyond either


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


def _profile(altitude: tuple[Array, Array] | None, low: float, high: float) -> str:
    """The altitude above the origin, or above the lowest point below it, as a pale hill; the highest as a number."""
    if altitude is None or np.ptp(altitude[1]) <= 0:
        return ""
    t, up = altitude
    most, least = float(max(up.max(), 0.0)), float(min(up.min(), 0.0))
    x, y = np.clip(100 * (t - low) / (high - low), -100, 200), 100 - 100 * (up - least) / (most - least)
    hill = f'<polygon points="{x[0]:.2f},100 {_points(x, y)} {x[-1]:.2f},100" fill="rgba(130,130,130,0.34)"/>'
    return _svg(*_HILL, hill) + _number(f"{most:.1f} m", _HILL[0] + 6)


def _svg(top: int, height: int, shapes: str) -> str:
    """Shapes in per cent of a row's width and height."""
    return (
        '<svg viewBox="0 0 100 100" preserveAspectRatio="none" style="position:absolute;left:0;width:100%;'
        f'top:{top}px;height:{height}px">{shapes}</svg>'
    )


def _points(x: Array, y: Array) -> str:
    return " ".join(f"{a:.2f},{b:.1f}" for a, b in zip(x.tolist(), y.tolist(), strict=True))
