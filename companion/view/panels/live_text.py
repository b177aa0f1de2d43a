"""What a live page says, as markup. Every text that came from a vehicle, a link or a file name is escaped here."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape

from companion.analysis import DriftRow, Statistic
from companion.present import Rgb, palette
from companion.view.panels import banner
from companion.view.panels.verdict_tables import swatch
from companion.view.state.feed import Judgement, LinkState
from companion.view.state.trajectory import Sample

_STATUS = {
    "consistent": "Consistent",
    "imu_suspect": "IMU suspect",
    "autopilot_suspect": "Autopilot suspect",
    "insufficient_data": "Not enough data",
    "starting": "Starting",
    "lost": "Control lost",
}
_OLD_S = 5.0  # from which age on a verdict says how old it is


def verdict(judgement: Judgement, state: LinkState, why_not: str) -> str:
    """The verdict now as the banner over the picture; why there is none while there is none."""
    if judgement.status and not state.problem:
        return banner.banner(judgement.status, judgement.text + _age(judgement), stale=_is_stale(judgement))
    if state.problem:
        return banner.waiting(f"NO VERDICT – {state.problem}")
    return banner.waiting(why_not or "No verdict yet: the first needs some seconds of data.")


def link(state: LinkState, why_not: str, held_s: float | None) -> str:
    """Live, held or waiting, and whether it is recorded. held_s: how long ago the held picture was; None: live."""
    if held_s is not None:
        head = _badge(f"PAUSED, {held_s:.1f} s ago", palette.CONTROLS)
    elif state.problem:
        head = _badge("RECONNECTING" if state.frames else "WAITING", palette.BAD)
    elif why_not:
        head = _badge("WAITING", palette.CONTROLS)
    else:
        head = _badge("LIVE", palette.GOOD)
    lines = [head]
    if state.problem or why_not:
        lines.append(_trouble(state.problem or why_not))
    if state.recording_problem:
        lines.append(_trouble(state.recording_problem))
    elif state.recording:
        lines.append(
            '<div style="overflow-wrap:anywhere"><span style="color:var(--companion-trouble)">●</span> Recording '
            f"{escape(state.recording)}, {size(state.recorded_bytes)}</div>"
        )
    else:
        lines.append("<div>Not recorded</div>")
    return _block("".join(lines))


def legend(vehicle: str, *, has_position: bool) -> str:
    """Who is who."""
    rows = [
        f"{swatch(palette.IMU)}<b>Solid: the IMU alone</b>, since the last anchor",
        f"{swatch(palette.AUTOPILOT, 0.6)}<b>See-through: the autopilot</b>, its own estimate",
    ]
    if has_position:
        rows.append(f"{swatch(palette.FREE)}Ball: the IMU alone since the free run began")
        rows.append(f"{swatch(palette.DIFFERENCE)}Line: the distance of the IMU from the autopilot")
    else:
        rows.append("No position is sent: only the attitudes are compared.")
    return _block(f"<div>{escape(vehicle)}</div>" + "".join(f"<div>{row}</div>" for row in rows))


_STALE = f"<style>.uplot,canvas[data-engine]{{opacity:{palette.QUIET};filter:grayscale(0.8)}}</style>"


def numbers(
    sample: Sample, free: Sequence[float] | None, free_age_s: float, *, has_position: bool, silent: bool = False
) -> str:
    """The errors now: since the last anchor, and of the free run (tilt and heading °, velocity m/s, position m).

    silent: nothing is received, so that they are those of the last sample, and are dimmed with picture and charts.
    """
    rows = [
        ("since anchor", f"{sample.since_anchor_s:.1f} s", f"{free_age_s:.0f} s"),
        ("tilt", f"{sample.tilt_deg:.2f}°", "{0:.2f}°"),
        ("heading", f"{sample.heading_deg:+z.2f}°", "{1:+z.2f}°"),
    ]
    if has_position:
        rows += [
            ("velocity", f"{sample.velocity_mps:.2f} m/s", "{2:.2f} m/s"),
            ("position", f"{sample.position_m:.2f} m", "{3:.1f} m"),
        ]
    known = free is not None and all(map(math.isfinite, free))
    cells = ((name, first, second.format(*free) if known and free is not None else "") for name, first, second in rows)
    if silent:
        return _STALE + _table(("Error when last heard", "IMU", "free run"), cells, f"opacity:{palette.QUIET}")
    return _table(("Error", "IMU", "free run"), cells)


def health(state: LinkState) -> str:
    """Rates, losses, the clocks."""
    rows = [(escape(s.name), f"{s.received_hz:.0f} / {s.wanted_hz:.0f} Hz", escape(s.note)) for s in state.streams]
    lost = "".join(f", {share:.2%} of {escape(who)} lost" for who, share in state.lost.items())
    lines = [f"{escape(state.link)}: {state.frames:,} frames{lost}"]
    if state.latency_ms is not None:
        lines.append(f"Latency {state.latency_ms:.1f} ms")
    if state.clock:
        lines.append(escape(state.clock))
    if state.rejected:
        lines.append(f"{state.rejected:,} frames dropped: not signed, or not with our key")
    return _table(("Message", "received / wanted", ""), rows) + _block("".join(f"<div>{line}</div>" for line in lines))


def drift(rows: Sequence[DriftRow], judgement: Judgement) -> str:
    """The verdicts now and so far, and the drift table: medians."""
    head = _opinion("Now", judgement.status, judgement.text + _age(judgement), stale=_is_stale(judgement))
    head += _opinion("So far", judgement.status_so_far, judgement.text_so_far)
    table = _table(
        ("after", "windows", "attitude", "position"),
        (
            (f"{row.horizon_s:g} s", f"{row.windows}", _median(row.attitude_deg, "°"), _median(row.position_m, " m"))
            for row in rows
            if row.windows or row.excluded
        ),
    )
    return _block(head) + table


def _opinion(when: str, status: str, text: str, *, stale: bool = False) -> str:
    colour = banner.colour_of(status, stale=stale)
    badge = _badge(f"{when}: {_STATUS.get(status, status)}", colour) if status else ""
    return f"<div>{badge}<div>{escape(text)}</div></div>" if text else ""


def _age(judgement: Judgement) -> str:
    """How old a verdict is, where that matters."""
    return f" (as of {judgement.age_s:.0f} s ago)" if _is_stale(judgement) else ""


def _is_stale(judgement: Judgement) -> bool:
    return judgement.age_s > _OLD_S


def _trouble(text: str) -> str:
    return f'<div style="color:var(--companion-trouble)">{escape(text)}</div>'


def sentences(said: Sequence[str]) -> str:
    """What the session has said, the newest first."""
    return _block("".join(f"<div>{escape(sentence)}</div>" for sentence in reversed(said)) or "Nothing so far.")


def size(count: int) -> str:
    """Bytes as a person says them."""
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{count / 1e3:.0f} kB"


def _median(statistic: Statistic | None, unit: str) -> str:
    return "" if statistic is None else f"{statistic.median:.2f}{unit}"


def _badge(text: str, colour: Rgb) -> str:
    return (
        f'<span style="background:{palette.css(colour)};color:white;border-radius:0.3em;padding:0.1em 0.6em;'
        f'font-weight:700">{escape(text)}</span>'
    )


def _block(markup: str) -> str:
    return f'<div style="padding:0.2em 1em;font-size:0.8em;line-height:1.55">{markup}</div>'


def _table(header: Sequence[str], rows: Iterable[Sequence[str]], style: str = "") -> str:
    """header and rows: markup already. style: of every cell below the header."""

    def line(cells: Sequence[str], tag: str, style: str) -> str:
        sides = ("left", *["right"] * (len(cells) - 1))
        marked = (f'<{tag} style="text-align:{s};{style}">{cell}</{tag}>' for s, cell in zip(sides, cells, strict=True))
        return f"<tr>{''.join(marked)}</tr>"

    body = "".join(line(row, "td", style) for row in rows)
    return (
        '<div style="padding:0.2em 1em"><table style="width:100%;font-size:0.8em;font-variant-numeric:tabular-nums;'
        f'border-spacing:0 0.1em">{line(header, "th", f"font-weight:400;opacity:{palette.QUIET}")}{body}</table></div>'
    )
