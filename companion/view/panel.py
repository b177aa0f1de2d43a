"""What can be chosen and read beside the picture. Every choice becomes an event for the view thread."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np
import viser

from companion.model import Flight
from companion.view import events, palette, tables
from companion.view.choice import Offer, ReplayChoice
from companion.view.controls import listen, write
from companion.view.moment import Footage, Moment
from companion.view.palette import Rgb
from companion.view.picture import PictureControls
from companion.view.reckoning import ReckoningControls
from companion.view.tables import swatch

TRAILS = {
    "Path so far": events.SetTrail(None),
    "Last 10 s": events.SetTrail(10.0),
    "Last 30 s": events.SetTrail(30.0),
    "Whole path": events.SetTrail(None, ahead=True),
}


class Panel:
    """The controls. Built once; `load` fits them to a flight, `show` writes the instant into them."""

    def __init__(self, gui: viser.GuiApi, flights: Sequence[Flight], offer: Offer, post: events.Post) -> None:
        self._post = post
        self._flight = flights[0]
        self._names = {id(f): f"{i + 1}: {_title(f)}" for i, f in enumerate(flights)}
        self._pick = gui.add_dropdown("Flight", tuple(self._names.values()), visible=len(flights) > 1)
        self._legend = gui.add_html("")
        self._verdict = gui.add_html("")
        self._numbers = gui.add_html("")
        self._status = gui.add_html("")
        self.playing = gui.add_folder("Playing")  # filled by the timeline
        self._reckoning = ReckoningControls(gui, flights[0], offer, post)
        self._picture = PictureControls(gui, TRAILS, post, expects=True)
        with gui.add_folder("Save", expand_by_default=False):
            self._save_picture = gui.add_button("This picture (PNG)", icon=viser.Icon.CAMERA)
            self._save_page = gui.add_button("The 3D replay (HTML)", icon=viser.Icon.FILE_EXPORT)
            self._save_report = gui.add_button(
                "The report (HTML)",
                icon=viser.Icon.FILE_EXPORT,
                visible=offer.report is not None,
                hint="Verdict, charts and tables of what is shown, to mail or print",
            )
        self._listen()

    @property
    def picture(self) -> viser.GuiFolderHandle:
        """The folder in which each browser finds its own camera."""
        return self._picture.folder

    def load(self, flight: Flight, choice: ReplayChoice, film: Footage, colours: Mapping[str, Rgb]) -> None:
        """Fit the controls to what is shown now. Values set here come back as no events."""
        self._flight = flight
        self.choose_flight(flight)
        self._legend.content = _legend(flight, film, colours)
        insight = film.insight
        self._verdict.content = tables.status(insight.assessment) if insight else ""
        self._reckoning.load(flight, choice, film.start)

    def choose_flight(self, flight: Flight) -> None:
        """Say which flight is shown: another may have been asked for in vain."""
        write(self._pick, self._names[id(flight)])

    def show(self, moment: Moment, film: Footage, cell: float) -> None:
        """Write the instant, and the side of the grid's squares (m), into the numbers."""
        self._numbers.content = _numbers(moment, film, moment.t - self._flight.start, cell)

    def status(self, text: str, *, trouble: bool = False) -> None:
        """Say what the reckoning is doing, or why it failed. `text` may hold anything."""
        colour = palette.css(palette.DIFFERENCE) if trouble else "inherit"
        html = f'<div style="padding:0 1em 0.5em;font-size:0.8em;color:{colour}">{escape(text)}</div>' if text else ""
        if self._status.content != html:
            self._status.content = html

    def _listen(self) -> None:
        post = self._post
        listen(self._pick, post, lambda: events.PickFlight(int(self._pick.value.split(":")[0]) - 1))

        kinds: tuple[tuple[viser.GuiButtonHandle, events.Kept], ...] = (
            (self._save_picture, "picture"),
            (self._save_page, "page"),
            (self._save_report, "report"),
        )
        for button, what in kinds:
            self._save(button, what)

    def _save(self, button: viser.GuiButtonHandle, what: events.Kept) -> None:
        @button.on_click
        async def _(click: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            if click.client_id is not None:
                self._post(events.Save(click.client_id, what))


def _title(flight: Flight) -> str:
    vehicle = flight.vehicle
    return f"vehicle {vehicle}, boot {flight.boot}, {flight.duration:.0f} s"


def _legend(flight: Flight, film: Footage, colours: Mapping[str, Rgb]) -> str:
    """Who is who. Text that came from the vehicle is escaped: it is untrusted, and this is markup."""
    vehicle, source = flight.vehicle, film.source
    who = escape(tables.kind(vehicle))
    line = "width:1em;height:0.25em"
    rows = [
        f"{swatch(colours[source])}<b>Solid: {escape(source)} alone</b>, reckoned from its readings",
        *(f"{swatch(colours[name])}{escape(name)}, likewise" for name in film.others),
        f"{swatch(palette.AUTOPILOT, 0.6)}<b>See-through: the autopilot</b>, its own estimate",
    ]
    if film.replay.has_position:
        rows.append(f"{swatch(palette.DIFFERENCE, 1.0, line)}The distance between them")
    else:
        rows.append("This log has no position: only the attitudes are compared.")
    lines = "".join(f"<div>{row}</div>" for row in rows)
    return (
        f'<div style="padding:0.2em 1em;font-size:0.8em;line-height:1.5"><div>{who}, vehicle '
        f"{escape(str(vehicle))}, boot {flight.boot}, {flight.duration:.0f} s</div>{lines}</div>"
    )


def _numbers(moment: Moment, film: Footage, since_start: float, cell: float) -> str:
    has_position = film.replay.has_position
    rows = [
        ("Since boot", f"{moment.t:.2f} s", f"{since_start:.1f} s into the log"),
        ("Since anchor", f"{moment.since_anchor_s:.1f} s", "" if moment.known else "autopilot silent here"),
        ("Attitude error", f"{moment.tilt_deg:.2f}° tilt", f"{moment.heading_deg:+.2f}° heading"),
    ]
    if has_position:
        rows.append(("Velocity error", f"{moment.velocity_mps:.2f} m/s", f"grid squares {cell:g} m"))
        sigma = float(np.sqrt(np.trace(moment.covariance)))
        rows.append(("Position error", f"{moment.position_m:.2f} m", f"expected 1σ {sigma:.2f} m" if sigma else ""))
    if (after := film.after_horizon(moment.t)) is not None and film.insight is not None:
        attitude, position = after
        said = f"{position:.2f} m" if has_position else ""
        rows.append((f"After {film.insight.horizon_s:g} s", f"{attitude:.2f}°", said))
    cells = "".join(
        f'<tr><td style="opacity:0.7">{name}</td><td style="text-align:right;font-weight:600">{first}</td>'
        f'<td style="text-align:right">{second}</td></tr>'
        for name, first, second in rows
    )
    return (
        '<div style="padding:0.2em 1em"><table style="width:100%;font-size:0.84em;'
        f'font-variant-numeric:tabular-nums;border-spacing:0 0.05em">{cells}</table></div>'
    )
