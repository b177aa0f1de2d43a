"""What can be chosen and read beside the live picture. Nothing in here reaches the vehicle: anybody may press it.

Text of a vehicle, a link or a file name is escaped here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from html import escape

import viser

from companion.comparison import DriftRow, Statistic
from companion.present import capitalised, clause, lasting, palette, words, wrong
from companion.verdict import LiveVerdict
from companion.view.panels.controls import CAMERAS, ChooseCamera, Controls, bounded, write
from companion.view.panels.dead_reckoning import Change, integration_controls, on_choice
from companion.view.panels.markup import (
    PALE,
    badge,
    banner,
    block,
    colour_of,
    lines,
    row,
    swatch,
    table,
    trouble,
    wrapped,
)
from companion.view.panels.verdict import ChecksFolders
from companion.view.state.live import LONGEST_REANCHOR_S, Feed, FreeRun, LinkState, LiveStatus
from companion.view.state.trajectory import FlightChecks, Sample

BEST = "Automatic"


class LivePanel:
    """The controls. Built once; only the view thread may call it."""

    def __init__(
        self, controls: Controls, feed: Feed, window_s: float, change: Change, choose_camera: ChooseCamera
    ) -> None:
        """What `pause`, `back` and `vehicle` do is up to whoever builds it."""
        gui, self._number = controls.gui, ""
        longest = max(LONGEST_REANCHOR_S, float(feed.reanchor_s))
        self._verdict = gui.add_html("")
        self._link = gui.add_html("")
        self.pause = gui.add_button("Pause", icon=viser.Icon.PLAYER_PAUSE)
        self.back = gui.add_slider(
            "Look back, s", -window_s, 0.0, 0.1, 0.0, hint="The picture is held while the recording goes on"
        )
        cameras = {name: partial(choose_camera, mode) for name, (_, mode) in CAMERAS.items()}
        controls.row("View", cameras, "In this browser alone. More cameras: Picture")
        self._legend = gui.add_html("")
        self.numbers = gui.add_html("")
        self.flight = gui.add_html("")
        self._checks = ChecksFolders(gui, before_takeoff=True)
        with gui.add_folder("Dead reckoning", expand_by_default=False):
            self.vehicle = gui.add_dropdown("Vehicle", ("none",), visible=False)
            self._imu = gui.add_dropdown("IMU", (BEST,))
            integration_controls(controls, feed.choice.how, change)
            period = gui.add_number(
                "Re-anchor, s",
                float(feed.reanchor_s),
                min=0.5,
                max=longest,
                step=0.5,
                hint="Restart from the autopilot's state at this interval",
            )
            anchor = gui.add_button("Anchor now", icon=viser.Icon.ANCHOR, hint="Also begins the free run again")
        with gui.add_folder("Verdict and drift so far"):
            self._drift = gui.add_html("")
        with gui.add_folder("Link"):
            self._health = gui.add_html("")
        with gui.add_folder("Messages", expand_by_default=False):
            self._messages = gui.add_html("")
        controls.on_change(period, lambda s: setattr(feed, "reanchor_s", bounded(s, 0.5, 10.0, longest)))
        on_choice(
            controls, change, self._imu, lambda c, name: replace(c, imu=name if name in self._imu.options[1:] else None)
        )
        controls.on_click(anchor, feed.anchor_now)
        controls.command("Anchor now", "A", feed.anchor_now)

    def introduce(
        self, vehicle: str, number: str, imus: tuple[str, ...], chosen: str | None, *, has_position: bool
    ) -> None:
        """Show which vehicle it is, which IMUs it has and which of them was chosen; None: the page's own choice.

        number: of the vehicle, as the list of vehicles has it.
        """
        self._number = number
        self._name_vehicle()
        if self._imu.options != (BEST, *imus):
            self._imu.options = (BEST, *imus)
            write(self._imu, chosen if chosen in imus else BEST)
        self._legend.content = legend(vehicle, has_position=has_position)

    def report(self, status: LiveStatus, held_s: float | None) -> None:
        """Write how everything stands. held_s: how long ago the held picture was; None: live."""
        state = status.link
        self._verdict.content = verdict(status.verdict, state, status.why_not)
        self._link.content = link(state, status.why_not, held_s)
        self._health.content = health(state)
        self._drift.content = drift(status.drift, status.verdict, status.other_verdicts)
        self._checks.load(FlightChecks(preflight=status.preflight))
        self._messages.content = messages(status.messages)
        vehicles = tuple(status.vehicles)
        if vehicles and vehicles != self.vehicle.options:
            self.vehicle.options = vehicles
            self.vehicle.visible = len(vehicles) > 1
            self._name_vehicle()

    def _name_vehicle(self) -> None:
        """Let the list show the vehicle that is looked at."""
        if self._number in self.vehicle.options:
            write(self.vehicle, self._number)

    def hold(self, at_s: float | None, duration_s: float) -> None:
        """The picture is held at so many s before its end (0 or less); None: it is live. duration_s: how far back."""
        paused = at_s is not None
        self.pause.label = "Live" if paused else "Pause"
        self.pause.icon = viser.Icon.PLAYER_PLAY if paused else viser.Icon.PLAYER_PAUSE
        low = -max(round(duration_s, 1), 0.1)
        if paused:
            self.back.min = low
        write(self.back, max(at_s or 0.0, low))


def verdict(now: LiveVerdict, state: LinkState, why_not: str) -> str:
    """The verdict now as the banner over the picture; why there is none while there is none."""
    if now.status and (now.is_stale or not state.problem):
        old = f"link {state.problem}" if state.problem else f"as of {now.age_s:.0f} s ago" if now.is_stale else ""
        return banner(now.status, _headline(now), capitalised(clause(now.text)), old, stale=_is_dimmed(now))
    if state.problem:
        return banner("", f"No verdict: {state.problem}")
    return banner("", why_not or "No verdict yet: the first needs some seconds of data.")


def _headline(now: LiveVerdict) -> str:
    """What a pilot has to know first."""
    if (cause := now.cause) is not None:
        return f"{wrong(cause)}, {f'since {cause.onset_s:.0f} s' if cause.end_s is None else lasting(cause)}"
    return "No IMU fault found" if now.status == "consistent" else capitalised(words(now.status))


def link(state: LinkState, why_not: str, held_s: float | None) -> str:
    """Live, held or and whether it is recorded. held_s: how long ago the held picture was; None: live."""
    if held_s is not None:
        head = badge(f"PAUSED, {held_s:.1f} s ago", palette.CONTROLS)
    elif state.problem:
        head = badge("RECONNECTING" if state.frames else "WAITING", palette.BAD)
    elif why_not:
        head = badge("WAITING", palette.CONTROLS)
    else:
        head = badge("LIVE", palette.GOOD)
    rows = [head]
    if state.problem or why_not:
        rows.append(trouble(state.problem or why_not))
    if state.recording_problem:
        rows.append(trouble(state.recording_problem))
    elif state.recording:
        rows.append(
            '<div style="overflow-wrap:anywhere"><span style="color:var(--companion-trouble)">●</span> Recording '
            f"{escape(state.recording)}, {size(state.recorded_bytes)}</div>"
        )
    else:
        rows.append("Not recorded")
    return block(lines(rows))


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
    return block(lines([escape(vehicle), *rows]))


_STALE = f"<style>.uplot,canvas[data-engine]{{opacity:{palette.QUIET};filter:grayscale(0.8)}}</style>"


def numbers(sample: Sample, free: FreeRun | None, *, has_position: bool, silent: bool = False) -> str:
    """The errors now: since the last anchor, and of the free run.

    silent: nothing is received, so that they are those of the last sample, and are dimmed with picture and charts.
    """
    rows = [
        ("since anchor", f"{sample.since_anchor_s:.1f} s", f"{free.age_s:.0f} s" if free else ""),
        ("tilt", f"{sample.tilt_deg:.2f}°", "{0:.2f}°"),
        ("heading", f"{sample.heading_deg:+z.2f}°", "{1:+z.2f}°"),
    ]
    if has_position:
        rows += [
            ("velocity", f"{sample.velocity_mps:.2f} m/s", "{2:.2f} m/s"),
            ("position", f"{sample.position_m:.2f} m", "{3:.1f} m"),
        ]
    quiet, errors = PALE if silent else "", free.errors if free else ()
    cells = (row((name, first, second.format(*errors) if errors else ""), quiet) for name, first, second in rows)
    if silent:
        return _STALE + table(("Error when last received", "IMU", "free run"), cells)
    return table(("Error", "IMU", "free run"), cells)


def health(state: LinkState) -> str:
    """Rates, losses, the clocks."""
    rows = (
        row((escape(s.name), f"{s.received_hz:.0f} / {s.requested_hz:.0f} Hz", wrapped(escape(s.note))))
        for s in state.streams
    )
    lost = "".join(f", {100.0 * share:.2f} % of {escape(who)} lost" for who, share in state.lost.items())
    rest = [f"{escape(state.link)}: {state.frames:,} frames{lost}"]
    if state.latency_ms is not None:
        rest.append(f"Latency {state.latency_ms:.1f} ms")
    if state.clock:
        rest.append(escape(state.clock))
    if state.rejected:
        rest.append(f"{state.rejected:,} frames dropped: not signed, or not with our key")
    return table(("Message", wrapped("received / requested"), ""), rows) + block(lines(rest))


def drift(rows: Sequence[DriftRow], now: LiveVerdict, others: Sequence[LiveVerdict] = ()) -> str:
    """The verdict so far, those on the other vehicles now, and the drift table: medians."""
    head = _verdict("So far", *now.so_far)
    head += "".join(_verdict(f"Vehicle {o.vehicle}", o.status, _with_age(o), stale=_is_dimmed(o)) for o in others)
    measured = (
        row((f"{r.horizon_s:g} s", r.windows, _median(r.attitude_deg, "°"), _median(r.position_m, " m")))
        for r in rows
        if r.windows or r.excluded
    )
    return block(head) + table(("after", "windows", "attitude", "position"), measured)


def _verdict(when: str, status: str, text: str, *, stale: bool = False) -> str:
    head = badge(f"{when}: {words(status)}", colour_of(status, stale=stale)) if status else ""
    return lines([head, escape(text)]) if text else ""


def _with_age(now: LiveVerdict) -> str:
    """A verdict, and how old it is where that matters."""
    return f"{now.text} (as of {now.age_s:.0f} s ago)" if now.is_stale else now.text


def _is_dimmed(now: LiveVerdict) -> bool:
    """Whether it stands in grey: of old data, but for an alarm, which nothing has taken back."""
    return now.is_stale and not now.is_alarm


def messages(sentences: Sequence[str]) -> str:
    """The messages of the session, the newest first."""
    return block(lines(map(escape, reversed(sentences))) or "Nothing so far.")


def size(count: int) -> str:
    """Bytes as a person says them."""
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{count / 1e3:.0f} kB"


def _median(statistic: Statistic | None, unit: str) -> str:
    return "" if statistic is None else f"{statistic.median:.2f}{unit}"
