"""What is read beside the picture: the verdict, the numbers of the instant, who is who."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Mapping, Sequence
from html import escape

import numpy as np

from companion.model import Flight
from companion.present import Rgb, palette, vehicle_words
from companion.view.panels.controls import Controls, write
from companion.view.panels.markup import banner, block, lines, row, swatch, table, waiting, wrapped
from companion.view.state.choice import EXTRA_PATHS, ExtraPath
from companion.view.state.sending import update
from companion.view.state.trajectory import DisplayTrajectory, Sample


class Panel:
    """What is read first: who is who, the verdict, the numbers. Built once; `load` fits it to a flight."""

    def __init__(self, controls: Controls, flights: Sequence[Flight], pick: Callable[[int], object]) -> None:
        """pick: called with the place in the list of the flight that is chosen."""
        gui = controls.gui
        self._flight = flights[0]
        self._names = {id(f): f"{i + 1}: {_title(f)}" for i, f in enumerate(flights)}
        self._banner = gui.add_html("")
        self._pick = gui.add_dropdown("Flight", tuple(self._names.values()), visible=len(flights) > 1)
        self._numbers = gui.add_html("")
        self._status = gui.add_html("")
        self._legend = gui.add_html("")
        controls.on_change(self._pick, lambda name: pick(int(name.split(":")[0]) - 1))

    def load(self, flight: Flight, display: DisplayTrajectory) -> None:
        """Fit it to what is shown now. Values set here come back as no change."""
        self._flight = flight
        self.choose_flight(flight)
        if display.result is not None:
            verdict = display.result.assessment.verdict
            self._banner.content = banner(verdict.status, verdict.summary)

    def introduce(
        self, display: DisplayTrajectory, colours: Mapping[str, Rgb], extra_paths: Collection[ExtraPath]
    ) -> None:
        """Write the legend. extra_paths: those that are shown besides."""
        self._legend.content = _legend(self._flight, display, colours, extra_paths)

    def wait(self, text: str) -> None:
        """There is no verdict, or not yet: why, in words. `text` may hold anything."""
        self._banner.content = waiting(text)

    def choose_flight(self, flight: Flight) -> None:
        """Show which flight it is: another may have been requested in vain."""
        write(self._pick, self._names[id(flight)])

    def show(self, sample: Sample, display: DisplayTrajectory, cell: float) -> None:
        """Write the instant, and the side of the grid's squares (m), into the numbers."""
        self._numbers.content = _numbers(sample, display, sample.t - self._flight.start, cell)

    def status(self, text: str, *, trouble: bool = False) -> None:
        """Report progress, or why something failed. `text` may hold anything."""
        colour = "var(--companion-trouble)" if trouble else "inherit"
        update(self._status, content=block(escape(text), f"color:{colour}") if text else "")


def identity(flight: Flight) -> str:
    """A flight's mark, by which a browser finds again what it showed last of it: the same whenever it is opened."""
    tracks = [(name, len(track)) for name, track in flight.imus.items()]
    marks = repr((str(flight.vehicle), flight.boot, flight.start, flight.duration, tracks))
    return hashlib.blake2s(marks.encode(), digest_size=8).hexdigest()


def _title(flight: Flight) -> str:
    vehicle = flight.vehicle
    return f"vehicle {vehicle}, boot {flight.boot}, {flight.duration:.0f} s"


def _legend(
    flight: Flight, display: DisplayTrajectory, colours: Mapping[str, Rgb], extra_paths: Collection[ExtraPath]
) -> str:
    """Who is who. Text that came from the vehicle is escaped: it is untrusted, and this is markup."""
    vehicle, source = flight.vehicle, display.source
    line = "width:1em;height:0.25em"
    rows = [
        f"{swatch(colours[source])}<b>Solid: {escape(source)} alone</b>, dead-reckoned from its readings",
        *(f"{swatch(colours[name])}{escape(name)}, likewise" for name in display.others),
        f"{swatch(palette.AUTOPILOT, 0.6)}<b>See-through: the autopilot</b>, its own estimate",
    ]
    if display.replay.has_position:
        rows.append(f"{swatch(palette.DIFFERENCE, 1.0, line)}The distance between them")
    else:
        rows.append("This log has no position: only the attitudes are compared.")
    rows += [f"{mark}{EXTRA_PATHS[name][0]}" for name, mark in _EXTRA_PATHS.items() if name in extra_paths]
    who = (
        f"{escape(vehicle_words(vehicle))}, vehicle {escape(str(vehicle))}, boot {flight.boot}, {flight.duration:.0f} s"
    )
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


def _times_expected(sample: Sample, display: DisplayTrajectory) -> tuple[str, str, str] | None:
    """Each error divided by what is expected of it; None where nothing is expected, or not yet."""
    if display.expected is None:
        return None
    attitude, velocity, position = display.expected.at(sample.t)
    if attitude <= 0:
        return None
    first = f"{np.hypot(sample.tilt_deg, sample.heading_deg) / attitude:.1f} attitude"
    if not display.replay.has_position or velocity <= 0 or position <= 0:
        return "÷ expected", first, ""
    rest = f"{sample.velocity_mps / velocity:.1f} velocity, {sample.position_m / position:.1f} position"
    return "÷ expected", first, rest


def _numbers(sample: Sample, display: DisplayTrajectory, since_start: float, cell: float) -> str:
    has_position = display.replay.has_position
    rows = [
        ("Since boot", f"{sample.t:.2f} s", f"{max(since_start, 0.0):.1f} s into the log"),
        ("Since anchor", f"{sample.since_anchor_s:.1f} s", "" if sample.known else "autopilot silent here"),
        ("Attitude error", f"{sample.tilt_deg:.2f}° tilt", f"{sample.heading_deg:+z.2f}° heading"),
    ]
    if has_position:
        rows.append(("Velocity error", f"{sample.velocity_mps:.2f} m/s", f"grid squares {cell:g} m"))
        sigma = float(np.sqrt(np.trace(sample.covariance)))
        rows.append(("Position error", f"{sample.position_m:.2f} m", f"expected 1σ {sigma:.2f} m" if sigma else ""))
    if (quotients := _times_expected(sample, display)) is not None:
        rows.append(quotients)
    if (after := display.after_horizon(sample.t)) is not None and display.result is not None:
        attitude, position = after
        metres = f"{position:.2f} m" if has_position else ""
        rows.append((f"After {display.result.horizon_s:g} s", f"{attitude:.2f}°", metres))
    return table((), (row((name, f"<b>{first}</b>", wrapped(second))) for name, first, second in rows))
