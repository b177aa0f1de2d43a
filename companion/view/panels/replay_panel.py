"""What is read beside the picture: the verdict, the numbers of the instant, who is who."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from html import escape

import numpy as np

from companion.model import Flight, of_kind
from companion.present import QUANTITIES, Rgb, headline, palette, vehicle_words
from companion.strapdown import quaternion
from companion.verdict import Verdict
from companion.view.panels.controls import Controls, write
from companion.view.panels.markup import PALE, banner, block, lines, row, swatch, table, title, wrapped
from companion.view.panels.strip import Bands
from companion.view.state.trajectory import EXTRA_PATHS, DisplayTrajectory, ExtraPath, Sample


class Panel:
    """What is read first: who is who, the verdict, the numbers. Built once; `load` fits it to a flight."""

    def __init__(self, controls: Controls, flights: Sequence[Flight], pick: Callable[[Flight], object]) -> None:
        """pick: called with the flight that is chosen."""
        gui = controls.gui
        self._flights = {f"{i}: {_title(flight)}": flight for i, flight in enumerate(flights, 1)}
        self._banner = gui.add_html("")
        self._pick = gui.add_dropdown("Flight", tuple(self._flights), visible=len(flights) > 1)
        self._numbers = gui.add_html("")
        self._status = gui.add_html("")
        self._legend = gui.add_html("")
        controls.on_change(self._pick, lambda name: pick(self._flights[name]))

    def load(self, flight: Flight, display: DisplayTrajectory, lasting: Bands, colours: Mapping[str, Rgb]) -> None:
        """Fit it to what is shown now. Values set here come back as no change."""
        self._flight, self._display, self._lasting, self._colours = flight, display, lasting, colours
        self.choose_flight(flight)
        if display.result is not None:
            self.judge(display.result.assessment.verdict)

    def judge(self, verdict: Verdict) -> None:
        """Write the verdict over the picture."""
        head = headline(verdict)
        self._banner.content = banner(verdict.status, head.sentence, head.detail, head.probability)

    def wait(self, text: str) -> None:
        """There is no verdict, or not yet: why, in words. `text` may hold anything."""
        self._banner.content = banner("", text)

    def choose_flight(self, flight: Flight) -> None:
        """Show which flight it is: another may have been requested in vain."""
        write(self._pick, next(name for name, one in self._flights.items() if one is flight))

    def show(self, sample: Sample, cell: float, extra_paths: Collection[ExtraPath]) -> None:
        """Write the instant, the side of the grid's squares (m), and who is who.

        extra_paths: those that are shown besides.
        """
        display, has_position = self._display, self._display.replay.has_position
        self._legend.content = _legend(self._flight, display, self._colours, extra_paths)
        self._numbers.content = (
            errors_table(sample, display)
            + horizon_table(sample, display)
            + title("The flight at this instant")
            + flight_data(sample, self._flight, self._lasting, has_position=has_position)
            + (block(f"A square of the grid is {cell:g} m wide.", PALE) if has_position else "")
        )

    def status(self, text: str, *, trouble: bool = False) -> None:
        """Report progress, or why something failed. `text` may hold anything."""
        colour = "var(--companion-trouble)" if trouble else "inherit"
        self._status.content = block(escape(text), f"color:{colour}") if text else ""


def identity(flight: Flight) -> str:
    """A flight's mark, by which a browser finds again what it showed last of it: the same whenever it is opened."""
    tracks = [(name, len(track)) for name, track in flight.imus.items()]
    marks = repr((str(flight.vehicle), flight.boot, flight.start, flight.duration, tracks))
    return hashlib.blake2s(marks.encode(), digest_size=8).hexdigest()


def _title(flight: Flight) -> str:
    return f"vehicle {flight.vehicle}, boot {flight.boot}, {flight.duration:.0f} s"


def _legend(
    flight: Flight, display: DisplayTrajectory, colours: Mapping[str, Rgb], extra_paths: Collection[ExtraPath]
) -> str:
    """Who is who. Text that came from the vehicle is escaped: it is untrusted, and this is markup."""
    source, line = display.source, "width:1em;height:0.25em"
    rows = [
        f"{swatch(colours[source])}<b>Solid: {escape(source)} alone</b>, dead-reckoned from its readings",
        *(f"{swatch(colours[name])}{escape(name)}, likewise" for name in display.others),
        f"{swatch(palette.AUTOPILOT, 0.6)}<b>See-through: the autopilot</b>, its own estimate",
    ]
    if display.replay.has_position:
        rows.append(f"{swatch(palette.DIFFERENCE, 1.0, line)}The distance between them")
        colours_of = "".join(
            swatch(colour, 1.0, "width:0.7em;height:0.35em;margin-right:0") for _, colour in palette.SIGMAS
        )
        rows.append(f"{colours_of} The autopilot's track: error below 1σ, 2σ, above 3σ of what is allowed")
    else:
        rows.append("This log has no position: only the attitudes are compared.")
    rows += [f"{mark}{EXTRA_PATHS[name][0]}" for name, mark in _EXTRA_PATHS.items() if name in extra_paths]
    who = escape(f"{vehicle_words(flight.vehicle)}, {_title(flight)}")
    return (
        f'<div data-companion-imu="{escape(source)}" data-companion-log="{identity(flight)}">'
        f"{block(lines([who, *rows]))}</div>"
    )


_EXTRA_PATHS: dict[ExtraPath, str] = {
    "gps": swatch(palette.GPS, 1.0, "width:0.45em;height:0.45em;border-radius:50%;margin-left:0.25em"),
    "best": (
        '<span style="display:inline-block;width:1em;height:0.3em;margin-right:0.4em;vertical-align:middle;'
        f"background:repeating-linear-gradient(90deg,{palette.css(palette.BEST)} 0 0.25em,"
        f'{palette.css(palette.BEST_LIGHT)} 0.25em 0.5em)"></span>'
    ),
}


def errors_table(sample: Sample, display: DisplayTrajectory) -> str:
    """Each error since the anchor, what is allowed of it, and how many σ that is."""
    sizes = []
    for quantity in QUANTITIES:
        allowed = 0.0 if display.expected is None else display.expected.at(sample.t, quantity.attribute)
        sizes.append(_error(quantity.name, getattr(sample, quantity.attribute), allowed, quantity.after))
    tilt = row(("· tilt", f"{sample.tilt_deg:.2f}°", "", ""), PALE)
    rows = [sizes[0], tilt, row(("· heading", f"{sample.heading_deg:+z.2f}°", "", ""), PALE)]
    if display.replay.has_position:
        down = abs(float(sample.position_imu[2] - sample.position_ref[2]))
        height = float(np.sqrt(max(sample.covariance[2, 2], 0.0)))
        rows += [*sizes[1:], _error("· height", down, height, " m", PALE)]
    since = f"{sample.since_anchor_s:.1f} s since the anchor" if sample.known else "autopilot silent here"
    return table((since, "error", "allowed 1σ", "σ"), rows)


def _error(name: str, error: float, allowed: float, unit: str, style: str = "") -> str:
    known = allowed > 0
    times = f"{error / allowed:.1f}" if known else "–"
    return row((name, f"<b>{error:.2f}{unit}</b>", f"{allowed:.2f}{unit}" if known else "–", times), style)


def horizon_table(sample: Sample, display: DisplayTrajectory) -> str:
    """The window of the chosen horizon that ends at the instant, beside what is allowed of such windows.

    By what is known of the part before the flight, and by what the flight's own calibration leaves unknown of it.
    """
    if (result := display.result) is None or (after := result.after_horizon(sample.t)) is None:
        return ""
    rows = []
    for value, quantity in zip(after, QUANTITIES[:: 2 if display.replay.has_position else 3], strict=False):
        allowed = (getattr(one, quantity.attribute, None) for one in (result.allowed, result.calibrated))
        of = (f"{one:.2f}{quantity.after}" if one else "–" for one in allowed)
        rows.append(row((quantity.name, f"<b>{value:.2f}{quantity.after}</b>", *of)))
    head = (f"after {result.horizon_s:g} s", "error", "allowed 1σ", "calibrated 1σ")
    return table(head, rows)


def flight_data(sample: Sample, flight: Flight, lasting: Bands, *, has_position: bool, of_log: bool = True) -> str:
    """What the vehicle did at the instant, as far as is known: mode, place, speed, attitude, battery, the time.

    of_log: whether the flight is a log, whose progress is shown; else the last seconds of a link.
    """
    mode = next((one.label for one in reversed(lasting.modes) if one.start_s <= sample.t <= one.end_s), "")
    armed = any(one.start_s <= sample.t <= one.end_s for one in lasting.armed)
    roll, pitch, yaw = np.degrees(quaternion.to_euler(sample.q_ref)).round().astype(int)
    since = max(sample.t - flight.start, 0.0)
    rows = [("Time", f"{sample.t:.2f} s since boot")]
    if of_log:
        rows.append(("In the log", f"{int(since // 60)}:{since % 60:04.1f}"))
    if flight.epoch is not None:
        rows.append(("UTC", time.strftime("%d %B %Y, %H:%M:%S", time.gmtime(flight.epoch.unix_s + sample.t))))
    if mode or lasting.armed:
        rows.append(("Mode", f"{escape(mode or 'unknown')}, {'armed' if armed else 'disarmed'}"))
    if has_position:
        speed, climb = float(np.hypot(*sample.velocity_ref[:2])), -float(sample.velocity_ref[2])
        rows.append(("Altitude", f"{-float(sample.position_ref[2]):z.1f} m, {climb:+z.1f} m/s"))
        rows.append(("Ground speed", f"{speed:.1f} m/s"))
    rows.append(("Roll, pitch, yaw", f"{roll:+d}°, {pitch:+d}°, {yaw % 360}°"))
    if battery := _battery(flight, sample.t):
        rows.append(("Battery", battery))
    return table((), (row((name, wrapped(value))) for name, value in rows))


def _battery(flight: Flight, t: float) -> str:
    """Voltage, current and what remains of the first battery, as reported last; "" where that is unknown or old."""
    for one in of_kind(flight.series, "battery"):
        at = int(np.searchsorted(one.t, t, side="right")) - 1
        if at >= 0 and t - one.t[at] < _BATTERY_S:
            volts, ampere, share = (float(one[name][at]) for name in ("voltage_v", "current_a", "remaining"))
            parts = (f"{volts:.1f} V", f"{ampere:.1f} A", f"{100.0 * share:.0f} %")
            known = (part for part, value in zip(parts, (volts, ampere, share), strict=True) if np.isfinite(value))
            return ", ".join(known)
    return ""


_BATTERY_S = 10.0  # it is reported once a second or two
